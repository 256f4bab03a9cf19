"""Output error: the parameters whose simulation comes closest to the records, in open or in closed loop.

In open loop the recorded force moves the axis over windows, and positions are compared; in closed loop the recorded
reference does, and forces are compared. Levenberg and Marquardt's steps by SciPy, with central differences wide enough
to average over single events of sticking.

The state at a window's start is estimated with the parameters, by a linear correction of the filtered record's
position and speed there. From the window's errors and their derivatives, the part that another start would explain is
projected out (variable projection: G. Golub and V. Pereyra, Inverse Problems 19 (2003) R1-R26; derivatives as
L. Kaufman, BIT 15 (1975) 49-57), so that a noisy start is no error of the friction. The prior standard deviations are
the position noise, and `_START_SPEED` of the record's usual speed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Protocol, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.fitting.least_squares import Stopping, minimize_squares
from ballbot.fitting.parameter import RelativeSpace
from ballbot.fitting.run import DEFAULT_RUN
from ballbot.fitting.search import evolve
from ballbot.fitting.uncertainty import errors_in_time
from ballbot.identification.axis.laws import Values
from ballbot.identification.axis.motion import (
    Motion,
    first_row,
    position_noise,
    smoothed_motion,
    speed_at_start,
)
from ballbot.identification.axis.record import AxisRecord, Span
from ballbot.identification.axis.structure import AxisModel, base_name

#: half the central difference, in the scaled parameter
_DIFFERENCE = 5e-4
_MOST_STEPS = 30
#: the descent ends where a step lowers the sum of squares by less than this share
_ENOUGH = 1e-4
#: it starts at least this far inside the bounds; a parameter that ends closer to one than `_AT_BOUND` is at it
_INSIDE, _AT_BOUND = 1e-3, 1e-6
#: the evolution strategy looks this far around, in scaled parameters
_REACH, _REACH_LOGARITHMIC = 0.2, 2.0
_GENERATIONS, _POPULATION = 25, 10
#: positions are compared this often [s]
_COMPARED_EVERY = 0.01
#: shares of the usual speed: standard deviation of the start's speed, and the step of its finite difference
_START_SPEED, _SPEED_DIFFERENCE = 0.2, 0.01
#: residuals within so long depend on each other [s]
BLOCK = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Sighting:
    """A record with its filtered motion."""

    record: AxisRecord
    motion: Motion
    bandwidth: float  #: [Hz]
    noise: float  #: of the position [m]

    @property
    def usual_speed(self) -> float:
        """Root mean square of the speed [m/s]."""
        return float(np.sqrt(np.mean(self.motion.speed**2)))


def sighting(record: AxisRecord, bandwidth: float) -> Sighting:
    """Return a record with its filtered motion."""
    return Sighting(
        record=record,
        motion=smoothed_motion(record, bandwidth=bandwidth),
        bandwidth=bandwidth,
        noise=max(position_noise(record, bandwidth=bandwidth), 1e-9 * float(np.ptp(record.position))),
    )


def equal_spans(record: AxisRecord, duration: float, within: Span | None = None) -> list[Span]:
    """Return windows of about that duration [s], end to end, in each part between gaps; one of a shorter part."""
    found = []
    for first, last in record.segments:
        begin, end = (first, last) if within is None else (max(first, within[0]), min(last, within[1] + 1))
        if end - begin < 3:
            continue
        count = max(1, round(float(record.t[end - 1] - record.t[begin]) / duration))
        edges = np.linspace(begin, end - 1, count + 1).astype(int)
        found += [(int(a), int(b)) for a, b in pairwise(edges) if b > a]
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows:
    """Windows of one record, of which the model predicts the positions."""

    record: int  #: its number
    firsts: NDArray[np.int64]  #: (w,)
    counts: NDArray[np.int64]  #: (w,) rows that each runs over
    starts: NDArray[np.float64]  #: (w, 2) position and speed there
    compared: NDArray[np.int64]  #: (m,) which of the predicted positions are compared
    rows: NDArray[np.int64]  #: (m,) rows of the record that these are
    window: NDArray[np.int64]  #: (m,) the window of each


def windows_of(seen: Sighting, spans: Sequence[Span], number: int = 0) -> Windows:
    """Return windows over these spans of rows of the record of that number."""
    record, motion = seen.record, seen.motion
    every = max(1, round(_COMPARED_EVERY / record.sample_time))
    firsts = np.array([first for first, _ in spans], dtype=np.int64)
    counts = np.array([last - first for first, last in spans], dtype=np.int64)
    speeds = motion.speed[firsts].copy()
    speeds[firsts == 0] = speed_at_start(record)
    positions = np.where(record.even & (firsts == 0), record.position[firsts], motion.position[firsts])
    compared, rows, window, begin = [], [], [], 0
    for place, (first, last) in enumerate(spans):
        steps = np.arange(min(every, last - first), last - first + 1, every)
        compared.append(begin + steps - 1)
        rows.append(first + steps)
        window.append(np.full(len(steps), place))
        begin += last - first
    return Windows(
        record=number,
        firsts=firsts,
        counts=counts,
        starts=np.column_stack([positions, speeds]),
        compared=np.concatenate(compared),
        rows=np.concatenate(rows),
        window=np.concatenate(window),
    )


_T = TypeVar("_T")
Projection = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class Problem(Protocol):
    """Errors that parameters minimize."""

    @property
    def block(self) -> NDArray[np.int64]:
        """The block of time of each error (m,)."""
        ...

    @property
    def scale(self) -> float:
        """A usual size of the errors."""
        ...

    def errors(self, values: Values) -> NDArray[np.float64]:
        """Return simulated minus recorded (m,)."""
        ...

    def projection(self, values: Values) -> Projection:
        """Return the projection of errors (m,), or derivatives of them, that removes the part other starts explain."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenLoop:
    """Position errors [m] over windows of records."""

    model: AxisModel
    sightings: Sequence[Sighting]
    windows: Sequence[Windows]

    @property
    def block(self) -> NDArray[np.int64]:
        """The block of time of each error (m,); a window lies in one block."""
        blocks, begin = [], 0
        for one in self.windows:
            record = self.sightings[one.record].record
            _, block = np.unique(record.t[one.firsts] // BLOCK, return_inverse=True)
            blocks.append(block[one.window] + begin)
            begin += int(block.max()) + 1
        return np.concatenate(blocks)

    @cached_property
    def window(self) -> NDArray[np.int64]:
        """The window of each error (m,), counted through all records."""
        found, begin = [], 0
        for one in self.windows:
            found.append(one.window + begin)
            begin += len(one.firsts)
        return np.concatenate(found)

    @property
    def scale(self) -> float:
        """A thousandth of the travel [m]."""
        return 1e-3 * max(float(np.ptp(one.record.position)) for one in self.sightings)

    @cached_property
    def _noise(self) -> NDArray[np.float64]:
        return np.concatenate(
            [np.full(len(one.rows), self.sightings[one.record].noise) for one in self.windows]
        )

    @cached_property
    def _measured(self) -> NDArray[np.float64]:
        return np.concatenate([self.sightings[one.record].record.position[one.rows] for one in self.windows])

    @cached_property
    def _last(self) -> dict[str, tuple[tuple[tuple[str, float], ...], Any]]:
        """What was computed last, by what it is, and for which values: it is needed again and again."""
        return {}

    def _again(self, what: str, values: Values, compute: Callable[[], _T]) -> _T:
        """Return what was computed last for these values, or compute it."""
        key = tuple(values.items())
        if self._last.get(what, (None, None))[0] != key:
            self._last[what] = (key, compute())
        return self._last[what][1]

    def errors(self, values: Values) -> NDArray[np.float64]:
        """Return simulated minus recorded positions (m,)."""
        return self._again("positions", values, lambda: self._positions(values)) - self._measured

    def _positions(self, values: Values, *, noises: float = 0.0, speeds: float = 0.0) -> NDArray[np.float64]:
        """Return the positions (m,), the starts moved by multiples of the noise and of the usual speed."""
        found = []
        for one in self.windows:
            seen = self.sightings[one.record]
            axis = self.model.axis(values, one.record)
            bends = axis.bends(seen.motion.position, seen.motion.speed)[one.firsts]
            starts = one.starts + np.array([noises * seen.noise, speeds * seen.usual_speed])
            predicted = axis.windows(
                seen.record,
                one.firsts,
                one.counts,
                np.column_stack([starts, bends]),
                interpolated=self.model.interpolated,
            )
            found.append(predicted[one.compared])
        return np.concatenate(found)

    def projection(self, values: Values) -> Projection:
        """Return the projection that removes the part of errors that other starts of the windows explain."""
        S, begins, inverse = self._again("starts", values, lambda: self._starts_matter(values))

        def project(errors: NDArray[np.float64]) -> NDArray[np.float64]:
            scores = np.add.reduceat(S * (errors / self._noise)[:, None], begins, axis=0)
            shifts = np.einsum("wij,wj->wi", inverse, scores)
            return errors - self._noise * np.einsum("mi,mi->m", S, shifts[self.window])

        return project

    def from_better_starts(self, values: Values) -> OpenLoop:
        """Return the same problem with the starts of its windows estimated from their errors."""
        S, begins, inverse = self._again("starts", values, lambda: self._starts_matter(values))
        scores = np.add.reduceat(S * (self.errors(values) / self._noise)[:, None], begins, axis=0)
        shifts, begin, moved = np.einsum("wij,wj->wi", inverse, scores), 0, []
        for one in self.windows:
            seen, own = self.sightings[one.record], shifts[begin : begin + len(one.firsts)]
            sizes = np.array([seen.noise, _START_SPEED * seen.usual_speed])
            moved.append(replace(one, starts=one.starts - own * sizes))
            begin += len(one.firsts)
        return replace(self, windows=moved)

    def _starts_matter(
        self, values: Values
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """Return the derivatives S (m, 2) by the starts, where windows begin, and (I + S^T S)^-1 (w, 2, 2)."""
        middle = self._again("positions", values, lambda: self._positions(values))
        # in units of the noise, for a start that is off by one standard deviation of its position or of its speed
        S = np.column_stack(
            [
                (self._positions(values, noises=10.0) - middle) / 10.0,
                (self._positions(values, speeds=_SPEED_DIFFERENCE) - middle)
                * (_START_SPEED / _SPEED_DIFFERENCE),
            ]
        )
        S /= self._noise[:, None]
        begins = np.flatnonzero(np.diff(self.window, prepend=-1))
        gram = np.add.reduceat(S[:, :, None] * S[:, None, :], begins, axis=0)
        return S, begins.astype(np.int64), np.asarray(np.linalg.inv(gram + np.eye(2)), dtype=np.float64)

    def from_best_starts(self, values: Values) -> NDArray[np.float64]:
        """Return the position errors [m] (m,) from the estimated start of each window.

        Estimated once more from there, as a fit does, where that is closer: an axis that sticks is far from linear.
        """
        first = self.projection(values)(self.errors(values))
        moved = self.from_better_starts(values)
        again = moved.projection(values)(moved.errors(values))
        begins = np.flatnonzero(np.diff(self.window, prepend=-1))
        closer = np.add.reduceat(again**2, begins) < np.add.reduceat(first**2, begins)
        return np.where(closer[self.window], again, first)

    @np.errstate(over="ignore", invalid="ignore")  # the error of a simulation that diverges is infinite
    def rms(self, values: Values) -> float:
        """Return the root mean square position error [m] from the estimated start of each window."""
        found = float(np.sqrt(np.mean(self.from_best_starts(values) ** 2)))
        return found if np.isfinite(found) else np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeRecords(OpenLoop):
    """Position errors [m] over whole records, each from its measured start."""

    @property
    def block(self) -> NDArray[np.int64]:
        """The block of time of each error (m,)."""
        blocks, begin = [], 0
        for one in self.windows:
            block = (self.sightings[one.record].record.t[one.rows] // BLOCK).astype(np.int64)
            blocks.append(block + begin)
            begin += int(block.max()) + 1
        return np.concatenate(blocks)

    def projection(self, values: Values) -> Projection:  # noqa: ARG002
        """Return the identity."""
        return lambda errors: errors


def whole_records(model: AxisModel, sightings: Sequence[Sighting]) -> WholeRecords:
    """Return the problem of records without gaps, each in one window."""
    windows = [windows_of(seen, [(0, len(seen.record) - 1)], number) for number, seen in enumerate(sightings)]
    return WholeRecords(model=model, sightings=sightings, windows=windows)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoop:
    """Force errors [N] of records in their simulated loops, each from its first good row on."""

    model: AxisModel
    sightings: Sequence[Sighting]  #: all of them with their loops

    def __post_init__(self) -> None:
        object.__setattr__(
            self,
            "_starts",
            [max(0, first_row(one.record, bandwidth=one.bandwidth)) for one in self.sightings],
        )

    _starts: Sequence[int] = ()

    @property
    def scale(self) -> float:
        """A twentieth of the force's standard deviation [N]."""
        return 0.05 * float(np.std(np.concatenate([one.record.force for one in self.sightings])))

    @property
    def block(self) -> NDArray[np.int64]:
        """The block of time of each error (m,)."""
        blocks, begin = [], 0
        for seen, start in zip(self.sightings, self._starts, strict=True):
            block = (seen.record.t[start:] // BLOCK).astype(np.int64)
            blocks.append(block - block[0] + begin)
            begin = int(blocks[-1][-1]) + 1
        return np.concatenate(blocks)

    def errors(self, values: Values) -> NDArray[np.float64]:
        """Return simulated minus recorded forces (m,)."""
        found = []
        for number, (seen, start) in enumerate(zip(self.sightings, self._starts, strict=True)):
            axis = self.model.axis(values, number)
            forces = axis.closed_loop(seen.record, speed=speed_at_start(seen.record)).forces
            found.append(forces[start:] - seen.record.force[start:])
        return np.concatenate(found)

    def projection(self, values: Values) -> Projection:  # noqa: ARG002
        """Return the identity: the loop forgets its start."""
        return lambda errors: errors


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputErrorFit:
    """Parameters estimated by output error."""

    model: AxisModel
    values: dict[str, float]  #: by label, SI units
    standard_errors: dict[str, float]  #: NaN if a parameter is at a bound
    rms: float  #: of the residuals: [m] in open loop, [N] in closed loop
    freedom: int = 1  #: blocks of time beyond the parameters

    @property
    def quantile(self) -> float:
        """Half the width of a 95 % interval over the standard error."""
        return float(scipy.stats.t.ppf(0.975, self.freedom))

    @property
    def half_widths(self) -> dict[str, float]:
        """Half widths of the 95 % intervals, by label, if the model lacks nothing."""
        return {label: self.quantile * error for label, error in self.standard_errors.items()}


@np.errstate(
    over="ignore", invalid="ignore"
)  # a trial step may diverge: its cost is not finite; it is refused
def fit_output_error(model: AxisModel, start: Values, problem: Problem) -> OutputErrorFit:
    """Descend from `start`."""
    space = model.space(start)
    lower, upper = space.bounds()
    last: dict[bytes, Projection] = {}

    def at(z: NDArray[np.float64]) -> dict[str, float]:
        return model.by_label(space.physical(z))

    def projection(z: NDArray[np.float64]) -> Projection:
        key = z.tobytes()
        if key not in last:
            last.clear()
            last[key] = problem.projection(at(z))
        return last[key]

    def errors(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return projection(z)(problem.errors(at(z))) / problem.scale

    def slopes(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return _slopes(model, space, problem, z, projection(z)) / problem.scale

    begin = np.clip(space.scaled(model.vector(start)), lower + _INSIDE, upper - _INSIDE)
    found = minimize_squares(
        errors,
        begin,
        jacobian_of=slopes,
        bounds=(lower, upper),
        scale="jac",
        stopping=Stopping(most_evaluations=_MOST_STEPS, least_gain=_ENOUGH, least_step=1e-5),
    )
    values = at(found.point)
    return OutputErrorFit(
        model=model,
        values=values,
        standard_errors=model.by_label(
            _standard_errors(space, found.point, found.jacobian, errors(found.point), problem.block)
        ),
        rms=problem.scale * float(np.sqrt(np.mean(errors(found.point) ** 2))),
        freedom=max(1, len(np.unique(problem.block)) - len(found.point)),
    )


def _slopes(
    model: AxisModel, space: RelativeSpace, problem: Problem, z: NDArray[np.float64], project: Projection
) -> NDArray[np.float64]:
    """Return the projected derivatives (m, p) of the errors by scaled parameters."""
    lower, upper = space.bounds()
    columns = []
    for i in range(len(z)):
        step = _DIFFERENCE * np.eye(len(z))[i]
        ahead, behind = np.minimum(z + step, upper), np.maximum(z - step, lower)
        first, second = (problem.errors(model.by_label(space.physical(one))) for one in (ahead, behind))
        columns.append(project(first - second) / (ahead - behind)[i])
    return np.column_stack(columns)


def derivatives(model: AxisModel, values: Values, problem: Problem) -> NDArray[np.float64]:
    """Return the projected derivatives (m, p) of the errors by the parameters in SI units."""
    space = model.space(values)
    z = space.scaled(model.vector(values))
    return _slopes(model, space, problem, z, problem.projection(values)) / space.slopes(z)


@np.errstate(over="ignore")
def search_output_error(model: AxisModel, start: Values, problem: Problem) -> OutputErrorFit:
    """Descend from the best of an evolution strategy around where a descent from `start` ends.

    Over whole records single events of sticking make many small valleys, of which a descent finds the nearest.
    """
    near = fit_output_error(model, start, problem)
    space = model.space(near.values)
    middle, (lower, upper) = space.scaled(model.vector(near.values)), space.bounds()
    masses = np.array([base_name(label) == "mass" for label in model.labels])
    reach = np.where(space.logarithmic & ~masses, _REACH_LOGARITHMIC, _REACH)

    def z_of(drawn: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.clip(middle + (2.0 * drawn - 1.0) * reach, lower, upper)

    def costs(population: NDArray[np.float64]) -> NDArray[np.float64]:
        squares = [
            np.mean(problem.errors(model.by_label(space.physical(z_of(one)))) ** 2) for one in population
        ]
        return 0.5 * np.log(np.maximum(squares, np.finfo(float).tiny))

    evolved = evolve(
        costs, size=len(middle), generations=_GENERATIONS, population=_POPULATION, run=DEFAULT_RUN
    )
    found = fit_output_error(model, model.by_label(space.physical(z_of(evolved.best))), problem)
    return min(near, found, key=lambda fit: fit.rms)


def _standard_errors(
    space: RelativeSpace,
    z: NDArray[np.float64],
    J: NDArray[np.float64],
    residuals: NDArray[np.float64],
    block: NDArray[np.int64],
) -> NDArray[np.float64]:
    lower, upper = space.bounds()
    kept = (z - lower > _AT_BOUND) & (upper - z > _AT_BOUND) & (np.linalg.norm(J, axis=0) > 0.0)
    errors = np.full(len(z), np.nan)
    errors[kept] = errors_in_time(J[:, kept], residuals, block)
    return errors * space.slopes(z)
