"""Wheel encoders whose counts begin again after a power of two, as those of absolute encoders and of short counters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.names import read_names
from ballbot.log.mapping_inference.roles import PLAIN
from ballbot.log.signals import unwrapped

#: bits of the encoders and counters that are recognised
BITS = range(8, 17)
#: a column that begins again fills this share of its range, and otherwise moves by less than this share in a row
FILLED, LARGEST_STEP = 0.95, 0.25
#: kinds that a numbered series must not have by its names
_OTHERS = ("time", "counter", "gyro", "accelerometer", "attitude", "command", "wheel speed", "reference")


def wrapped_encoders(
    columns: Mapping[str, NDArray[np.float64]], units: Mapping[str, str], wheel_count: int
) -> tuple[tuple[str, ...], int] | None:
    """Return the columns of encoders that begin again after a power of two, and this number of counts; None without.

    They are as many whole numbers of one name as there are wheels, none of them leaves the range, and one of them at
    least jumps from end to end of it.

    Parameters
    ----------
    columns : mapping of str to (M,) array
    units : mapping of str to str
        By column, as a row below the header has them.
    wheel_count : int
    """
    series: dict[str, list[str]] = {}
    for one in read_names(list(columns), units):
        if one.index is not None and not (one.kind in _OTHERS and one.weight >= PLAIN):
            series.setdefault(one.stem, []).append(one.name)
    for names in series.values():
        period = _period([columns[name] for name in names]) if len(names) == wheel_count else None
        if period is not None:
            return tuple(names), period
    return None


def _period(values: Sequence[NDArray[np.float64]]) -> int | None:
    """Return after how many counts columns begin again; None if they do not."""
    known = [one[np.isfinite(one)] for one in values]
    if not all(len(one) > 1 and np.array_equal(one, np.round(one)) for one in known):
        return None
    least, largest = min(one.min() for one in known), max(one.max() for one in known)
    for bits in BITS:
        period = 2**bits
        if not (least >= 0 and largest < period) and not (-period / 2 <= least and largest < period / 2):
            continue
        whole = [np.abs(np.diff(unwrapped(one, period=period))).max() for one in known]
        filled = [
            np.ptp(one) > FILLED * period and np.abs(np.diff(one)).max() > 0.5 * period for one in known
        ]
        return period if any(filled) and max(whole) < LARGEST_STEP * period else None
    return None
