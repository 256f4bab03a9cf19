"""Output error: the parameters whose simulated positions come closest to the recorded ones over windows of a record.

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
from ballbot.fitting.uncertainty import block_length, correlation, covariance, leverage_corrected
from ballbot.identification.axis.model import AxisModel, Values
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
#: shares of the usual speed: standard deviation of the start's speed, and the step of its finite difference
_START_SPEED, _SPEED_DIFFERENCE = 0.2, 0.01
#: rounds of better starts
_ROUNDS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisWindows:
    """Windows of one record, and which of its rows are compared: every `_COMPARED_EVERY`, and from one row on."""

    motion: AxisMotion
    firsts: NDArray[np.int64]  #: (w,)
    counts: NDArray[np.int64]  #: (w,) rows that each runs over
    starts: NDArray[np.float64]  #: (w, 2) position and speed there

    @property
    def record(self) -> AxisRecord:
        """The record."""
        return self.motion.record

    @property
    def noise(self) -> float:
        """Standard deviation of the position's noise [m], at least that of rounding."""
        return max(self.motion.noise, 1e-9 * float(np.ptp(self.record.position)))

    @cached_property
    def compared(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Which of the positions at rows' ends are compared (m,), the rows of these, and the window of each."""
        every = max(1, round(_COMPARED_EVERY / self.record.sample_time))
        begins = np.cumsum(self.counts) - self.counts
        steps = [np.arange(min(every, count), count + 1, every) for count in self.counts.tolist()]
        step, window = np.concatenate(steps), np.repeat(np.arange(len(steps)), [len(one) for one in steps])
        return begins[window] + step - 1, self.firsts[window] + step, window

    def only(self, kept: NDArray[np.bool_]) -> AxisWindows:
        """Return some of the windows (w,)."""
        return replace(self, firsts=self.firsts[kept], counts=self.counts[kept], starts=self.starts[kept])


def windows_of(motion: AxisMotion, duration: float) -> AxisWindows:
    """Return windows of about that duration [s], end to end, in each part between gaps."""
    record, spans = motion.record, list[tuple[int, int]]()
    for begin, end in record.parts:
        if end - begin >= LEAST_PART:
            count = max(1, round((end - 1 - begin) * record.sample_time / duration))
            edges = np.linspace(begin, end - 1, count + 1).astype(int)
            spans += [(int(a), int(b)) for a, b in pairwise(edges) if b > a]
    firsts = np.array([first for first, _ in spans], dtype=np.int64)
    starts = np.column_stack([motion.position[firsts], motion.speed[firsts]])
    starts[firsts == 0] = (record.position[0], speed_at_start(record))
    return AxisWindows(
        motion=motion,
        firsts=firsts,
        counts=np.array([last - first for first, last in spans], dtype=np.int64),
        starts=starts,
    )


def window_duration(records: Sequence[AxisRecord]) -> float:
    """Return the length of the windows of records [s]."""
    return min(WINDOW, sum(record.duration for record in records) / _LEAST_WINDOWS)


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputError:
    """Position errors [m] of a model over windows of records."""

    model: AxisModel
    windows: tuple[AxisWindows, ...]  #: of each record
    late: float = 0.0  #: by how much the force acts later than its row [s]

    @cached_property
    def window(self) -> NDArray[np.int64]:
        """The window of each error (m,), counted through all records."""
        begins = np.cumsum([0, *(len(one.firsts) for one in self.windows)])
        return np.concatenate([one.compared[2] + a for one, a in zip(self.windows, begins[:-1], strict=True)])

    @property
    def count(self) -> int:
        """How many windows there are."""
        return int(self.window.max()) + 1

    @cached_property
    def _begins(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.diff(self.window, prepend=-1))

    @cached_property
    def _noise(self) -> NDArray[np.float64]:
        return np.concatenate([np.full(len(one.compared[0]), one.noise) for one in self.windows])

    def errors(self, values: Values, *, noises: float = 0.0, speeds: float = 0.0) -> NDArray[np.float64]:
        """Return simulated minus recorded positions (m,), the starts moved by shares of the noise and usual speed."""
        found, axis = [], self.model.axis(values)
        for one in self.windows:
            record = one.record
            moved = record
            if self.late:
                moved = replace(record, force=np.interp(record.t - self.late, record.t, record.force))
            places, rows, _ = one.compared
            starts = one.starts + np.array([noises * one.noise, speeds * one.motion.usual_speed])
            found.append(axis.windows(moved, one.firsts, one.counts, starts)[places] - record.position[rows])
        return np.concatenate(found)

    def starts(self, values: Values) -> Starts:
        """Return the effect of other starts at these values."""
        middle = self.errors(values)
        # in units of the noise, for a start that is off by one standard deviation of its position or of its speed
        S = np.column_stack(
            [
                (self.errors(values, noises=10.0) - middle) / 10.0,
                (self.errors(values, speeds=_SPEED_DIFFERENCE) - middle) * (_START_SPEED / _SPEED_DIFFERENCE),
            ]
        )
        S /= self._noise[:, None]
        gram = np.add.reduceat(S[:, :, None] * S[:, None, :], self._begins, axis=0)
        inverse = np.asarray(np.linalg.inv(gram + np.eye(2)), dtype=np.float64)
        return Starts(
            errors=middle,
            slopes=S,
            inverse=inverse,
            window=self.window,
            begins=self._begins,
            noise=self._noise,
        )

    def from_better_starts(self, values: Values) -> OutputError:
        """Return the same with the starts of its windows estimated from their errors."""
        found = self.starts(values)
        shifts, begin, moved = found.shifts(found.errors), 0, []
        for one in self.windows:
            own = shifts[begin : begin + len(one.firsts)]
            sizes = np.array([one.noise, _START_SPEED * one.motion.usual_speed])
            moved.append(replace(one, starts=one.starts - own * sizes))
            begin += len(one.firsts)
        return replace(self, windows=tuple(moved))

    @np.errstate(over="ignore", invalid="ignore")  # the error of a simulation that diverges is infinite
    def squares(self, values: Values) -> NDArray[np.float64]:
        """Return the mean square error [m^2] of each window (w,) from its best start."""
        tables = []
        for one in (self, self.from_better_starts(values)):
            begun = one.starts(values)
            left = begun.project(begun.errors)
            tables.append(np.add.reduceat(left**2, self._begins))
        return np.nan_to_num(np.fmin(*tables) / np.bincount(self.window), nan=np.inf)

    def only(self, kept: NDArray[np.bool_]) -> OutputError:
        """Return the errors over some of the windows, counted through all records (w,)."""
        parts, begin = [], 0
        for one in self.windows:
            own = kept[begin : begin + len(one.firsts)]
            begin += len(one.firsts)
            if own.any():
                parts.append(one.only(own))
        return replace(self, windows=tuple(parts))


@dataclass(frozen=True, kw_only=True, eq=False)
class Starts:
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


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputErrorFit:
    """Parameters estimated by output error."""

    problem: OutputError  #: with the starts estimated
    values: dict[str, float]  #: by name, SI units
    standard_errors: dict[str, float]  #: by name, clustered by window; NaN for a parameter at a bound
    correlation: NDArray[np.float64]  #: (p, p) of the parameters' errors
    residuals: NDArray[np.float64]  #: (m,) [m], of the best starts
    #: (m, p) derivatives of the residuals, projected; zero for a parameter at a bound
    slopes: NDArray[np.float64]

    @property
    def model(self) -> AxisModel:
        """What was estimated."""
        return self.problem.model

    @property
    def rms(self) -> float:
        """Root mean square error of the positions [m]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def quantile(self) -> float:
        """Half the width of a 95 % interval over the standard error."""
        return float(scipy.stats.t.ppf(0.975, max(1, self.problem.count - len(self.values))))

    def moved_by(self, windows: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how far the parameters (p,) move in a fit to some windows (w,) alone, and the standard errors of that.

        To first order; NaN where these windows do not determine a parameter.
        """
        free = np.linalg.norm(self.slopes, axis=0) > 0.0
        moves, errors = np.full((2, len(free)), np.nan)
        J = self.slopes[:, free]
        lengths = np.linalg.norm(J, axis=0)
        J = J / lengths
        count = self.problem.count
        scores = np.column_stack(
            [
                np.bincount(self.problem.window, weights=column * self.residuals, minlength=count)
                for column in J.T
            ]
        )
        rows = windows[self.problem.window]
        whole, part = J.T @ J, J[rows].T @ J[rows]
        if free.any() and np.linalg.cond(part) < 1e8:
            alone, together = np.linalg.inv(part), np.linalg.inv(whole)
            moves[free] = -alone @ scores[windows].sum(axis=0) / lengths
            each = scores * windows[:, None] @ alone - scores @ together
            errors[free] = np.sqrt(count / max(count - 1, 1) * (each**2).sum(axis=0)) / lengths
        return moves, errors


# a trial step may diverge: its cost is not finite; it is refused
@np.errstate(over="ignore", invalid="ignore")
def _descended(problem: OutputError, start: Values, most_steps: int) -> OutputErrorFit:
    model, space = problem.model, problem.model.space(start)
    lower, upper = space.bounds()
    scale = max(float(np.ptp(one.record.position)) for one in problem.windows) * 1e-3
    last: dict[bytes, Starts] = {}

    def at(z: NDArray[np.float64]) -> dict[str, float]:
        return model.by_name(space.physical(z))

    def begun(z: NDArray[np.float64]) -> Starts:
        if z.tobytes() not in last:
            last.clear()
            last[z.tobytes()] = problem.starts(at(z))
        return last[z.tobytes()]

    def errors(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return begun(z).project(begun(z).errors) / scale

    def slopes(z: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = []
        for i in range(len(z)):
            step = _DIFFERENCE * np.eye(len(z))[i]
            ahead, behind = np.minimum(z + step, upper), np.maximum(z - step, lower)
            change = problem.errors(at(ahead)) - problem.errors(at(behind))
            columns.append(begun(z).project(change) / (ahead - behind)[i] / scale)
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
    rows = np.split(np.arange(len(J)), np.flatnonzero(np.diff(problem.window)) + 1)
    matrices = np.array([J[one].T @ J[one] for one in rows])
    scores = np.array([J[one].T @ residuals[one] for one in rows])
    # an axis passes its slow speeds in a few windows, which a fit follows closely
    C = covariance(leverage_corrected(matrices, scores, kept), kept)
    return OutputErrorFit(
        problem=problem,
        values=at(z),
        standard_errors=model.by_name(np.sqrt(C.diagonal()) * space.slopes(z)),
        correlation=correlation(C),
        residuals=residuals,
        slopes=J / space.slopes(z),
    )


def fit_output_error(problem: OutputError, start: Values) -> OutputErrorFit:
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


def held_out_squares(fit: OutputErrorFit) -> NDArray[np.float64]:
    """Fit again without each third of the blocks of time; return the mean square errors [m^2] there (w,)."""
    squares, blocks = np.empty(fit.problem.count), blocks_of(fit.problem.count)
    for fold in range(_FOLDS):
        out = np.zeros(len(squares), dtype=bool)
        out[np.concatenate(blocks[fold::_FOLDS])] = True
        again = _descended(fit.problem.only(~out), fit.values, _HELD_OUT_STEPS)
        squares[out] = fit.problem.only(out).squares(again.values)
    return squares
