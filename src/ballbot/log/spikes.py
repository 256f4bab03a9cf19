"""Values of single rows that no motion makes: a spoilt message, or a marker such as 9999 for one that is missing.

A value is a spike where it stands off both rows beside it, to the same side, by more than five times the range that
nearly all others have. What moves gets there and back over several rows; noise that reaches so far is no single row's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.columns import KNOWN_NAMES, TRUE_PREFIX
from ballbot.log.log import Log

#: a spike stands off by so many times the range of the others, of which this share at either end does not count
_FAR, _ENDS = 5.0, 0.005
#: a heading kept within one turn jumps by a turn
_HEADING, _TURN = "psi", 2.0 * math.pi
#: shocks are what accelerometers are for, and references may jump
_NOT_LOOKED_AT = ("ref_", "acc_", TRUE_PREFIX)
#: fewer rows say nothing of what is usual
_LEAST_ROWS = 50


def spikes(values: NDArray[np.float64], *, heading: bool = False) -> NDArray[np.bool_]:
    """Return which rows of a signal (N,) are spikes; the first and the last, and missing values, never are.

    Parameters
    ----------
    values : ndarray (N,)
    heading : bool
        Whether it is an angle that may jump by a turn.
    """
    found = np.zeros(len(values), dtype=bool)
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < _LEAST_ROWS:
        return found
    known = values[rows]
    steps = np.diff(known)
    if heading:
        steps = np.where(np.abs(steps) > 0.5 * _TURN, steps - np.sign(steps) * _TURN, steps)
    there, back = steps[:-1], -steps[1:]
    off = np.where(there * np.sign(back) > 0.0, np.minimum(np.abs(there), np.abs(back)), 0.0)
    left_out = math.ceil(_ENDS * known.size)
    ordered = np.sort(known)
    usual = ordered[-1 - left_out] - ordered[left_out]
    found[rows[1:-1]] = (usual > 0.0) & (off > _FAR * usual)
    return found


def spiked_rows(log: Log, names: Sequence[str]) -> NDArray[np.bool_]:
    """Return which rows of a log (N,) hold a spike in one of these columns."""
    return np.any([spikes(log[name], heading=name == _HEADING) for name in names], axis=0)


def check_spikes(log: Log) -> list[Finding]:
    """Return a warning for each column with spikes."""
    findings = []
    for name in _looked_at(log):
        rows = np.flatnonzero(spikes(log[name], heading=name == _HEADING))
        if not rows.size:
            continue
        time = float(log.t[rows[0]])
        number = "one row" if rows.size == 1 else f"each of {rows.size} rows"
        sentence = (
            f"{name} jumps away and back at {number}, to {log[name][rows[0]]:.6g} at row "
            f"{rows[0] + 1} (t = {time:.6g} s), further than it moves otherwise: a corrupted "
            "message, or a marker of missing values, which a mapping file can name."
        )
        findings.append(
            Finding(severity="warning", code="spike", text=sentence, where=Place(columns=(name,), time=time))
        )
    return findings


def _looked_at(log: Log) -> list[str]:
    known = (name for name in log.names if name in KNOWN_NAMES and name != "t")
    return [name for name in known if not name.startswith(_NOT_LOOKED_AT)]
