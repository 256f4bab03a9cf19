"""When a foreign log's robot balances: not fallen, not at rest, motors on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.log.proposal.signals import INTERVAL

#: a lean past this [rad] is a fall or hands
FALLEN = 0.3
#: around a fall, so much is left out [s]
AROUND_A_FALL = 0.5
#: wheels slower than this [rad/s], root of the sum of squares, for `AT_REST` seconds are at rest
MOVING_SPEED = 0.3
AT_REST = 1.0
#: motors without a command for so long are off [s]
OFF = 0.3
#: spans shorter than this are not kept [s], gaps shorter than that are closed
SHORTEST_SPAN = 2.0
SHORTEST_GAP = 0.2


def fallen(lean: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the even rows (N,) at which a lean (N, 2) [rad] is lost."""
    return np.abs(lean).max(axis=1) > FALLEN


def balancing(
    lean: NDArray[np.float64] | None,
    speeds: NDArray[np.float64],
    commands: NDArray[np.float64] | None,
) -> NDArray[np.bool_]:
    """Return the even rows (N,) at which the robot moves and has not fallen.

    Parameters
    ----------
    lean : ndarray (N, 2), optional
        Roll and pitch [rad].
    speeds : ndarray (N, n)
        Wheel speeds [rad/s].
    commands : ndarray (N, n), optional
    """
    usable = _near(np.sqrt((speeds**2).sum(axis=1)) > MOVING_SPEED, AT_REST)
    if lean is not None:
        usable &= ~_near(fallen(lean), AROUND_A_FALL)
    if commands is not None:
        usable &= _near(np.any(commands != 0.0, axis=1), OFF)
    return usable


def spans(rows: NDArray[np.float64], kept: NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
    """Return start and end [s] of the stretches of rows that are kept, short gaps closed, short stretches left."""
    closed = ~_long_runs(~kept, SHORTEST_GAP)
    closed = _long_runs(closed, SHORTEST_SPAN)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], closed, [False])).astype(np.int8)))
    return tuple(
        (float(rows[first]), float(rows[last - 1] + INTERVAL)) for first, last in edges.reshape(-1, 2)
    )


def _near(marked: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Return the rows within `reach` seconds of a marked one."""
    count = round(reach / INTERVAL)
    total = np.concatenate(([0], np.cumsum(marked)))
    places = np.arange(len(marked))
    return total[np.minimum(places + count + 1, len(marked))] > total[np.maximum(places - count, 0)]


def _long_runs(marked: NDArray[np.bool_], least: float) -> NDArray[np.bool_]:
    """Return the marked rows whose run is at least so long [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(np.int8)))
    kept = np.zeros(len(marked), dtype=np.bool_)
    for first, last in edges.reshape(-1, 2):
        kept[first:last] = (last - first) * INTERVAL >= least
    return kept
