"""One axis as an experiment: simulated positions less the recorded ones over windows of records (output error).

The recorded force moves the axis through each window. Position and speed at its start are states of the window, which a
fit eliminates, so that a noisy start is no error of the friction. Their prior is the filtered record, with the position
noise and `_START_SPEED` of the record's usual speed as standard deviations.

Windows last `WINDOW`: over much shorter ones the noise of the start hides the friction, and the parameters follow what
varies within a tenth of a second; over much longer ones a single moment of sticking decides about all that follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.experiment import BlockErrors, Residuals
from ballbot.fitting.fit import Fit, fit, held_out_squares
from ballbot.fitting.model_selection import Gain, neighbours
from ballbot.fitting.parameter import Parameter, ParameterSpace
from ballbot.fitting.uncertainty import block_length
from ballbot.identification.axis.model import LAWS, PARAMETERS, Axis, AxisModel, Values
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


def window_duration(motions: Sequence[AxisMotion]) -> float:
    """Return the length of the windows of records [s]."""
    return min(WINDOW, sum(one.record.duration for one in motions) / _LEAST_WINDOWS)


def axis_experiment(model: AxisModel, motions: Sequence[AxisMotion], duration: float) -> Residuals:
    """Return the errors of a model's positions over windows of about a duration [s], end to end between gaps."""
    windows = [
        (number, a, b - a)
        for number, motion in enumerate(motions)
        for begin, end in motion.record.parts
        if end - begin >= LEAST_PART
        for a, b in pairwise(_edges(begin, end - 1, duration / motion.record.sample_time))
    ]
    log, first, count = np.array(windows, dtype=np.int64).T.copy()
    starts, compared, measured = [], [], []
    for number, a, rows in windows:
        motion, record = motions[number], motions[number].record
        filtered = float(motion.position[a]), float(motion.speed[a])
        starts.append(filtered if a else (float(record.position[0]), speed_at_start(record)))
        every = max(1, round(_COMPARED_EVERY / record.sample_time))
        compared.append(np.arange(min(every, rows), rows + 1, every))
        measured.append(record.position[a + compared[-1]])
    # of a start's position and speed, the first at least of rounding
    deviations = [
        (max(one.noise, 1e-9 * float(np.ptp(one.record.position))), _START_SPEED * one.usual_speed)
        for one in motions
    ]
    start, sizes = np.array(starts), np.array(deviations)[log]

    def errors(
        values: NDArray[np.float64], states: NDArray[np.float64], blocks: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return simulated less recorded positions, starts moved by so many standard deviations."""
        named = dict(zip(model.names, values.tolist(), strict=True))
        axis, begin, positions = model.axis(named), start[blocks] + states * sizes[blocks], []
        for number, motion in enumerate(motions):
            own, record, force = log[blocks] == number, motion.record, motion.record.force
            if delay := named.get("delay"):
                force = np.interp(record.t - delay, record.t, force)
            rows = first[blocks[own]], count[blocks[own]], begin[own]
            positions.append(axis.windows(force, record.sample_time, *rows)[:, 0])
        before = np.cumsum(count[blocks]) - count[blocks] - 1
        rows = np.concatenate([compared[one] + row for one, row in zip(blocks, before, strict=True)])
        return np.concatenate(positions)[rows] - np.concatenate([measured[one] for one in blocks])

    return Residuals(
        coordinates=ParameterSpace(parameters=_parameters(model, motions)),
        errors_of=errors,
        block=np.repeat(np.arange(len(log)), [len(one) for one in measured]),
        block_log=log,
        state_steps=_START_STEPS,
        state_weight=sizes[:, 0],
    )


def _parameters(model: AxisModel, motions: Sequence[AxisMotion]) -> tuple[Parameter, ...]:
    """Return the parameters with the bounds that the records' largest force, speed and acceleration set."""
    largest = [
        [float(np.abs(values).max()) for values in (one.record.force, one.speed, one.acceleration)]
        for one in motions
    ]
    force, speed, acceleration = np.max(largest, axis=0).tolist()
    sizes = {"kg": force / acceleration, "N s/m": force / speed, "N": force, "m/s": speed}
    return tuple(
        replace(
            one, bounds=(sizes.get(one.unit, 1.0) * one.bounds[0], sizes.get(one.unit, 1.0) * one.bounds[1])
        )
        for one in (PARAMETERS[name] for name in model.names)
    )


def _edges(first: int, last: int, length: float) -> list[int]:
    """Return the rows from the first to the last that part windows of about a length."""
    count = max(1, round((last - first) / length))
    return list(dict.fromkeys(np.linspace(first, last, count + 1).astype(int).tolist()))


@dataclass(frozen=True, kw_only=True)
class AxisErrors:
    """How well parameters predict a record."""

    window_rmse: float  #: of the position over windows from their best starts [m]
    open_loop_rmse: float  #: of the position over the whole record, from its start [m]; NaN if it has gaps


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisEstimate:
    """A model's parameters, fitted to windows."""

    model: AxisModel
    motions: tuple[AxisMotion, ...]  #: of the records
    experiment: Residuals
    found: Fit[BlockErrors]
    standard_errors: dict[str, float]  #: by name, clustered by window; NaN for a parameter at a bound
    errors: dict[str, AxisErrors] = field(default_factory=dict)  #: by record: those fitted, then others
    gain: Gain | None = None  #: on held-out blocks over the simpler law

    @cached_property
    def values(self) -> dict[str, float]:
        """The parameters by name, SI units."""
        return dict(zip(self.model.names, self.found.values.tolist(), strict=True))

    @property
    def rms(self) -> float:
        """Root mean square error of the positions [m]."""
        return float(np.sqrt(np.mean(self.found.finished.end.errors**2)))

    @cached_property
    def held_out(self) -> NDArray[np.float64]:
        """The mean square errors [m^2] of windows (w,), by fits without the third of the blocks with them."""
        end = self.found.finished.end
        return held_out_squares(self.experiment, end, blocks_of(len(end.states)), folds=_FOLDS)

    @property
    def half_widths(self) -> dict[str, float]:
        """Half widths of the 95 % intervals, by name."""
        return {name: self.found.quantile * error for name, error in self.standard_errors.items()}

    def axis(self) -> Axis:
        """Return the axis."""
        return self.model.axis(self.values)

    def on(self, motion: AxisMotion, duration: float) -> AxisErrors:
        """Return how well it predicts a record over windows of a duration [s], and whole."""
        record, windows = motion.record, axis_experiment(self.model, [motion], duration)
        end = windows.begin(windows.coordinates.scaled(self.found.values))
        whole = np.nan
        if len(record.parts) == 1:
            whole = np.sqrt(np.mean(open_loop_error(self.axis(), record) ** 2))
        return AxisErrors(window_rmse=float(np.sqrt(np.mean(end.errors**2))), open_loop_rmse=float(whole))

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        halves = self.half_widths
        return {
            "parameters": self.values,
            "standard_errors": self.standard_errors,
            "intervals_95": {name: [v - halves[name], v + halves[name]] for name, v in self.values.items()},
            "errors": self.errors,
            "simpler": LAWS[self.model.law][1],
            "gain": self.gain.to_dict() if self.gain else None,
        }


def open_loop_error(axis: Axis, record: AxisRecord) -> NDArray[np.float64]:
    """Return the error [m] of the position (N - 1,) after each row, moved by the force from the first row on."""
    start = np.array([[record.position[0], speed_at_start(record)]])
    rows = np.array([0]), np.array([len(record) - 1])
    return axis.windows(record.force, record.sample_time, *rows, start)[:, 0] - record.position[1:]


def fit_axis(model: AxisModel, motions: Sequence[AxisMotion], start: Values) -> AxisEstimate:
    """Fit a model from parameters by name.

    InputError if the simulation diverges there.
    """
    experiment = axis_experiment(model, motions, window_duration(motions))
    point = experiment.coordinates.scaled(np.array([start[name] for name in model.names]))
    if not np.isfinite(experiment.costs(point[None])).all():
        raise InputError(
            "The simulation of the axis diverges over windows of the record; check the unit of the force."
        )
    found = fit(experiment, point)
    errors = dict(zip(model.names, found.errors.tolist(), strict=True))
    return AxisEstimate(
        model=model, motions=tuple(motions), experiment=experiment, found=found, standard_errors=errors
    )


def blocks_of(windows: int) -> list[NDArray[np.int64]]:
    """Return the windows of each block of time: neighbours, which are held out and drawn together."""
    size = max(1, min(block_length(windows), windows // _BLOCKS))
    return neighbours(range(windows), block=size)
