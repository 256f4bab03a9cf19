"""Motions that repeat themselves, as excitations by Fourier series and strokes to and fro do.

A block of time that is held out says nothing of another record if the same motion, over the same reversals, is in the
blocks that are fitted. Blocks at the same part of a repeated motion are therefore held out together, and count as one
where errors of blocks are compared.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: a motion repeats itself if the position after this time differs by less than this share of its standard deviation;
#: a loop that follows its reference differs by a few percent at most
_SAME_MOTION = 0.05
#: a motion has at least so many parts, two for each that is held out
LEAST_PARTS = 6
#: positions that are compared, evenly spaced, and the largest share of the record that the time may be
_COMPARED, _LARGEST_SHARE = 2000, 2.0 / 3.0


def repetition_time(t: NDArray[np.float64], position: NDArray[np.float64]) -> float:
    """Return the time [s] after which positions at times t (N,) repeat themselves; infinite if they do not."""
    step = float(t[-1] - t[0]) / _COMPARED
    position = np.interp(t[0] + step * np.arange(_COMPARED), t, position)
    variance = float(np.var(position))
    lags = np.arange(1, int(_LARGEST_SHARE * _COMPARED))
    apart = np.array([np.mean((position[lag:] - position[:-lag]) ** 2) for lag in lags])
    # neighbours in time are alike, too
    away = np.flatnonzero(apart > variance)
    if not len(away):
        return np.inf
    alike = np.flatnonzero(apart < _SAME_MOTION**2 * variance)
    alike = alike[alike > away[0]]
    if not len(alike):
        return np.inf
    # the least of the first run of such times
    run = alike[: int(np.argmax(np.append(np.diff(alike) > 1, True))) + 1]
    return float(step * lags[run[np.argmin(apart[run])]])


def parts_in(repetition: float, duration: float) -> int:
    """Return how many blocks of about that duration [s] one motion has; zero if it does not repeat, or has too few."""
    count = round(repetition / duration) if np.isfinite(repetition) else 0
    return count if count >= LEAST_PARTS else 0


def parts_at(times: NDArray[np.float64], repetition: float, count: int) -> NDArray[np.int64]:
    """Return in which of `count` equal parts of a motion that repeats itself times (n,) are [s]."""
    return np.minimum(np.mod(times, repetition) / repetition * count, count - 1).astype(np.int64)
