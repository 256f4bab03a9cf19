"""Which stretches of a log are kept from the fit, to judge it by.

Identification fits short windows; validation in closed loop and in open loop to a fall needs seconds in one piece. So
whole stretches are kept: 8 s out of every 28 s. As 28 s is not a multiple of the 8 s or 32 s that references like to
repeat with, the stretches do not always hold the same piece of the path.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbot.log import STATE_NAMES, Log
from ballbot.validation.models import Interval

_CYCLE = 28.0  #: [s] from one stretch's start to the next one's
_BEFORE = 12.0  #: [s] of a cycle before its stretch
_STRETCH = 8.0  #: [s]


def held_out_stretches(log: Log) -> tuple[Interval, ...]:
    """Return the (start, end) [s] of the stretches; a log shorter than a cycle has one, in proportion."""
    first, duration = float(log.t[0]), float(log.t[-1] - log.t[0])
    scale = min(1.0, duration / _CYCLE)
    starts = np.arange(_BEFORE * scale, duration - 0.5 * _STRETCH * scale, _CYCLE * scale)
    ends = np.minimum(starts + _STRETCH * scale, duration)
    return tuple((first + float(start), first + float(end)) for start, end in zip(starts, ends, strict=True))


def without(log: Log, stretches: Sequence[Interval]) -> Log:
    """Return the log with its states missing in the stretches; identification passes over what is missing."""
    kept = np.ones(len(log), dtype=bool)
    for start, end in stretches:
        kept &= (log.t < start) | (log.t >= end)
    return log.with_columns({name: np.where(kept, log[name], np.nan) for name in STATE_NAMES})
