"""The value of a sensor or a command at other times than those of its rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.log.signals import new_messages, without_holes

#: [s] by which rounding may move a delayed row past the one it belongs to
ROUNDING = 1e-9


def measured_at(
    rows: NDArray[np.float64],
    sampled: NDArray[np.float64],
    values: NDArray[np.float64],
    delay: float,
    *,
    shift: bool,
) -> NDArray[np.float64]:
    """Return a sensor's values (N,) reported `delay` after the rows' times, interpolated linearly."""
    if not (shift or delay):
        return values
    first = new_messages(sampled) if shift else slice(None)
    return np.interp(rows + delay, sampled[first], without_holes(sampled[first], values[first]))


def acting_at(t: NDArray[np.float64], values: NDArray[np.float64], delay: float) -> NDArray[np.float64]:
    """Return the command that acts at t: the last one logged at t - delay or before."""
    if not delay:
        return values
    latest = np.searchsorted(t, t - delay + ROUNDING, side="right") - 1
    return values[np.maximum(latest, 0)]


def mean_acting(
    t: NDArray[np.float64], rows: NDArray[np.float64], values: NDArray[np.float64], delay: float
) -> NDArray[np.float64]:
    """Return the mean of the command that acts from each row to the next; missing where a part of it is."""
    step = rows[1] - rows[0] if len(rows) > 1 else 1.0
    edges = np.append(rows, rows[-1] + step) - delay
    values = without_holes(t, values, held=True)
    known = np.isfinite(values)

    def mean(acting: NDArray[np.float64]) -> NDArray[np.float64]:
        impulse = np.concatenate(([0.0], np.cumsum(acting[:-1] * np.diff(t))))
        return np.diff(np.interp(edges, t, impulse)) / step

    means = mean(np.where(known, values, 0.0))
    return means if known.all() else np.where(mean((~known).astype(float)) > 1e-9, np.nan, means)
