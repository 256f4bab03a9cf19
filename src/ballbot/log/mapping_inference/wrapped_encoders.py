"""Wheel encoders whose counts begin again: absolute encoders, short counters, counters that start anew at each turn.

Where a column jumps from one end of its range to the other, the jump and the steps beside it show after how many counts
it begins again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.names import read_names
from ballbot.log.mapping_inference.roles import PLAIN
from ballbot.log.signals import unwrapped

#: counts of encoders and counters of 8 to 16 bits, and of those with a decimal number of lines
BINARY = tuple(2**bits for bits in range(8, 17))
DECIMAL = (500, 1000, 2000, 2500, 4000, 5000, 8000, 10000, 16000, 20000)
#: the jumps show the period to so many counts, or to this part of it; 500 and 512, the nearest two, are 2.4 % apart
_COUNTS_OFF, _PART_OFF = 2.0, 0.003
#: jumps that must agree on a period that is no power of two
_DECIMAL_JUMPS = 3
#: a column that begins again fills this share of its range, and otherwise moves by less than this share in a row
FILLED, LARGEST_STEP = 0.95, 0.25
#: kinds that a numbered series must not have by its names
_OTHERS = ("time", "counter", "gyro", "accelerometer", "attitude", "command", "wheel speed", "reference")


def wrapped_encoders(
    columns: Mapping[str, NDArray[np.float64]],
    units: Mapping[str, str],
    wheel_count: int,
    *,
    encoder_counts: int = 0,
) -> tuple[tuple[str, ...], int] | None:
    """Return the columns of encoders that begin again after a usual number of counts, and this number; None without.

    They are as many whole numbers of one name as there are wheels, none of them leaves the range, and one of them at
    least jumps from end to end of it.

    Parameters
    ----------
    columns : mapping of str to (M,) array
    units : mapping of str to str
        By column, as a row below the header has them.
    wheel_count : int
    encoder_counts : int
        Of the robot file, after which they may begin again, too; 0 if none is known.
    """
    series: dict[str, list[str]] = {}
    for one in read_names(list(columns), units):
        if one.index is not None and not (one.kind in _OTHERS and one.weight >= PLAIN):
            series.setdefault(one.stem, []).append(one.name)
    for names in series.values():
        if len(names) != wheel_count:
            continue
        period = _period([columns[name] for name in names], encoder_counts)
        if period is not None:
            return tuple(names), period
    return None


def _period(values: Sequence[NDArray[np.float64]], encoder_counts: int) -> int | None:
    """Return after how many counts columns begin again; None if they do not."""
    known = [one[np.isfinite(one)] for one in values]
    if not all(len(one) > 1 and np.array_equal(one, np.round(one)) for one in known):
        return None
    shown = np.concatenate([_shown_by_jumps(one) for one in known])
    if not shown.size:
        return None
    measured = float(np.median(shown))
    usual = [*BINARY, *([encoder_counts, *DECIMAL] if len(shown) >= _DECIMAL_JUMPS else [])]
    period = min((one for one in usual if one > 0), key=lambda one: abs(one - measured))
    if abs(period - measured) > max(_COUNTS_OFF, _PART_OFF * period):
        return None
    least, largest = min(one.min() for one in known), max(one.max() for one in known)
    if not (least >= 0 and largest < period) and not (-period / 2 <= least and largest < period / 2):
        return None
    whole = [np.abs(np.diff(unwrapped(one, period=period))).max() for one in known]
    filled = [np.ptp(one) > FILLED * period and np.abs(np.diff(one)).max() > 0.5 * period for one in known]
    return period if any(filled) and max(whole) < LARGEST_STEP * period else None


def _shown_by_jumps(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each jump of a column (M,) from end to end the period that it and the steps beside it show."""
    steps = np.diff(counts)
    jumps = np.abs(steps) > 0.5 * np.ptp(counts)
    places = np.flatnonzero(jumps)
    places = places[(places > 0) & (places < len(steps) - 1)]
    places = places[~(jumps[places - 1] | jumps[places + 1])]
    return np.abs(steps[places] - 0.5 * (steps[places - 1] + steps[places + 1]))
