"""When the recorded force acts: held from row to row or changing evenly, and how late it is against the position.

A force that acts a sample later than its row, as behind a bus or a filter, changes the viscous friction and the mass of
a fit by tens of percent, and no residual says so. Windows in open loop show it: the simplest law predicts them clearly
better with the force moved by the true delay, which is found in half samples, and then to a part of them by one linear
step. Friction that the simplest law does not
have may look like a delay, too; so every wider law must need it as clearly.

A log that is slower than the loop shows a smaller delay: the loop holds each force for its own sample time, half of
which the force comes later than the log's straight lines from row to row. Such a part of a row is estimated with the
parameters (`part_of_a_row`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, note, warning
from ballbot.fitting.least_squares import fit_in_time
from ballbot.identification.axis.inverse import SLOW_SAMPLING
from ballbot.identification.axis.laws import AXIS_LAWS, Values
from ballbot.identification.axis.output_error import OpenLoop, Sighting, derivatives
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.selection import ABOVE_NOISE, Blocks, fit_all, horizons_for, problem_of
from ballbot.identification.axis.structure import AxisModel

#: the force is taken as changing evenly between rows if that lowers the position error to less than this share
_CLEARER = 0.98
#: and as delayed, if that lowers it to less than this one; the lowest of 12 simulated records without a delay is 0.96,
#: the highest of 4 with delays of one to three rows 0.87
_CLEARLY_DELAYED = 0.92
#: time [s] and rows by which a force is moved at most, the larger of the two: buses and filters delay it less
_LONGEST_DELAY, _MOST_ROWS = 0.025, 8
#: windows over which both are judged last so long [s], and so many rows at least; where the noise of a coarse encoder
#: hides the force's time in them, the next longer ones whose error is above the noise, up to so long
_DURATION, _LEAST_ROWS = 0.1, 12
_LONGEST = 0.5

#: the part of a row by which an interpolated force acts later is clear if chance makes it in less than this share of
#: cases, and at most half a row, as of a loop that is as slow as the log
_PART_BY_CHANCE, _MOST_OF_A_ROW = 0.05, 0.5
#: windows refute a delay that is so many standard errors from what they show
_REFUTED = 3.0
#: rows by which the force is moved to either side for a derivative
_COLUMN_ROWS = 0.25


def _window_length(sightings: Sequence[Sighting], model: AxisModel, start: Values, blocks: Blocks) -> float:
    """Return the length of windows [s] in which the time at which the force acts is seen."""
    records = [one.record for one in sightings]
    shortest = max(_DURATION, _LEAST_ROWS * max(one.sample_time for one in records))
    noise = max(one.noise for one in sightings)
    longer = [one for one in horizons_for(blocks, records) if shortest < one <= _LONGEST]
    for length in (shortest, *longer):
        if fit_all(model, start, sightings, blocks, length).rms > ABOVE_NOISE * noise:
            return length
    return max((shortest, *longer))


def _most_rows(sightings: Sequence[Sighting]) -> int:
    """Return the rows by which a force is moved at most."""
    return max(_MOST_ROWS, round(_LONGEST_DELAY / max(one.record.sample_time for one in sightings)))


def is_interpolated(
    sightings: Sequence[Sighting], model: AxisModel, starts: Mapping[str, Values], blocks: Blocks
) -> bool:
    """Return whether the force changes evenly from row to row, rather than being held."""
    if max(one.record.sample_time for one in sightings) <= SLOW_SAMPLING:
        return False
    start = starts["coulomb"]
    length = _window_length(sightings, model, start, blocks)
    held, even = (
        fit_all(replace(model, interpolated=one), start, sightings, blocks, length).rms
        for one in (False, True)
    )
    return even < _CLEARER * held


def force_delay(
    sightings: Sequence[Sighting], model: AxisModel, starts: Mapping[str, Values], blocks: Blocks
) -> float:
    """Return by how many rows the force acts later than recorded, in halves; zero if that is not clear.

    A force that a loop's law gives is not moved: the simulated loop has no delay.
    """
    if any(one.record.loop is not None for one in sightings):
        return 0.0
    first = "dahl" if model.bending else "coulomb"
    length = _window_length(sightings, model.with_law(AXIS_LAWS[first]), starts[first], blocks)
    found: dict[tuple[str, float], float] = {}

    def error(law: str, rows: float) -> float:
        if (law, rows) not in found:
            moved = [replace(one, record=delayed(one.record, rows)) for one in sightings]
            own = model.with_law(AXIS_LAWS[law])
            least = fit_all(own, starts[law], moved, blocks, length).rms
            # a wider law contains the first one; from starts of forces that are late a descent may miss that
            found[law, rows] = least if law == first else min(least, error(first, rows))
        return found[law, rows]

    simplest = partial(error, first)
    best = min((0.0, 1.0, -1.0), key=simplest)
    step, most = best, _most_rows(sightings)
    while step and abs(best) < most and simplest(best + step) < simplest(best):
        best += step
    if abs(best) >= most:  # an optimum beyond is no delay
        return 0.0
    best = min((best, best - 0.5, best + 0.5), key=simplest)
    laws = ("dahl", "lugre") if model.bending else ("coulomb", "stribeck", "asymmetric")
    clear = best and all(error(law, best) < _CLEARLY_DELAYED * error(law, 0.0) for law in laws)
    return best if clear else 0.0


@dataclass(frozen=True, kw_only=True)
class LinearDelay:
    """A delay estimated together with the parameters of the simplest law, linear about a fit without one."""

    rows: float
    error: float  #: standard error [rows]
    p_value: float  #: of no delay
    improves: bool  #: whether a fit with the force so moved has the smaller error

    def refutes(self, rows: float) -> bool:
        """Return whether the windows exclude a delay of so many rows, and show one nearer to zero than to it."""
        return abs(self.rows) < 0.5 * abs(rows) and abs(rows - self.rows) > _REFUTED * self.error


def linear_delay(
    sightings: Sequence[Sighting], model: AxisModel, starts: Mapping[str, Values], blocks: Blocks
) -> LinearDelay | None:
    """Return the delay that the windows show; None if they do not determine it."""
    law = "dahl" if model.bending else "coulomb"
    own = model.with_law(AXIS_LAWS[law])
    length = _window_length(sightings, own, starts[law], blocks)
    fit = fit_all(own, starts[law], sightings, blocks, length)
    problem = problem_of(own, sightings, blocks, length)
    known = [place for place, label in enumerate(own.labels) if np.isfinite(fit.standard_errors[label])]
    J = derivatives(own, fit.values, problem)[:, known]
    _, block = np.unique(problem.block, return_inverse=True)
    residuals = -problem.projection(fit.values)(problem.errors(fit.values))
    step = fit_in_time(np.column_stack([J, delay_column(problem, fit.values)]), residuals, block)
    if step is None:
        return None
    rows = float(step.values[-1])
    # a step far beyond the search is no delay, and is not tried
    improves = False
    if abs(rows) <= _most_rows(sightings):
        moved = [replace(one, record=delayed(one.record, rows)) for one in sightings]
        improves = fit_all(own, fit.values, moved, blocks, length).rms < fit.rms
    return LinearDelay(rows=rows, error=float(step.errors[-1]), p_value=step.p_value(-1), improves=improves)


def part_of_a_row(
    sightings: Sequence[Sighting], model: AxisModel, starts: Mapping[str, Values], blocks: Blocks
) -> float:
    """Return by which part of a row a force that is interpolated acts later; zero if that is not clear.

    A loop that runs faster than the log holds its force for its own sample time, half of which the force comes later.
    """
    if not model.interpolated or any(one.record.loop is not None for one in sightings):
        return 0.0
    return max(0.0, remaining_delay(sightings, model, starts, blocks))


def remaining_delay(
    sightings: Sequence[Sighting], model: AxisModel, starts: Mapping[str, Values], blocks: Blocks
) -> float:
    """Return by which part of a row forces that were moved by halves of a row act later still, negative if earlier.

    Zero if that is not clear. Half of the search's step may matter: it is a millisecond of the force where rows come at
    250 Hz.
    """
    found = linear_delay(sightings, model, starts, blocks)
    if found is None or not (found.improves and found.p_value < _PART_BY_CHANCE):
        return 0.0
    return found.rows if abs(found.rows) <= _MOST_OF_A_ROW else 0.0


def delay_column(problem: OpenLoop, values: Values) -> NDArray[np.float64]:
    """Return the projected derivatives (m,) of a problem's errors by the rows that the forces act later."""
    later, earlier = (
        replace(
            problem, sightings=[replace(one, record=delayed(one.record, rows)) for one in problem.sightings]
        )
        for rows in (_COLUMN_ROWS, -_COLUMN_ROWS)
    )
    change = later.errors(values) - earlier.errors(values)
    return problem.projection(values)(change) / (2.0 * _COLUMN_ROWS)


def delayed(record: AxisRecord, rows: float) -> AxisRecord:
    """Return a record whose force acts so many rows later; at the ends the first or last force goes on."""
    if not rows:
        return record
    whole = int(np.floor(rows))
    part = rows - whole
    places = np.arange(len(record))

    def moved(values: NDArray[np.float64]) -> NDArray[np.float64]:
        first, second = (values[np.clip(places - k, 0, len(record) - 1)] for k in (whole, whole + 1))
        return (1.0 - part) * first + part * second

    added = None if record.added is None else moved(record.added)
    return replace(record, force=moved(record.force), added=added)


def delay_findings(
    records: Sequence[AxisRecord],
    rows: float,
    *,
    clear: bool = True,
    unconfirmed: float = 0.0,
    part: float = 0.0,
) -> list[Finding]:
    """Return the finding on when the forces act.

    Parameters
    ----------
    records : sequence of AxisRecord
    rows : float
        By which the forces were moved.
    clear : bool
        Whether windows between reversals of the force need that, too.
    unconfirmed : float
        Rows by which the forces were not moved, as these windows do not need it.
    part : float
        Part of a row by which interpolated forces were moved.
    """
    found = []
    if part:
        text = (
            f"The recorded force acts {_later(records, part)} than its row; all results are for the force moved by "
            "this time. A loop that runs faster than the log, and holds its force, causes such a delay."
        )
        found.append(note("force-delay", text))
    if rows:
        text = (
            f"The recorded force acts {_later(records, rows)} than its row: so moved it predicts the position clearly "
            "better, and all results are with it. A filter, a bus or the order of reading and writing makes such a "
            "delay; without it, mass and viscous friction would be wrong."
        )
        if not clear:
            text += (
                " The force reverses too often to distinguish such a delay from play (backlash) between drive and "
                "axis, which would make all parameters wrong. Record longer motions in one direction."
            )
        found.append(warning("force-delay", text))
    elif unconfirmed:
        text = (
            f"Windows fit clearly better if the recorded force acts {_later(records, unconfirmed)} than its row; the "
            "rows between reversals of the force do not confirm it, so it is not moved. Slight play (backlash) may "
            "have this effect. If instead a filter, a bus or the order of reading and writing delays the force, mass "
            "and viscous friction are wrong. Record longer motions in one direction, which distinguish the two."
        )
        found.append(warning("force-delay", text))
    return found


def _later(records: Sequence[AxisRecord], rows: float) -> str:
    usual = 1e3 * abs(rows) * max(one.sample_time for one in records)
    count = f"{abs(rows):.2g} {'row' if abs(rows) == 1.0 else 'rows'}"
    return f"{usual:.3g} ms ({count}) {'later' if rows > 0.0 else 'earlier'}"
