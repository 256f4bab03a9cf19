"""One axis as an experiment: simulated positions less the recorded ones over windows of records (output error).

The recorded force moves the axis through each window. Position and speed at its start are states of the window, which a
fit eliminates, so that a noisy start is no error of the friction. Their prior is the filtered record, with the position
noise and `_START_SPEED` of the record's usual speed as standard deviations.

Windows last `WINDOW`: over much shorter ones the noise of the start hides the friction, and the parameters follow what
varies within a tenth of a second; over much longer ones a single moment of sticking decides about all that follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.experiment import Dependence, Linearized
from ballbot.fitting.fit import descend, fit
from ballbot.fitting.model_selection import Gain, neighbours
from ballbot.fitting.parameter import ParameterSpace
from ballbot.fitting.uncertainty import (
    WindowEquations,
    block_length,
    correlation,
    covariance,
    leverage_corrected,
)
from ballbot.identification.axis.model import LAWS, Axis, AxisModel, Values
from ballbot.identification.axis.motion import LEAST_PART, AxisMotion, speed_at_start
from ballbot.identification.axis.record import AxisRecord

#: length of a window [s], shorter where records are so short that there would be fewer than `_LEAST_WINDOWS`
WINDOW = 1.0
#: with six parameters, the least that give a covariance from windows some meaning
_LEAST_WINDOWS = 9
#: blocks of time are held out and drawn together; there are about as many
_BLOCKS = 12
_FOLDS = 3
#: half the central difference, as a share of the value, at least of this share of the parameter's range: wide enough to
#: average over single events of sticking
_DIFFERENCE, _OF_RANGE = 5e-4, 1e-3
_MOST_STEPS, _HELD_OUT_STEPS = 30, 8
#: positions are compared this often [s]
_COMPARED_EVERY = 0.01
#: standard deviation of the start's speed, as a share of the usual one
_START_SPEED = 0.2
#: steps of the finite differences by a start's position and speed, in their standard deviations
_START_STEPS = np.diag([10.0, 0.05])
#: starts are settled at new parameters in so many steps; one that does not help is tried again over this share of it
_SETTLED, _SHORTER = 3, 0.3


def window_duration(records: Sequence[AxisRecord]) -> float:
    """Return the length of the windows of records [s]."""
    return min(WINDOW, sum(record.duration for record in records) / _LEAST_WINDOWS)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisPoint:
    """Parameters and starts."""

    point: NDArray[np.float64]  #: (p,), scaled
    moved: NDArray[
        np.float64
    ]  #: (w, 2), starts less those of the filtered record, in their standard deviations
    errors: NDArray[np.float64]  #: (m,) positions, simulated less recorded [m]
    squares: NDArray[np.float64]  #: (w,) of each window, its start's deviation included [m^2]
    cost: float  #: half the logarithm of the mean square, starts' included


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisExperiment:
    """Position errors of a model over w windows, one record's after another's."""

    model: AxisModel
    motions: tuple[AxisMotion, ...]  #: of the records
    record: NDArray[np.int64]  #: (w,) which of them each window is in
    firsts: NDArray[np.int64]  #: (w,) the row that it begins at
    counts: NDArray[np.int64]  #: (w,) rows that it runs over
    starts: NDArray[np.float64]  #: (w, 2) position and speed there

    @staticmethod
    def of(model: AxisModel, motions: Sequence[AxisMotion], duration: float) -> AxisExperiment:
        """Return windows of about that duration [s], end to end in each part between gaps."""
        rows, starts = list[tuple[int, int, int]](), list[tuple[float, float]]()
        for number, motion in enumerate(motions):
            record = motion.record
            for begin, end in record.parts:
                if end - begin >= LEAST_PART:
                    count = max(1, round((end - 1 - begin) * record.sample_time / duration))
                    edges = np.linspace(begin, end - 1, count + 1).astype(int).tolist()
                    rows += [(number, a, b - a) for a, b in pairwise(edges) if b > a]
        for number, first, _ in rows:
            motion, record = motions[number], motions[number].record
            filtered = float(motion.position[first]), float(motion.speed[first])
            starts.append(filtered if first else (float(record.position[0]), speed_at_start(record)))
        which, firsts, counts = np.array(rows, dtype=np.int64).T.copy()
        return AxisExperiment(
            model=model,
            motions=tuple(motions),
            record=which,
            firsts=firsts,
            counts=counts,
            starts=np.array(starts),
        )

    @property
    def block_log(self) -> NDArray[np.int64]:
        """Which record each window is of (w,)."""
        return self.record

    @property
    def dependences(self) -> Sequence[Dependence]:
        """None: a law with parameters that the record does not determine is not selected."""
        return ()

    @property
    def residual_count(self) -> int:
        """How many positions are compared."""
        return len(self.window)

    @property
    def coordinates(self) -> ParameterSpace:
        """The parameters, within bounds that the largest force, speed and acceleration set."""
        return self._coordinates

    @cached_property
    def _coordinates(self) -> ParameterSpace:
        force, speed, acceleration = (
            max(float(np.abs(values(one)).max()) for one in self.motions)
            for values in (lambda one: one.record.force, lambda one: one.speed, lambda one: one.acceleration)
        )
        return self.model.space(force=force, speed=speed, acceleration=acceleration)

    @cached_property
    def _compared(self) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Which of the positions at rows' ends are compared (m,), with what [m], and the window of each."""
        places, measured, begin = [], [], 0
        for number, first, count in zip(self.record, self.firsts, self.counts, strict=True):
            record = self.motions[number].record
            every = max(1, round(_COMPARED_EVERY / record.sample_time))
            steps = np.arange(min(every, count), count + 1, every)
            places.append(begin + steps - 1)
            measured.append(record.position[first + steps])
            begin += count
        window = np.repeat(np.arange(len(places)), [len(one) for one in places])
        return np.concatenate(places), np.concatenate(measured), window

    @property
    def window(self) -> NDArray[np.int64]:
        """The window of each error (m,)."""
        return self._compared[2]

    @cached_property
    def sizes(self) -> NDArray[np.float64]:
        """Standard deviations of each start (w, 2): of its position, at least of rounding, and of its speed."""
        of_record = [
            (max(one.noise, 1e-9 * float(np.ptp(one.record.position))), _START_SPEED * one.usual_speed)
            for one in self.motions
        ]
        return np.array(of_record)[self.record]

    def part(self, blocks: NDArray[np.int64]) -> AxisExperiment:
        """Return the experiment of some of the windows."""
        return replace(
            self,
            record=self.record[blocks],
            firsts=self.firsts[blocks],
            counts=self.counts[blocks],
            starts=self.starts[blocks],
        )

    def values(self, point: NDArray[np.float64]) -> dict[str, float]:
        """Return parameters by name from scaled ones (p,)."""
        return dict(zip(self.model.names, self.coordinates.physical(point).tolist(), strict=True))

    def scaled(self, values: Values) -> NDArray[np.float64]:
        """Return scaled parameters (p,) from those by name, brought within their bounds."""
        return self.coordinates.scaled(np.array([values[name] for name in self.model.names]))

    # the error of a simulation that diverges is infinite; such a step is refused
    @np.errstate(over="ignore", invalid="ignore")
    def errors(self, values: Values, moved: NDArray[np.float64] | float = 0.0) -> NDArray[np.float64]:
        """Return simulated less recorded positions (m,), starts `moved` (w, 2) by so many standard deviations."""
        axis, starts, positions = self.model.axis(values), self.starts + moved * self.sizes, []
        for number, motion in enumerate(self.motions):
            own, record, force = self.record == number, motion.record, motion.record.force
            if delay := values.get("delay"):
                force = np.interp(record.t - delay, record.t, force)
            windows = self.firsts[own], self.counts[own], starts[own]
            positions.append(axis.windows(force, record.sample_time, *windows)[:, 0])
        places, measured, _ = self._compared
        return np.concatenate(positions)[places] - measured

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the costs (sets,) at points (sets, p), starts as in the filtered record."""
        return np.array([self._at(point, np.zeros_like(self.starts)).cost for point in points])

    def _at(self, point: NDArray[np.float64], moved: NDArray[np.float64]) -> AxisPoint:
        return self._with(point, moved, self.errors(self.values(point), moved))

    @np.errstate(over="ignore", invalid="ignore")
    def _with(
        self, point: NDArray[np.float64], moved: NDArray[np.float64], errors: NDArray[np.float64]
    ) -> AxisPoint:
        squares = np.bincount(self.window, errors**2) + np.sum((self.sizes[:, :1] * moved) ** 2, axis=1)
        mean = float(squares.sum()) / len(errors)
        cost = 0.5 * np.log(max(mean, 1e-300)) if np.isfinite(mean) else np.inf
        return AxisPoint(point=point, moved=moved, errors=errors, squares=squares, cost=float(cost))

    def begin(self, point: NDArray[np.float64], near: AxisPoint | None = None) -> AxisPoint:
        """Return where a descent begins, with the best starts."""
        return self._settled(self._at(point, np.zeros_like(self.starts) if near is None else near.moved))

    def _settled(self, at: AxisPoint) -> AxisPoint:
        """Return the point with the best start of each window, by steps that are shorter where one did not help."""
        share = np.ones((len(self.starts), 1))
        for _ in range(_SETTLED if np.isfinite(at.cost) else 0):
            shift = self._linearized(at, np.zeros((len(at.errors), 0))).shift
            after = self._at(at.point, at.moved + share * shift)
            better = after.squares < at.squares
            moved = np.where(better[:, None], after.moved, at.moved)
            at = self._with(at.point, moved, np.where(better[self.window], after.errors, at.errors))
            share = np.where(better[:, None], 1.0, _SHORTER * share)
        return at

    def advance(self, at: AxisPoint, about: Linearized, step: NDArray[np.float64]) -> AxisPoint:
        """Return the iterate a step (p,) on, its starts settled anew."""
        return self._settled(self._at(at.point + step, at.moved + about.shift + about.response @ step))

    def renew(self, at: AxisPoint, *, seed: int) -> AxisPoint:  # noqa: ARG002 (no start has several minima)
        """Return the same point."""
        return at

    def linearize(self, at: AxisPoint) -> Linearized:
        """Return the equations about an iterate."""
        values, coordinates, columns = self.values(at.point), self.coordinates, []
        for place, slope in enumerate(coordinates.slopes(at.point)):
            name, lower, upper = self.model.names[place], coordinates.lower[place], coordinates.upper[place]
            half = _DIFFERENCE * max(abs(values[name]), _OF_RANGE * (upper - lower))
            ahead, behind = min(values[name] + half, upper), max(values[name] - half, lower)
            change = self.errors({**values, name: ahead}, at.moved) - self.errors(
                {**values, name: behind}, at.moved
            )
            columns.append(slope * change / (ahead - behind))
        return self._linearized(at, np.column_stack(columns))

    def _linearized(self, at: AxisPoint, J: NDArray[np.float64]) -> Linearized:
        """Return the equations with derivatives J (m, p) by the parameters."""
        values, weight = self.values(at.point), np.exp(-2.0 * at.cost)
        changes = [(self.errors(values, at.moved + step) - at.errors) / step.sum() for step in _START_STEPS]
        S, begins = np.column_stack(changes), np.flatnonzero(np.diff(self.window, prepend=-1))

        def sums(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
            return weight * np.add.reduceat(left[:, :, None] * right[:, None, :], begins, axis=0)

        errors, prior = at.errors[:, None], weight * self.sizes[:, :1] ** 2
        return Linearized(
            H=sums(J, J),
            B=sums(S, J),
            A=sums(S, S) + prior[..., None] * np.eye(2),
            g=sums(J, errors)[..., 0],
            a=sums(S, errors)[..., 0] + prior * at.moved,
        )

    def equations(self, at: AxisPoint) -> WindowEquations:
        """Return each window's equations, its start eliminated."""
        return self.linearize(at).equations

    def mean_squares(self, at: AxisPoint) -> NDArray[np.float64]:
        """Return the mean square error [m^2] of each window (w,)."""
        squares = np.bincount(self.window, at.errors**2) / np.bincount(self.window)
        return np.nan_to_num(squares, nan=np.inf)


@dataclass(frozen=True, kw_only=True)
class AxisErrors:
    """How well parameters predict a record."""

    record: str
    window_rmse: float  #: of the position over windows from their best starts [m]
    open_loop_rmse: float  #: of the position over the whole record, from its start [m]; NaN if it has gaps


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisEstimate:
    """A model's parameters, fitted to windows."""

    experiment: AxisExperiment
    end: AxisPoint
    values: dict[str, float]  #: by name, SI units
    standard_errors: dict[str, float]  #: by name, clustered by window; NaN for a parameter at a bound
    correlation: NDArray[np.float64]  #: (p, p) of the parameters' errors
    errors: tuple[AxisErrors, ...] = ()  #: on the records fitted, then on the others
    gain: Gain | None = None  #: on held-out blocks over the simpler law

    @property
    def model(self) -> AxisModel:
        """What was estimated."""
        return self.experiment.model

    @property
    def law(self) -> str:
        """Its friction law."""
        return self.model.law

    @property
    def rms(self) -> float:
        """Root mean square error of the positions [m]."""
        return float(np.sqrt(np.mean(self.end.errors**2)))

    @property
    def half_widths(self) -> dict[str, float]:
        """Half widths of the 95 % intervals, by name."""
        freedom = max(1, len(self.experiment.firsts) - len(self.values))
        quantile = float(scipy.stats.t.ppf(0.975, freedom))
        return {name: quantile * error for name, error in self.standard_errors.items()}

    def axis(self) -> Axis:
        """Return the axis."""
        return self.model.axis(self.values)

    def on(self, motion: AxisMotion, duration: float) -> AxisErrors:
        """Return how well it predicts a record over windows of a duration [s], and whole."""
        record, windows = motion.record, AxisExperiment.of(self.model, [motion], duration)
        end = windows.begin(windows.scaled(self.values))
        whole = np.nan
        if len(record.parts) == 1:
            whole = np.sqrt(np.mean(open_loop_error(self.axis(), record) ** 2))
        return AxisErrors(
            record=record.name,
            window_rmse=float(np.sqrt(np.mean(end.errors**2))),
            open_loop_rmse=float(whole),
        )

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        halves = self.half_widths
        intervals = {name: [one - halves[name], one + halves[name]] for name, one in self.values.items()}
        errors = {one.record: {k: v for k, v in vars(one).items() if k != "record"} for one in self.errors}
        return {
            "parameters": self.values,
            "standard_errors": self.standard_errors,
            "intervals_95": intervals,
            "errors": errors,
            "simpler": LAWS[self.law][1],
            "gain": self.gain.to_dict() if self.gain else None,
        }


def open_loop_error(axis: Axis, record: AxisRecord) -> NDArray[np.float64]:
    """Return the error [m] of the position (N - 1,) after each row, moved by the force from the first row on."""
    start = np.array([[record.position[0], speed_at_start(record)]])
    rows = np.array([0]), np.array([len(record) - 1])
    return axis.windows(record.force, record.sample_time, *rows, start)[:, 0] - record.position[1:]


def fit_axis(experiment: AxisExperiment, start: Values) -> AxisEstimate:
    """Fit an experiment from parameters by name.

    InputError if the simulation diverges there.
    """
    point = experiment.scaled(start)
    if not np.isfinite(experiment.costs(point[None])).all():
        raise InputError(
            "The simulation of the axis diverges over windows of the record; check the unit of the force."
        )
    found = fit(experiment, point, refused=np.zeros(len(point), dtype=bool), most_steps=_MOST_STEPS)
    end, equations = found.finished.end, found.finished.equations
    # an axis passes its slow speeds in a few windows, which a fit follows closely
    kept = found.estimated & (equations.normal.matrix.diagonal() > 0.0)
    C = covariance(leverage_corrected(equations.matrices, equations.scores, kept), kept)
    errors = np.sqrt(C.diagonal()) * experiment.coordinates.slopes(end.point)
    return AxisEstimate(
        experiment=experiment,
        end=end,
        values=experiment.values(end.point),
        standard_errors=dict(zip(experiment.model.names, errors.tolist(), strict=True)),
        correlation=correlation(C),
    )


def blocks_of(windows: int) -> list[NDArray[np.int64]]:
    """Return the windows of each block of time: neighbours, which are held out and drawn together."""
    size = max(1, min(block_length(windows), windows // _BLOCKS))
    return neighbours(range(windows), block=size)


def held_out_squares(estimate: AxisEstimate) -> NDArray[np.float64]:
    """Fit again without each third of the blocks of time; return the mean square errors [m^2] there (w,)."""
    experiment, count = estimate.experiment, len(estimate.experiment.firsts)
    squares, blocks = np.empty(count), blocks_of(count)
    for fold in range(_FOLDS):
        out = np.concatenate(blocks[fold::_FOLDS])
        kept = np.setdiff1d(np.arange(count), out)
        part, rest = (
            (experiment.part(rows), replace(estimate.end, moved=estimate.end.moved[rows]))
            for rows in (kept, out)
        )
        begin, free = part[0].begin(estimate.end.point, part[1]), experiment.coordinates.free
        again = descend(part[0], begin, free=free, most_steps=_HELD_OUT_STEPS, most_renewals=0)
        squares[out] = rest[0].mean_squares(rest[0].begin(again.point, rest[1]))
    return squares
