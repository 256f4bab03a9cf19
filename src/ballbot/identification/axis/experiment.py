"""One axis as an experiment: simulated positions less the recorded ones over windows of records (output error).

The recorded force moves the axis through each window. Position and speed at its start are states of the window, which a
fit eliminates, so that a noisy start is no error of the friction. Their prior is the filtered record, with the position
noise and `_START_SPEED` of the record's usual speed as standard deviations.

Windows last `WINDOW`: over much shorter ones the noise of the start hides the friction, and the parameters follow what
varies within a tenth of a second; over much longer ones a single moment of sticking decides about all that follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.experiment import BlockErrors, ByDifferences
from ballbot.fitting.fit import Fit, fit, held_out_squares
from ballbot.fitting.model_selection import Gain, neighbours
from ballbot.fitting.uncertainty import block_length, correlation
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
#: positions are compared this often [s]
_COMPARED_EVERY = 0.01
#: standard deviation of the start's speed, as a share of the usual one
_START_SPEED = 0.2
#: steps of the finite differences by a start's position and speed, in their standard deviations
_START_STEPS = np.array([10.0, 0.05])


def window_duration(records: Sequence[AxisRecord]) -> float:
    """Return the length of the windows of records [s]."""
    return min(WINDOW, sum(record.duration for record in records) / _LEAST_WINDOWS)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisExperiment(ByDifferences):
    """Position errors of a model over w windows, one record's after another's; states are position and speed there."""

    model: AxisModel
    motions: tuple[AxisMotion, ...]  #: of the records
    firsts: NDArray[np.int64]  #: (w,) the row that each window begins at
    counts: NDArray[np.int64]  #: (w,) rows that it runs over
    starts: NDArray[np.float64]  #: (w, 2) position and speed there
    sizes: NDArray[np.float64]  #: (w, 2) their standard deviations: at least of rounding
    compared: NDArray[np.int64]  #: (m,) which of the positions at rows' ends are compared
    measured: NDArray[np.float64]  #: (m,) with what [m]

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
        return _of_windows(model, motions, np.array(rows, dtype=np.int64), np.array(starts))

    def part(self, blocks: NDArray[np.int64]) -> AxisExperiment:
        """Return the experiment of some of the windows."""
        rows = np.column_stack([self.block_log, self.firsts, self.counts])[blocks]
        return _of_windows(self.model, self.motions, rows, self.starts[blocks])

    def scaled(self, values: Values) -> NDArray[np.float64]:
        """Return scaled parameters (p,) from those by name, brought within their bounds."""
        return self.coordinates.scaled(np.array([values[name] for name in self.model.names]))

    # the error of a simulation that diverges is infinite; such a step is refused
    @np.errstate(over="ignore", invalid="ignore")
    def errors(self, values: NDArray[np.float64], states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return simulated less recorded positions (m,), starts moved (w, 2) by so many standard deviations."""
        named = dict(zip(self.model.names, values.tolist(), strict=True))
        axis, starts, positions = self.model.axis(named), self.starts + states * self.sizes, []
        for number, motion in enumerate(self.motions):
            own, record, force = self.block_log == number, motion.record, motion.record.force
            if delay := named.get("delay"):
                force = np.interp(record.t - delay, record.t, force)
            windows = self.firsts[own], self.counts[own], starts[own]
            positions.append(axis.windows(force, record.sample_time, *windows)[:, 0])
        return np.concatenate(positions)[self.compared] - self.measured


def _of_windows(
    model: AxisModel, motions: Sequence[AxisMotion], rows: NDArray[np.int64], starts: NDArray[np.float64]
) -> AxisExperiment:
    """Return the experiment of windows: record, first row and count (w, 3), and position and speed there (w, 2)."""
    force, speed, acceleration = (
        max(float(np.abs(values(one)).max()) for one in motions)
        for values in (lambda one: one.record.force, lambda one: one.speed, lambda one: one.acceleration)
    )
    places, measured, block, begin = [], [], [], 0
    for window, (number, first, count) in enumerate(rows.tolist()):
        record = motions[number].record
        every = max(1, round(_COMPARED_EVERY / record.sample_time))
        steps = np.arange(min(every, count), count + 1, every)
        places.append(begin + steps - 1)
        measured.append(record.position[first + steps])
        block.append(np.full(len(steps), window))
        begin += count
    of_record = [
        (max(one.noise, 1e-9 * float(np.ptp(one.record.position))), _START_SPEED * one.usual_speed)
        for one in motions
    ]
    sizes = np.array(of_record)[rows[:, 0]]
    which, firsts, counts = rows.T.copy()
    return AxisExperiment(
        parameters=model.parameters(force=force, speed=speed, acceleration=acceleration),
        block=np.concatenate(block),
        block_log=which,
        state_steps=_START_STEPS,
        state_weight=sizes[:, 0],
        model=model,
        motions=tuple(motions),
        firsts=firsts,
        counts=counts,
        starts=starts,
        sizes=sizes,
        compared=np.concatenate(places),
        measured=np.concatenate(measured),
    )


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
    found: Fit[BlockErrors]
    standard_errors: dict[str, float]  #: by name, clustered by window; NaN for a parameter at a bound
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
    def end(self) -> BlockErrors:
        """Where the fit ended."""
        return self.found.finished.end

    @cached_property
    def values(self) -> dict[str, float]:
        """The parameters by name, SI units."""
        return dict(zip(self.model.names, self.found.values.tolist(), strict=True))

    @property
    def correlation(self) -> NDArray[np.float64]:
        """Of the parameters' errors (p, p)."""
        return correlation(self.found.scaled_covariance)

    @property
    def rms(self) -> float:
        """Root mean square error of the positions [m]."""
        return float(np.sqrt(np.mean(self.end.errors**2)))

    def held_out(self) -> NDArray[np.float64]:
        """Return the mean square errors [m^2] of windows (w,), by fits without the third of the blocks with them."""
        return held_out_squares(self.experiment, self.end, blocks_of(len(self.end.states)), folds=_FOLDS)

    @property
    def half_widths(self) -> dict[str, float]:
        """Half widths of the 95 % intervals, by name."""
        return {name: self.found.quantile * error for name, error in self.standard_errors.items()}

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
    found = fit(experiment, point)
    errors = dict(zip(experiment.model.names, found.errors.tolist(), strict=True))
    return AxisEstimate(experiment=experiment, found=found, standard_errors=errors)


def blocks_of(windows: int) -> list[NDArray[np.int64]]:
    """Return the windows of each block of time: neighbours, which are held out and drawn together."""
    size = max(1, min(block_length(windows), windows // _BLOCKS))
    return neighbours(range(windows), block=size)
