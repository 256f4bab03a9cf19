"""The two models that a validation compares, their forecasts of a log, and the errors of both.

A forecast starts from the measured state and is driven by the measured torques. Rows are taken from intervals of the
log without gaps; an interval between rows longer than 1.5 sample times is a gap, and no forecast crosses one.

Errors are the thesis's (4.1), the RMSE, the normalised RMSE, and the ratio of both models with a 95 % interval. (4.1)
divides the norm of the differences by their number n, not by its root:

    e = |x - x_hat| / n,      RMSE = |x - x_hat| / sqrt(n) = e sqrt(n)

so that e shrinks with the length of what is compared. Both are given; ratios of equally long runs are the same. The
normalised RMSE is divided by the standard deviation of the measurement: 1 is no better than a constant.

Errors below `FINEST` count as `FINEST` in a ratio. The interval is that of `ballbot.fitting.comparison`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats, Ints
from ballbot.control.interface import Feedback
from ballbot.errors import InputError, check_known
from ballbot.findings import Finding
from ballbot.fitting.comparison import FINEST, LEAST_RUNS, Verdict, ratio_interval, verdicts
from ballbot.log import STATE_NAMES, Log
from ballbot.log.pose import ball_rates, measured_wheel_speeds
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot
from ballbot.summary import counted

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True)
class NamedModel:
    """A model and its name, which follows "the model" in sentences: "with friction", or "of soft.toml"."""

    name: str
    model: Model


@dataclass(frozen=True)
class ModelPair:
    """Two models of robots with the same number of wheels: the first is validated, the second is the reference.

    InputError if they have the same name, are the same model, or differ in the number of wheels.
    """

    first: NamedModel
    second: NamedModel

    def __post_init__(self) -> None:
        first, second = self.first, self.second
        if first.name == second.name:
            raise InputError(f"Both models are called {first.name!r}; give them different names.")
        own, other = (model.robot.wheel_count for model in self.both)
        if own != other:
            raise InputError(
                f"The model {first.name} has {own} wheels and the model {second.name} has {other} wheels; both must be "
                "of the robot that was logged."
            )
        same_form = first.model.formulation == second.model.formulation
        if same_form and np.array_equal(first.model.packed, second.model.packed):
            raise InputError(
                f"The model {first.name} and the model {second.name} are the same; there is nothing to compare."
            )

    @staticmethod
    def by_friction(model: Model) -> ModelPair:
        """Return a model paired with itself without friction; InputError if it has no friction."""
        robot = model.robot
        none = replace(Friction.none(robot.wheel_count), pivoting=robot.friction.pivoting)
        if robot.friction == none:
            raise InputError(
                f"The robot {robot.name} has no friction to validate. Identify it first, or validate it beside "
                "another robot or formulation: --against on the command line, ballbot.validation.ModelPair in Python."
            )
        bare = replace(model, robot=robot.replace(friction=none))
        return ModelPair(NamedModel("with friction", model), NamedModel("without friction", bare))

    @staticmethod
    def load(robot: str, *, against: str | None = None) -> ModelPair:
        """Return the model of a preset or robot file and the one that it is compared with.

        The second is another preset or robot file, "thesis" for the same robot with the thesis's equations, or by
        default the same robot without friction. InputError if a file is not valid or both models are the same.
        """
        model = model_of(Robot.load(robot))
        if against is None:
            return ModelPair.by_friction(model)
        if against == "thesis":
            thesis = NamedModel(
                "in the thesis's formulation", replace(model, formulation="thesis", pivoting=None)
            )
            return ModelPair(NamedModel("in the exact formulation", model), thesis)
        if not Path(against).exists():
            sentence = f"--against {against} is no preset or robot file, and not thesis"
            check_known(against, ["thesis", *Robot.presets()], sentence, otherwise="there are")
        other = NamedModel(f"of {against}", model_of(Robot.load(against)))
        return ModelPair(NamedModel(f"of {robot}", model), other)

    @property
    def names(self) -> tuple[str, str]:
        """The names of the first and the second model."""
        return self.first.name, self.second.name

    @property
    def both(self) -> tuple[Model, Model]:
        """The first model, then the second."""
        return self.first.model, self.second.model


def model_of(robot: Robot) -> Model:
    """Return a robot's model, whose ball pivots if the robot's friction says how."""
    return Model(robot, pivoting=robot.pivoting_torque)


Interval = tuple[float, float]
C = TypeVar("C", bound="Comparison")
Record = TypeVar("Record", bound="DataclassInstance")

#: an interval longer than this many sample times is a gap, across which nothing may be predicted
_GAP = 1.5


def stretches(log: Log, holdout: Sequence[Interval] | None = None) -> list[range]:
    """Return the intervals of rows without a gap, within the times start <= t < end [s] of a holdout.

    InputError if no row of the log lies in the holdout.
    """
    counts = np.ones(len(log), dtype=bool)
    if holdout is not None:
        counts = np.any([(log.t >= start) & (log.t < end) for start, end in holdout], axis=0)
        if not np.any(counts):
            raise InputError(
                f"No row of the log lies in the holdout intervals; the log runs from {log.t[0]:g} to {log.t[-1]:g} s."
            )
    compared = np.flatnonzero(counts)
    gaps = (np.diff(compared) > 1) | (np.diff(log.t[compared]) > _GAP * log.sample_time)
    parts = np.split(compared, np.flatnonzero(gaps) + 1)
    return [range(int(rows[0]), int(rows[-1]) + 1) for rows in parts if len(rows) > 1]


def window_starts(parts: Sequence[range], *, samples: int, every: int) -> Ints:
    """Return rows (starts,), `every` rows apart, from which `samples` steps stay within one of `parts`."""
    starts = [np.arange(part.start, part.stop - samples, every) for part in parts]
    return np.concatenate([*starts, np.empty(0)]).astype(np.int64)


def rows_after(starts: Ints, samples: int) -> Ints:
    """Return the rows (starts, samples) that follow each start: start + 1 .. start + samples."""
    return starts[:, None] + np.arange(1, samples + 1)


def forecast(
    models: Sequence[Model], log: Log, starts: Ints, samples: int, *, initial: Floats | None = None
) -> Floats:
    """Simulate each model from each start with the torques measured from there on.

    Row k of a log has the state at t_k and the torques that act from then on, so that the forecast from row k with the
    torques of rows k .. k + samples - 1 predicts the states of rows k + 1 .. k + samples. Returns the states (models,
    starts, samples, 10); a forecast stops at the largest lean. `initial` (starts, 10) replaces the measured initial
    states. InputError if a robot has another number of wheels than the log.
    """
    states = []
    for model in models:
        have, need = log.torques.shape[1], model.robot.wheel_count
        if have != need:
            raise InputError(
                f"The log has the torques of {have} wheels, but the robot {model.robot.name} has {need} wheels."
            )
        lanes = Lanes(
            parameters=model.packed[None],
            initial=started(model, log, starts, log.states[starts] if initial is None else initial),
            torques=log.torques[starts[:, None] + np.arange(samples)],
        )
        steps = model.steps_in(log.sample_time)
        run = simulate_lanes(model.selected, lanes, sample_time=log.sample_time, steps=steps)
        states.append(run.states[..., : len(STATE_NAMES)])
    return np.stack(states)


def started(model: Model, log: Log, rows: Ints, states: Floats) -> Floats:
    """Return a model's states (k, 10) in rows (k,) of a log; if its ball pivots, with the spin that the wheels show."""
    if not model.pivots:
        return states
    rates = ball_rates(log, model.robot, measured_wheel_speeds(log, model.robot))
    return np.column_stack([states, rates[rows, 2]])


def in_heading_frame(states: Floats, psi: Floats) -> Floats:
    """Return states or their differences (N, 10) in the heading frame, with pairs of x and y turned by -psi (N,)."""
    turned, c, s = states.copy(), np.cos(psi)[:, None], np.sin(psi)[:, None]
    x, y = [0, 2, 5, 7], [1, 3, 6, 8]
    turned[:, x] = c * states[:, x] + s * states[:, y]
    turned[:, y] = c * states[:, y] - s * states[:, x]
    return turned


def recoverable_lean(model: Model) -> float:
    """Return the largest lean [rad] from which, at rest, the largest torques can still raise the body.

    The smaller of the leans about x and about y.
    """
    largest = np.full(model.robot.wheel_count, model.robot.drive.torque_limit)
    return float(recoverable_leans(model, np.array([0.0, 0.5 * np.pi]), largest=largest).min())


def recoverable_leans(model: Model, directions: Floats, *, largest: Floats) -> Floats:
    """Return the largest lean [rad] in each direction (d,) from which, at rest, torques up to `largest` (n,) recover.

    The outward acceleration of the lean (theta, phi) = lean (cos d, sin d) is affine in the torques: that of the
    falling body, less at most |row of the torques| times the largest torques. The recoverable lean is where both are
    equal, at most the lean at which a simulation ends.
    """
    model = replace(model, pivoting=None)  # at rest nothing turns the ball
    leans, n = np.linspace(0.0, LARGEST_LEAN, 201), model.robot.wheel_count
    limits = np.empty(len(directions))
    for index, direction in enumerate(directions.tolist()):
        towards = np.array([0.0, 0.0, np.cos(direction), np.sin(direction), 0.0])
        q = leans[:, None] * towards
        fall, *pushed = (
            model.acceleration(q, np.zeros_like(q), np.tile(torques, (len(q), 1))) @ towards
            for torques in (np.zeros(n), *np.eye(n))
        )
        outward = fall - np.abs(np.array(pushed) - fall).T @ largest
        lost = int(np.argmax(outward > 0.0)) if outward[-1] > 0.0 else 0
        limits[index] = (
            np.interp(0.0, outward[lost - 1 : lost + 1], leans[lost - 1 : lost + 1]) if lost else LARGEST_LEAN
        )
    return limits


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """The input of a validation: two models, a log, and the rows that are compared."""

    models: ModelPair
    log: Log
    parts: Sequence[range]  #: rows without a gap
    controller: Feedback | None = None  #: the controller that recorded the log, if it is known
    seed: int = 0  #: random seed of the noise

    @cached_property
    def steps(self) -> tuple[Ints, Floats]:
        """Rows (steps,) from which one step stays within the parts, and both models' next states (2, steps, 10)."""
        starts = window_starts(self.parts, samples=1, every=1)
        return starts, forecast(self.models.both, self.log, starts, 1)[:, :, 0]

    @cached_property
    def noise(self) -> Floats:
        """Covariance (10, 10) of the noise of one measured state, estimated from the first model's residuals.

        A residual holds the noise of two states, the one started from and the one compared with, so half of the
        residuals' covariance is what one of them can have at most.
        """
        starts, predicted = self.steps
        return 0.5 * np.cov(self.log.states[starts + 1] - predicted[0], rowvar=False)

    def drawn_noise(self, *shape: int) -> Floats:
        """Return noise of measured states (*shape, 10)."""
        random = np.random.default_rng(self.seed)
        return random.multivariate_normal(np.zeros(len(self.noise)), self.noise, size=shape, method="eigh")


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectories:
    """Measured and predicted states over time from a common start, in the order and units of a log's states."""

    t: Floats  #: (k,) [s], of the log
    measured: Floats  #: (k, 10)
    first: Floats  #: (k, 10) of the first model
    second: Floats  #: (k, 10) of the second

    @staticmethod
    def beside(log: Log, start: int, states: Floats, *, every: int = 1) -> Trajectories:
        """Return every so many rows of a log from `start` on, beside the `states` (2, rows, 10) of both models."""
        rows = start + every * np.arange(states.shape[1] + 1)
        measured = log.states[rows]
        first, second = (np.vstack([measured[:1], run]) for run in states)
        return Trajectories(t=log.t[rows], measured=measured, first=first, second=second)


RUNS = 199  #: of a model, drawn to see what its own logs may show


def least_of(counts: Ints) -> int:
    """Return the 5 % quantile of a count over `RUNS` runs of a model: one more is below it in 5 % of cases at most."""
    return int(np.sort(counts)[RUNS // 20])


def thesis_error(difference: Floats) -> Floats:
    """Return e of (4.1) for each column of `difference` (n, states) = measured - modelled."""
    return np.linalg.norm(difference, axis=0) / len(difference)


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorPair:
    """The errors of two models over the same runs, in the order of time; states in the log's order and units."""

    by_run: Floats  #: (runs, 2, 10) e of (4.1) of the first model and the second in each run
    samples: Ints  #: (runs,) n, the samples of each run
    means: Floats  #: (runs, 10) of what was measured
    squares: Floats  #: (runs, 10) its mean squares
    overlap: int = 1  #: number of neighbouring runs that share rows of the log

    @staticmethod
    def of_runs(
        measured: Sequence[Floats], first: Sequence[Floats], second: Sequence[Floats], *, overlap: int = 1
    ) -> ErrorPair:
        """Return the errors of runs given as measured states and both models', each (n, 10) of its own length."""
        runs = list(zip(measured, first, second, strict=True))
        return ErrorPair(
            by_run=np.array([[thesis_error(x - x_hat) for x_hat in models] for x, *models in runs]),
            samples=np.array([len(run) for run in measured]),
            means=np.array([run.mean(axis=0) for run in measured]),
            squares=np.array([np.mean(run**2, axis=0) for run in measured]),
            overlap=overlap,
        )

    @property
    def runs(self) -> int:
        """How many runs were compared."""
        return len(self.samples)

    @property
    def error(self) -> Floats:
        """The mean of (4.1) over the runs (2, 10), of the first model and the second."""
        return self.by_run.mean(axis=0)

    @property
    def rmse(self) -> Floats:
        """The root mean square of the error over all samples of all runs (2, 10)."""
        # a run's sum of squares is (e n)^2
        return np.sqrt(np.sum((self.by_run.T * self.samples) ** 2, axis=-1).T / self.samples.sum())

    @property
    def ratio(self) -> Floats:
        """Error (4.1) of the second model over that of the first (10,), neither below `FINEST`.

        Above one, the first model is better; one if both errors are below `FINEST`.
        """
        first, second = self._resolved().mean(axis=0)
        return second / first

    @property
    def unresolved(self) -> Bools:
        """States (10,) whose errors are below `FINEST` in both models, which cannot be compared."""
        return self.rmse.max(axis=0) <= FINEST

    def _resolved(self) -> Floats:
        """Return `by_run` with no error below `FINEST`."""
        return np.maximum(self.by_run, FINEST / np.sqrt(self.samples[:, None, None]))

    @property
    def spread(self) -> Floats:
        """Standard deviation (10,) of what was measured, over all samples of all runs."""
        mean, square = (
            np.average(values, axis=0, weights=self.samples) for values in (self.means, self.squares)
        )
        return np.sqrt(np.maximum(square - mean**2, 0.0))

    @property
    def normalised_rmse(self) -> Floats:
        """RMSE of the first and the second over `spread` (2, 10); NaN where the spread is not above `FINEST`."""
        return self.rmse / np.where(self.spread > FINEST, self.spread, np.nan)

    @cached_property
    def ratio_interval(self) -> Floats:
        """The lower and upper ends (2, 10) of the 95 % interval on `ratio`; NaN below `LEAST_RUNS` runs.

        The bootstrap draws whole runs in blocks of neighbours, with both models' errors of a run together.
        """
        if self.runs < LEAST_RUNS:
            return np.full((2, len(STATE_NAMES)), np.nan)
        first, second = self._resolved().swapaxes(0, 1)
        return ratio_interval(second, first, overlap=self.overlap)

    def verdicts(self) -> tuple[Verdict, ...]:
        """Return the verdict on the first model from the interval on each state's ratio."""
        return verdicts(self.ratio_interval)

    def claim(self, models: ModelPair) -> str:
        """Return a clause: in how many states the first model is significantly better, and by which factors."""
        (first, second), verdicts_of = models.names, self.verdicts()
        if self.runs < LEAST_RUNS:
            few = f"{counted(self.runs, 'run')} {'is' if self.runs == 1 else 'are'} too few"
            return f"{few} to show which model is better"
        surely = [index for index, verdict in enumerate(verdicts_of) if verdict == "better"]
        worse = [name for name, verdict in zip(STATE_NAMES, verdicts_of, strict=True) if verdict == "worse"]
        better = f"the model {first} is better than the one {second} in "
        if not surely:
            better += "none of the ten states"
        else:
            ratio = self.ratio[surely]
            least, most = (STATE_NAMES[surely[int(index)]] for index in (ratio.argmin(), ratio.argmax()))
            sizes = f"{ratio.min():.1f} times ({least}) to {ratio.max():.1f} times ({most}) smaller"
            if len(surely) == 1:
                sizes = f"{ratio[0]:.1f} times smaller ({least})"
            count = "every one" if len(surely) == len(STATE_NAMES) else str(len(surely))
            better += f"{count} of the ten states, its error {sizes}"
        return better + (f", and worse in {', '.join(worse)}" if worse else "")

    def results(self, models: ModelPair) -> dict[str, object]:
        """Return each model's errors by its name, ratio, interval and verdict for results.json."""
        return {
            **by_model("", models, self.error),
            **by_model("rmse_", models, self.rmse),
            **by_model("normalised_rmse_", models, self.normalised_rmse),
            "ratio": by_state(self.ratio),
            "ratio_interval": by_state(self.ratio_interval),
            "verdict": by_state(np.array(self.verdicts())),
            "runs": self.runs,
            "samples": int(self.samples.sum()),
        }


def by_state(values: NDArray[np.generic]) -> dict[str, object]:
    """Return values (..., 10) by the states' names."""
    return {name: values[..., index].tolist() for index, name in enumerate(STATE_NAMES)}


def keys_of(models: ModelPair) -> list[str]:
    """Return the models' names as results.json has them."""
    return [re.sub(r"\W+", "_", name).strip("_") for name in models.names]


def by_model(prefix: str, models: ModelPair, both: Iterable[Floats]) -> dict[str, object]:
    """Return values (..., 10) of both models by their names and those of the states."""
    return {prefix + key: by_state(values) for key, values in zip(keys_of(models), both, strict=True)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """The result of a validation of one kind; `ballbot.validation.ways` lists the kinds."""

    models: ModelPair

    def verdict(self) -> str:
        """Return in a sentence which model is better; empty for an analysis of reasons only."""
        return ""

    def remarks(self) -> tuple[Finding, ...]:
        """Return further findings, after the verdict."""
        return ()

    def shown(self) -> Iterator[tuple[str, ErrorPair | Trajectories | None]]:
        """Yield the contents of a page: a table of errors or a figure of states with its caption, or a sentence."""
        yield from ()

    def results(self) -> dict[str, object]:
        """Return the contents of results.json."""
        raise NotImplementedError

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the results of several logs as one."""
        return joined(parts)


def joined(parts: Sequence[Record]) -> Record:
    """Return results of one kind as one: arrays and tuples concatenated, the largest number, otherwise the first value.

    An array that one of them lacks is None.
    """
    merged: dict[str, object] = {}
    for name in (field.name for field in fields(parts[0])):
        values = [getattr(part, name) for part in parts]
        if any(value is None for value in values):
            merged[name] = None
        elif isinstance(values[0], np.ndarray):
            merged[name] = np.concatenate(values)
        elif isinstance(values[0], tuple):
            merged[name] = tuple(chain.from_iterable(values))
        elif isinstance(values[0], int | float):
            merged[name] = max(values)
        elif isinstance(values[0], ErrorPair):
            merged[name] = joined(values)
    return replace(parts[0], **merged)
