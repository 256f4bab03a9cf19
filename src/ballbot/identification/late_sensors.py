"""Sensors that tell late: a row's angles, or its velocities, are those of a moment before its positions.

An IMU's message waits for the next row, its filter lags; velocities that are encoders' differences are means over the
sample that ends. Row k then shows, of a state whose sensor is late by d,

    seen_k = state(t_k - d)                with the states between samples on straight lines

The positions x and y are the clock. A window's start is seen late as well: the true one lies ahead of it by d times the
slope of a first sample simulated from what was seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.quantities import Layout
from ballbot.log import STATE_NAMES

#: which states each quantity delays
_LATE = {
    "imu_delay": tuple(
        STATE_NAMES.index(name + rate) for name in ("theta", "phi", "psi") for rate in ("", "_dot")
    ),
    "velocity_delay": (STATE_NAMES.index("x_dot"), STATE_NAMES.index("y_dot")),
}


def state_delays(layout: Layout, values: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return by how much each state is seen late (sets, 10) [s], for parameters (sets, p); None where none may be."""
    if not set(_LATE) & set(layout.extra):
        return None
    delays = np.zeros((len(values), len(STATE_NAMES)))
    for name, states in _LATE.items():
        part = layout.part(name, values)
        if part is not None:
            delays[:, states] = part
    return delays


def seen_late(
    states: NDArray[np.float64], delays: NDArray[np.float64], sample_time: float
) -> NDArray[np.float64]:
    """Return what late sensors show of states (sets, w, m + 1, 10), the start first: (sets, w, m, 10), of rows 1 to m.

    Parameters
    ----------
    states : ndarray (sets, w, m + 1, 10)
    delays : ndarray (sets, 10)
        [s].
    sample_time : float
        [s].
    """
    m = states.shape[2] - 1
    place = np.arange(1.0, m + 1.0)[:, None] - delays[:, None] / sample_time  # (sets, m, 10), in samples
    before = np.clip(np.floor(place), 0, m - 1).astype(
        np.int64
    )  # beyond the ends, the first and the last line go on
    share = (place - before)[:, None]
    first = np.take_along_axis(states, before[:, None], axis=2)
    second = np.take_along_axis(states, before[:, None] + 1, axis=2)
    return (1.0 - share) * first + share * second
