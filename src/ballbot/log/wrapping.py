"""Unwrap headings and lean angles when a log is read.

The columns of a log are continuous, so that no computation has to unwrap them.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.findings import Finding, note
from ballbot.log.columns import ATTITUDE_NAMES
from ballbot.summary import counted

#: a step of a heading that stays within one turn is the end of the turn if it is larger [rad]: a robot does not turn so
#: far from row to row, and a commanded half turn keeps its sign
LARGEST_TURN = 1.5 * np.pi
#: share of the values within one turn that shows a wrapped heading (others are spikes), and their rounding [rad]
_WITHIN, _ROUNDED = 0.98, 1e-3


def continuous_heading(heading: Floats, *, after: float = np.nan) -> tuple[Floats, NDArray[np.intp]]:
    """Return a heading (N,) [rad] without the jumps of a turn that it has if it is kept within one turn.

    It is kept there if its values are from -pi to pi, or from 0 to below 2 pi; its steps of more than `LARGEST_TURN`
    are then jumps. A heading of several turns stays as it is.

    `after` is the heading to which the first value belongs, such as the robot's for a reference; NaN if unknown. Also
    returned are the rows at which a new turn begins. Missing values stay missing.
    """
    known = np.isfinite(heading)
    turn = 2.0 * np.pi
    turns = (np.abs(heading) <= np.pi + _ROUNDED, (heading >= -_ROUNDED) & (heading < turn))
    inside = max(turns, key=np.count_nonzero)
    if not known.any() or np.count_nonzero(inside) < _WITHIN * np.count_nonzero(known):
        return heading, np.zeros(0, dtype=np.intp)
    rows = np.flatnonzero(inside)
    # `after` may be whole turns away; it decides only the turn of the first value
    steps = np.diff(heading[rows], prepend=after if abs(after) <= turn else heading[rows[0]])
    jumps = np.abs(steps) > LARGEST_TURN
    if not jumps.any():
        return heading, np.zeros(0, dtype=np.intp)
    added = np.zeros(len(heading))
    added[rows] = np.where(jumps, -turn * np.sign(steps), 0.0)
    if not abs(after) <= turn:  # a robot starts at a heading from -pi to pi
        added[0] -= turn * np.round(heading[rows[0]] / turn)
    return heading + np.cumsum(added), rows[jumps]


#: columns that are continued, a lean from 0 to a full turn too; the reference begins in the turn of the heading
TURNED = (*ATTITUDE_NAMES, "ref_psi")


def continuous_headings(columns: Mapping[str, Floats], t: Floats) -> tuple[dict[str, Floats], list[Finding]]:
    """Return the headings and lean angles (N,) that are kept within one turn, continued, and a finding on each."""
    continued: dict[str, Floats] = {}
    findings, first = [], np.nan
    for name in (name for name in TURNED if name in columns):
        heading, rows = continuous_heading(columns[name], after=first if name == "ref_psi" else np.nan)
        known = heading[np.isfinite(heading)]
        first = float(known[0]) if known.size and name == "psi" else np.nan
        if not rows.size:
            continue
        continued[name] = heading
        time = float(t[rows[0]])
        text = (
            f"{name} is kept within one turn and jumps from end to end {counted(rows.size, 'time')}, first at row "
            f"{rows[0] + 1} (t = {time:.6g} s): it is continued there."
        )
        findings.append(note("wrap", text, name, time=time))
    return continued, findings


#: after so many an angle in turns, radians or degrees begins again, and an encoder or counter
TURNS, COUNTERS = (1.0, 2.0 * np.pi, 360.0), tuple(2.0**bits for bits in range(8, 33))
#: largest ordinary step, as a share of the period: a jump differs from the period by no more than such a step; and the
#: excess of range and jumps over the period by noise and rounding
_LARGEST_STEP, _BEYOND = 0.25, 0.01


def wrap_period(angles: Floats, periods: Iterable[float]) -> float | None:
    """Return the period within which angles (N,) or (N, n) are kept, and at whose ends they jump; None if none fits."""
    travel, steps = float(np.ptp(angles, axis=0).max()), np.abs(np.diff(angles, axis=0))
    for period in periods:
        jumps = steps > 0.5 * period
        usual = float(steps[~jumps].max(initial=0.0))
        # only with the right period does a jump differ from it by an ordinary step
        kept = 0.5 * period < travel <= (1.0 + _BEYOND) * period and usual <= _LARGEST_STEP * period
        if kept and jumps.any() and np.abs(steps[jumps] - period).max() <= 2.0 * usual + _BEYOND * period:
            return period
    return None
