"""Which rows of a log a validation may start from: stretches without gaps, and starts within them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log

Interval = tuple[float, float]

#: an interval longer than this many sample times is a gap, across which nothing may be predicted
_GAP = 1.5


def stretches(log: Log, held_out: Sequence[Interval] | None = None) -> list[range]:
    """Return the runs of rows that follow each other without a gap.

    Parameters
    ----------
    log : Log
    held_out : sequence of (start, end), optional
        Times [s] that count, start <= t < end; without it, the whole log.

    Raises
    ------
    InputError
        Where nothing of the log lies in `held_out`.
    """
    counts = np.ones(len(log), dtype=bool)
    if held_out is not None:
        counts = np.any([(log.t >= start) & (log.t < end) for start, end in held_out], axis=0)
        if not np.any(counts):
            raise InputError(
                "No row of the log lies in the held-out intervals; "
                f"the log runs from {log.t[0]:g} to {log.t[-1]:g} s."
            )
    breaks = np.flatnonzero(np.diff(log.t) > _GAP * log.sample_time) + 1
    found = []
    for part in np.split(np.arange(len(log)), breaks):
        inside = part[counts[part]]
        for rows in np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1):
            if len(rows) > 1:
                found.append(range(int(rows[0]), int(rows[-1]) + 1))
    return found


def window_starts(parts: Sequence[range], *, samples: int, every: int) -> NDArray[np.int64]:
    """Return the rows from which `samples` steps stay within one of `parts`, `every` rows apart (starts,)."""
    starts = [np.arange(part.start, part.stop - samples, every) for part in parts]
    return np.concatenate([*starts, np.empty(0)]).astype(np.int64)


def rows_after(starts: NDArray[np.int64], samples: int) -> NDArray[np.int64]:
    """Return the rows (starts, samples) that follow each start: start + 1 .. start + samples."""
    return starts[:, None] + np.arange(1, samples + 1)
