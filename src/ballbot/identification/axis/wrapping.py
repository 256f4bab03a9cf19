"""Positions that begin again after a turn, or after the whole range of a counter.

A step of nearly one such period is no motion if all other steps are far smaller: the position is unwrapped. The periods
looked for are a turn, in radians and in degrees, and the ranges of counters of 8 to 32 bits, in the unit that the
position's factor gives them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.log.signals import unwrapped

TURN, DEGREES = 2.0 * np.pi, 360.0
_BITS = (8, 10, 12, 13, 14, 15, 16, 17, 18, 20, 24, 32)
#: an ordinary step is at most this share of the period; a jump differs from the period by no more than such a step
_LARGEST_STEP = 0.25
#: noise and rounding let a position that wraps cover so much more than its period, and a jump that much more, too
_BEYOND = 0.01


def wrapping_period(position: NDArray[np.float64], scale: float) -> float:
    """Return the period after which a position (N,) begins again; zero for one that does not.

    Parameters
    ----------
    position : ndarray (N,)
        May contain NaN.
    scale : float
        Factor that was applied to the position as it was recorded.
    """
    known = position[np.isfinite(position)]
    if len(known) < 2:
        return 0.0
    travel, steps = float(np.ptp(known)), np.abs(np.diff(known))
    counters = [2.0**bits * abs(scale) for bits in _BITS]
    # of a jump of two periods' size only the right one is within an ordinary step
    for period in (TURN, DEGREES, *counters):
        if not 0.5 * period < travel <= (1.0 + _BEYOND) * period:
            continue
        jumps = steps > 0.5 * period
        usual = float(steps[~jumps].max(initial=0.0))
        if not jumps.any() or usual > _LARGEST_STEP * period:
            continue
        # the axis moves on during the step in which it wraps
        if np.abs(steps[jumps] - period).max() <= 2.0 * usual + _BEYOND * period:
            return period
    return 0.0


def without_wraps(position: NDArray[np.float64], period: float) -> tuple[NDArray[np.float64], int]:
    """Return a position (N,) unwrapped, NaN where it is NaN, and how often it wraps."""
    found = unwrapped(position, period=period)
    turns = np.round((found - position) / period)
    return found, int(np.count_nonzero(np.diff(turns[np.isfinite(turns)])))
