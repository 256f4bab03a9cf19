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
from ballbot.fitting.parameter import RelativeSpace
from ballbot.fitting.uncertainty import block_length, correlation, covariance, leverage_corrected
from ballbot.identification.axis.model import AxisModel, Values
from ballbot.identification.axis.motion import Motion, position_noise, smoothed_motion, speed_at_start
from ballbot.identification.axis.record import AxisRecord

#: length of a window [s], shorter where records are so short that there would be fewer than `_LEAST_WINDOWS`
WINDOW = 1.0
#: with six parameters, the least that give a covariance from windows some meaning
_LEAST_WINDOWS = 9
#: blocks of time are held out and drawn together; there are about as many
_BLOCKS = 12
FOLDS = 3
#: half the central difference, in the scaled parameter: wide enough to average over single events of sticking
_DIFFERENCE = 5e-4
_MOST_STEPS = 30
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
class Sighting:
    """A record with its filtered motion."""

    record: AxisRecord
    motion: Motion
    bandwidth: float  #: [Hz]
    noise: float  #: of the position [m]
    usual_speed: float  #: root mean square [m/s]


def sighting(record: AxisRecord, bandwidth: float) -> Sighting:
    """Return a record with its filtered motion."""
    motion = smoothed_motion(record, bandwidth=bandwidth)
    return Sighting(
        record=record,
        motion=motion,
        bandwidth=bandwidth,
        noise=max(position_noise(record, bandwidth=bandwidth), 1e-9 * float(np.ptp(record.position))),
        usual_speed=float(np.sqrt(np.mean(motion.speed**2))),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows:
    """Windows of one record, and which of its rows are compared: every `_COMPARED_EVERY`, and from one row on."""

    seen: Sighting
    firsts: NDArray[np.int64]  #: (w,)
    counts: NDArray[np.int64]  #: (w,) rows that each runs over
    starts: NDArray[np.float64]  #: (w, 2) position and speed there

    @cached_property
    def compared(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Which of the positions at rows' ends are compared (m,), the rows of these, and the window of each."""
        every = max(1, round(_COMPARED_EVERY / self.seen.record.sample_time))
        begins = np.cumsum(self.counts) - self.counts
        steps = [np.arange(min(every, count), count + 1, every) for count in self.counts.tolist()]
        sizes = [len(one) for one in steps]
        step, window = np.concatenate(steps), np.repeat(np.arange(len(steps)), sizes)
        return begins[window] + step - 1, self.firsts[window] + step, window

    def only(self, kept: NDArray[np.bool_]) -> Windows:
        """Return some of the windows (w,)."""
        return replace(self, firsts=self.firsts[kept], counts=self.counts[kept], starts=self.starts[kept])


def windows_of(seen: Sighting, duration: float) -> Windows:
    """Return windows of about that duration [s], end to end, in each part between gaps."""
    record, spans = seen.record, list[tuple[int, int]]()
    for begin, end in record.segments:
        if end - begin >= 3:
            count = max(1, round(float(record.t[end - 1] - record.t[begin]) / duration))
            edges = np.linspace(begin, end - 1, count + 1).astype(int)
            spans += [(int(a), int(b)) for a, b in pairwise(edges) if b > a]
    firsts = np.array([first for first, _ in spans], dtype=np.int64)
    speeds = seen.motion.speed[firsts].copy()
    speeds[firsts == 0] = speed_at_start(record)
    positions = np.where(record.even & (firsts == 0), record.position[firsts], seen.motion.position[firsts])
    return Windows(
        seen=seen,
        firsts=firsts,
        counts=np.array([last - first for first, last in spans], dtype=np.int64),
        starts=np.column_stack([positions, speeds]),
    )


def window_duration(records: Sequence[AxisRecord]) -> float:
    """Return the length of the windows of records [s]."""
    return min(WINDOW, sum(record.duration for record in records) / _LEAST_WINDOWS)


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputError:
    """Position errors [m] of a model over windows of records."""

    model: AxisModel
    windows: tuple[Windows, ...]  #: of each record
    late: float = 0.0  #: by how much the force acts later than its row [s]

    @cached_property
    def window(self) -> NDArray[np.int64]:
        """The window of each error (m,), counted through all records."""
        begins = np.cumsum([0, *(len(one.firsts) for one in self.windows)])
        return np.concatenate([one.compared[2] + a for one, a in zip(self.windows, begins[:-1], strict=True)])

    @cached_property
    def _begins(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.diff(self.window, prepend=-1))

    @cached_property
    def _noise(self) -> NDArray[np.float64]:
        return np.concatenate([np.full(len(one.compared[0]), one.seen.noise) for one in self.windows])

    def errors(self, values: Values, *, noises: float = 0.0, speeds: float = 0.0) -> NDArray[np.float64]:
        """Return simulated minus recorded positions (m,), the starts moved by shares of the noise and usual speed."""
        found, axis = [], self.model.axis(values)
        for one in self.windows:
            seen, record = one.seen, one.seen.record
            moved = record
            if self.late:
                moved = replace(record, force=np.interp(record.t - self.late, record.t, record.force))
            places, rows, _ = one.compared
            starts = one.starts + np.array([noises * seen.noise, speeds * seen.usual_speed])
            positions = axis.windows(
                moved, one.firsts, one.counts, starts, interpolated=self.model.interpolated
            )
            found.append(positions[places] - record.position[rows])
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
            sizes = np.array([one.seen.noise, _START_SPEED * one.seen.usual_speed])
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
        counts = np.bincount(self.window)
        return np.nan_to_num(np.fmin(*tables) / counts, nan=np.inf)

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
        windows = int(self.problem.window.max()) + 1
        return float(scipy.stats.t.ppf(0.975, max(1, windows - len(self.values))))

    def moved_by(self, windows: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how far the parameters (p,) move in a fit to some windows (w,) alone, and the standard errors of that.

        To first order; NaN where these windows do not determine a parameter.
        """
        free = np.linalg.norm(self.slopes, axis=0) > 0.0
        moves, errors = np.full((2, len(free)), np.nan)
        J = self.slopes[:, free]
        lengths = np.linalg.norm(J, axis=0)
        J = J / lengths
        count = int(self.problem.window.max()) + 1
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
    scale = max(float(np.ptp(one.seen.record.position)) for one in problem.windows) * 1e-3
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
    return _fit_at(problem, space, z, J * kept, errors(z) * scale)


def _fit_at(
    problem: OutputError,
    space: RelativeSpace,
    z: NDArray[np.float64],
    J: NDArray[np.float64],
    residuals: NDArray[np.float64],
) -> OutputErrorFit:
    """Return the fit that ends at a scaled point with derivatives by it (m, p), zero for a parameter at a bound."""
    kept = np.linalg.norm(J, axis=0) > 0.0
    rows = np.split(np.arange(len(J)), np.flatnonzero(np.diff(problem.window)) + 1)
    matrices = np.array([J[one].T @ J[one] for one in rows])
    scores = np.array([J[one].T @ residuals[one] for one in rows])
    # an axis passes its slow speeds in a few windows, which a fit follows closely
    C = covariance(leverage_corrected(matrices, scores, kept), kept)
    deviations, slopes = np.sqrt(C.diagonal()), space.slopes(z)
    return OutputErrorFit(
        problem=problem,
        values=problem.model.by_name(space.physical(z)),
        standard_errors=problem.model.by_name(deviations * slopes),
        correlation=correlation(C),
        residuals=residuals,
        slopes=J / slopes,
    )


def fit_output_error(
    problem: OutputError, start: Values, *, most_steps: int = _MOST_STEPS, rounds: int = _ROUNDS
) -> OutputErrorFit:
    """Descend from `start`, and again from better starts of the windows as long as the error falls by a percent."""
    fit = _descended(problem, start, most_steps)
    for _ in range(rounds - 1):
        again = _descended(fit.problem.from_better_starts(fit.values), fit.values, most_steps)
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
    count = int(fit.problem.window.max()) + 1
    squares, blocks = np.empty(count), blocks_of(count)
    for fold in range(FOLDS):
        out = np.zeros(count, dtype=bool)
        out[np.concatenate(blocks[fold::FOLDS])] = True
        again = fit_output_error(fit.problem.only(~out), fit.values, most_steps=8, rounds=1)
        squares[out] = fit.problem.only(out).squares(again.values)
    return squares
