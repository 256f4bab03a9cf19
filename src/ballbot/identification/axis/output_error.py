"""Output error: the parameters whose simulated positions come closest to the recorded ones over windows of records.

The recorded force moves the axis through each window. The state at its start is estimated with the parameters, by a
linear correction of the filtered record's position and speed there: from the window's errors and their derivatives, the
part that another start would explain is projected out (variable projection: G. Golub and V. Pereyra, Inverse Problems
19 (2003) R1-R26; derivatives as L. Kaufman, BIT 15 (1975) 49-57), so that a noisy start is no error of the friction.
The prior standard deviations are the position noise, and `_START_SPEED` of the record's usual speed. The starts are
then moved by their estimates and the descent is repeated, as an axis that sticks is far from linear.

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
from ballbot.fitting.least_squares import Stopping, minimize_squares
from ballbot.fitting.model_selection import Gain
from ballbot.fitting.uncertainty import block_length, correlation, covariance, leverage_corrected
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
#: half the central difference, in the scaled parameter: wide enough to average over single events of sticking
_DIFFERENCE = 5e-4
_MOST_STEPS, _HELD_OUT_STEPS = 30, 8
#: the descent ends where a step lowers the sum of squares by less than this share
_ENOUGH = 1e-4
#: it starts at least this far inside the bounds; a parameter that ends closer to one than `_AT_BOUND` is at it
_INSIDE, _AT_BOUND = 1e-3, 1e-6
#: positions are compared this often [s]
_COMPARED_EVERY = 0.01
#: standard deviation of the start's speed, as a share of the usual one
_START_SPEED = 0.2
#: steps of the finite differences by a start's position and speed, in their standard deviations
_START_STEPS = np.diag([10.0, 0.05])
#: rounds of better starts
_ROUNDS = 3


def window_duration(records: Sequence[AxisRecord]) -> float:
    """Return the length of the windows of records [s]."""
    return min(WINDOW, sum(record.duration for record in records) / _LEAST_WINDOWS)


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputError:
    """Position errors [m] of a model over w windows, one record's after another's."""

    model: AxisModel
    motions: tuple[AxisMotion, ...]  #: of the records
    record: NDArray[np.int64]  #: (w,) which of them each window is in
    firsts: NDArray[np.int64]  #: (w,) the row that it begins at
    counts: NDArray[np.int64]  #: (w,) rows that it runs over
    starts: NDArray[np.float64]  #: (w, 2) position and speed there

    @staticmethod
    def of(model: AxisModel, motions: Sequence[AxisMotion], duration: float) -> OutputError:
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
        return OutputError(
            model=model,
            motions=tuple(motions),
            record=which,
            firsts=firsts,
            counts=counts,
            starts=np.array(starts),
        )

    @property
    def count(self) -> int:
        """How many windows there are."""
        return len(self.firsts)

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
        window = np.repeat(np.arange(self.count), [len(one) for one in places])
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

    def errors(self, values: Values, *, moved: NDArray[np.float64] | float = 0.0) -> NDArray[np.float64]:
        """Return simulated minus recorded positions (m,), all starts `moved` (2,) by so many standard deviations."""
        axis, starts, positions = self.model.axis(values), self.starts + moved * self.sizes, []
        for number, motion in enumerate(self.motions):
            own, record = self.record == number, motion.record
            windows = self.firsts[own], self.counts[own], starts[own]
            positions.append(axis.windows(record.force, record.sample_time, *windows)[:, 0])
        places, measured, _ = self._compared
        return np.concatenate(positions)[places] - measured

    def begun(self, values: Values) -> Begun:
        """Return the errors at these values and the effect of other starts."""
        middle, noise = self.errors(values), self.sizes[self.window, 0]
        changes = [(self.errors(values, moved=step) - middle) / step.sum() for step in _START_STEPS]
        S = np.column_stack(changes) / noise[:, None]
        begins = np.flatnonzero(np.diff(self.window, prepend=-1))
        gram = np.add.reduceat(S[:, :, None] * S[:, None, :], begins, axis=0)
        inverse = np.asarray(np.linalg.inv(gram + np.eye(2)), dtype=np.float64)
        return Begun(errors=middle, slopes=S, inverse=inverse, window=self.window, begins=begins, noise=noise)

    def from_better_starts(self, values: Values) -> OutputError:
        """Return the same with the starts of its windows estimated from their errors."""
        begun = self.begun(values)
        return replace(self, starts=self.starts - begun.shifts(begun.errors) * self.sizes)

    @np.errstate(over="ignore", invalid="ignore")  # the error of a simulation that diverges is infinite
    def squares(self, values: Values) -> NDArray[np.float64]:
        """Return the mean square error [m^2] of each window (w,) from its best start."""
        tables = []
        for one in (self, self.from_better_starts(values)):
            begun = one.begun(values)
            tables.append(np.add.reduceat(begun.project(begun.errors) ** 2, begun.begins))
        return np.nan_to_num(np.fmin(*tables) / np.bincount(self.window), nan=np.inf)

    def only(self, kept: NDArray[np.bool_]) -> OutputError:
        """Return the errors over some of the windows (w,)."""
        return replace(
            self,
            record=self.record[kept],
            firsts=self.firsts[kept],
            counts=self.counts[kept],
            starts=self.starts[kept],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Begun:
    """Errors (m,) and how they depend on the starts of windows."""

    errors: NDArray[np.float64]  #: (m,) [m]
    slopes: NDArray[np.float64]  #: S (m, 2), by a standard deviation of the start's position and speed
    inverse: NDArray[np.float64]  #: (I + S^T S)^-1 of each window (w, 2, 2)
    window: NDArray[np.int64]  #: (m,)
    begins: NDArray[np.intp]  #: (w,)
    noise: NDArray[np.float64]  #: (m,) [m]

    def shifts(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far off the starts are (w, 2) by errors (m,), in their standard deviations."""
        scores = np.add.reduceat(self.slopes * (errors / self.noise)[:, None], self.begins, axis=0)
        return np.einsum("wij,wj->wi", self.inverse, scores)

    def project(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return errors (m,), or derivatives of them, without the part that other starts explain."""
        explained = np.einsum("mi,mi->m", self.slopes, self.shifts(errors)[self.window])
        return errors - self.noise * explained


@dataclass(frozen=True, kw_only=True)
class AxisErrors:
    """How well parameters predict a record."""

    record: str
    window_rmse: float  #: of the position over windows from their best starts [m]
    open_loop_rmse: float  #: of the position over the whole record, from its start [m]; NaN if it has gaps


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisEstimate:
    """A model's parameters, estimated by output error."""

    problem: OutputError  #: with the starts estimated
    values: dict[str, float]  #: by name, SI units
    standard_errors: dict[str, float]  #: by name, clustered by window; NaN for a parameter at a bound
    correlation: NDArray[np.float64]  #: (p, p) of the parameters' errors
    residuals: NDArray[np.float64]  #: (m,) [m], of the best starts
    #: (m, p) derivatives of the residuals, projected; zero for a parameter at a bound
    slopes: NDArray[np.float64]
    errors: tuple[AxisErrors, ...] = ()  #: on the records fitted, then on the others
    gain: Gain | None = None  #: on held-out blocks over the simpler law

    @property
    def model(self) -> AxisModel:
        """What was estimated."""
        return self.problem.model

    @property
    def law(self) -> str:
        """Its friction law."""
        return self.model.law

    @property
    def rms(self) -> float:
        """Root mean square error of the positions [m]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def half_widths(self) -> dict[str, float]:
        """Half widths of the 95 % intervals, by name."""
        quantile = float(scipy.stats.t.ppf(0.975, max(1, self.problem.count - len(self.values))))
        return {name: quantile * error for name, error in self.standard_errors.items()}

    def axis(self) -> Axis:
        """Return the axis."""
        return self.model.axis(self.values)

    def on(self, motion: AxisMotion, duration: float) -> AxisErrors:
        """Return how well it predicts a record over windows of a duration [s], and whole."""
        record, problem = motion.record, OutputError.of(self.model, [motion], duration)
        squares, counts = problem.squares(self.values), np.bincount(problem.window)
        whole = (
            np.sqrt(np.mean(open_loop_error(self.axis(), record) ** 2)) if len(record.parts) == 1 else np.nan
        )
        return AxisErrors(
            record=record.name,
            window_rmse=float(np.sqrt(np.sum(squares * counts) / counts.sum())),
            open_loop_rmse=float(whole),
        )

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        halves = self.half_widths
        return {
            "parameters": self.values,
            "standard_errors": self.standard_errors,
            "intervals_95": {
                name: [one - halves[name], one + halves[name]] for name, one in self.values.items()
            },
            "errors": {
                one.record: {"window_rmse": one.window_rmse, "open_loop_rmse": one.open_loop_rmse}
                for one in self.errors
            },
            "simpler": LAWS[self.law][1],
            "gain": self.gain.to_dict() if self.gain else None,
        }


def open_loop_error(axis: Axis, record: AxisRecord) -> NDArray[np.float64]:
    """Return the error [m] of the position (N - 1,) after each row, moved by the force from the first row on."""
    start = np.array([[record.position[0], speed_at_start(record)]])
    rows = np.array([0]), np.array([len(record) - 1])
    return axis.windows(record.force, record.sample_time, *rows, start)[:, 0] - record.position[1:]


# a trial step may diverge: its cost is not finite; it is refused
@np.errstate(over="ignore", invalid="ignore")
def _descended(problem: OutputError, start: Values, most_steps: int) -> AxisEstimate:
    model, space = problem.model, problem.model.space(start)
    lower, upper = space.bounds()
    scale = max(float(np.ptp(one.record.position)) for one in problem.motions) * 1e-3
    last: dict[bytes, Begun] = {}

    def at(z: NDArray[np.float64]) -> dict[str, float]:
        return model.by_name(space.physical(z))

    def begun(z: NDArray[np.float64]) -> Begun:
        if z.tobytes() not in last:
            last.clear()
            last[z.tobytes()] = problem.begun(at(z))
        return last[z.tobytes()]

    def errors(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return begun(z).project(begun(z).errors) / scale

    def slopes(z: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = []
        for step in _DIFFERENCE * np.eye(len(z)):
            ahead, behind = np.minimum(z + step, upper), np.maximum(z - step, lower)
            change = problem.errors(at(ahead)) - problem.errors(at(behind))
            columns.append(begun(z).project(change) / (ahead - behind).sum() / scale)
        return np.column_stack(columns)

    first = space.scaled(np.array([start[name] for name in model.names]))
    found = minimize_squares(
        errors,
        np.clip(first, lower + _INSIDE, upper - _INSIDE),
        jacobian_of=slopes,
        bounds=(lower, upper),
        scale="jac",
        stopping=Stopping(most_evaluations=most_steps, least_gain=_ENOUGH, least_step=1e-5),
    )
    z, J = found.point, found.jacobian * scale
    kept = (z - lower > _AT_BOUND) & (upper - z > _AT_BOUND) & (np.linalg.norm(J, axis=0) > 0.0)
    J, residuals = J * kept, errors(z) * scale
    begins = begun(z).begins
    matrices = np.add.reduceat(J[:, :, None] * J[:, None, :], begins, axis=0)
    scores = np.add.reduceat(J * residuals[:, None], begins, axis=0)
    # an axis passes its slow speeds in a few windows, which a fit follows closely
    C = covariance(leverage_corrected(matrices, scores, kept), kept)
    return AxisEstimate(
        problem=problem,
        values=at(z),
        standard_errors=model.by_name(np.sqrt(C.diagonal()) * space.slopes(z)),
        correlation=correlation(C),
        residuals=residuals,
        slopes=J / space.slopes(z),
    )


def fit_output_error(problem: OutputError, start: Values) -> AxisEstimate:
    """Descend from `start`, and again from better starts of the windows as long as the error falls by a percent."""
    fit = _descended(problem, start, _MOST_STEPS)
    for _ in range(_ROUNDS - 1):
        again = _descended(fit.problem.from_better_starts(fit.values), fit.values, _MOST_STEPS)
        if not again.rms < 0.99 * fit.rms:
            break
        fit = again
    if not np.isfinite(fit.rms):
        raise InputError(
            "The simulation of the axis diverges over windows of the record; check the unit of the force."
        )
    return fit


def blocks_of(windows: int) -> list[NDArray[np.int64]]:
    """Return the windows of each block of time: neighbours, which are held out and drawn together."""
    size = max(1, min(block_length(windows), windows // _BLOCKS))
    return [np.arange(first, min(first + size, windows)) for first in range(0, windows, size)]


def held_out_squares(fit: AxisEstimate) -> NDArray[np.float64]:
    """Fit again without each third of the blocks of time; return the mean square errors [m^2] there (w,)."""
    squares, blocks = np.empty(fit.problem.count), blocks_of(fit.problem.count)
    for fold in range(_FOLDS):
        out = np.zeros(len(squares), dtype=bool)
        out[np.concatenate(blocks[fold::_FOLDS])] = True
        again = _descended(fit.problem.only(~out), fit.values, _HELD_OUT_STEPS)
        squares[out] = fit.problem.only(out).squares(again.values)
    return squares
