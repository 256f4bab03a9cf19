"""Smooth values, rates and accelerations of logged signals, their turning points, and the rows where a robot balances.

`local_fit` fits a cubic around every row of a signal sampled at uneven times, with the weights of the tricube
(W. S. Cleveland, J. Am. Stat. Assoc. 74 (1979) 829-836) over a fixed number of rows.

`smooth` gives a value, rate and acceleration on even rows, from the cubic fitted around each row with Gaussian weights:
one filter for all signals, so that a linear relation between them is kept, whatever the filter removes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import rows_between

_LOCAL_DEGREE = 3
#: rows fitted at once; more would take much memory and not less time
_AT_ONCE = 2000


def local_fit(
    t: NDArray[np.float64], values: NDArray[np.float64], *, rows: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the fitted values and their rates at every row.

    Parameters
    ----------
    t : ndarray (N,)
        Times, not falling; a time may stand twice.
    values : ndarray (N, c)
    rows : int
        Taken on each side of a row.

    Returns
    -------
    tuple of ndarray (N, c)
        Values, and rates in units of `values` over those of `t`.
    """
    offsets = np.arange(-rows, rows + 1)
    weights = (1.0 - np.abs(offsets / (rows + 1.0)) ** 3) ** 3
    every = np.arange(len(t))
    reach = t[np.minimum(every + rows, len(t) - 1)] - t[np.maximum(every - rows, 0)]
    scale = max(float(np.median(reach)) / 2.0, 1e-12)
    smooth, rates = np.empty_like(values), np.empty_like(values)
    for first in range(0, len(t), _AT_ONCE):
        block = every[first : first + _AT_ONCE]
        places = np.clip(block[:, None] + offsets, 0, len(t) - 1)
        powers = ((t[places] - t[block, None]) / scale)[..., None] ** np.arange(_LOCAL_DEGREE + 1)
        normal = np.einsum("nki,k,nkj->nij", powers, weights, powers)
        # rows that share one time leave the fit without a slope; this makes it zero
        normal += 1e-9 * np.eye(_LOCAL_DEGREE + 1)
        right = np.einsum("nki,k,nkc->nic", powers, weights, values[places] - values[block, None])
        found = np.linalg.solve(normal, right)
        smooth[block], rates[block] = values[block] + found[:, 0], found[:, 1] / scale
    return smooth, rates


#: interval of the even rows [s]
INTERVAL = 0.005
#: standard deviation of the weights [s]: balancing happens at 1 to 3 Hz, an IMU's noise is above
WIDTH = 0.05
_DEGREE = 3
#: how many standard deviations of the weights are taken to each side
REACH = 4.0
#: made of one log at a time
_COLUMNS = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Smooth:
    """A signal (N, c) on even rows."""

    value: NDArray[np.float64]
    rate: NDArray[np.float64]
    acceleration: NDArray[np.float64]


def even_rows(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return times at even intervals over a log's (M,); InputError if they are too many."""
    rows_between(float(t[-1] - t[0]), INTERVAL, columns=_COLUMNS, source="The log")
    return np.arange(t[0], t[-1], INTERVAL)


def smooth(
    rows: NDArray[np.float64], t: NDArray[np.float64], values: NDArray[np.float64], *, width: float = WIDTH
) -> Smooth:
    """Return a signal and its derivatives on even rows; near the ends it is fitted from one side.

    Parameters
    ----------
    rows : ndarray (N,)
        [s], at intervals of `INTERVAL`.
    t : ndarray (M,)
        When the values were measured [s], rising.
    values : ndarray (M, c)
    width : float
        Standard deviation of the weights [s].
    """
    reach = round(REACH * width / INTERVAL)
    even = np.column_stack([np.interp(rows, t, column) for column in values.T])
    padded = np.pad(even, ((reach, reach), (0, 0)), mode="edge")
    kernels = [_kernel(order, reach, width) for order in range(3)]
    value, rate, acceleration = (
        np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])
        for kernel in kernels
    )
    return Smooth(value=value, rate=rate, acceleration=acceleration)


def _kernel(order: int, reach: int, width: float) -> NDArray[np.float64]:
    """Return what, convolved with a signal, gives its derivative of that order."""
    x = INTERVAL * np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (x / width) ** 2)
    powers = np.vander(x, _DEGREE + 1, increasing=True)
    fit = np.linalg.solve(powers.T @ (weights[:, None] * powers), (powers * weights[:, None]).T)
    return factorial(order) * fit[order][::-1]


def turning_points(values: NDArray[np.float64], least_turn: float) -> list[int]:
    """Return the first row of a signal (n,), the rows where it turns back by more than `least_turn`, and the last."""
    turns, highest, lowest, rising = [0], 0, 0, 0
    listed = values.tolist()
    for row, value in enumerate(listed):
        highest = row if value > listed[highest] else highest
        lowest = row if value < listed[lowest] else lowest
        if rising >= 0 and value < listed[highest] - least_turn:
            turns.append(highest)
            rising, lowest = -1, row
        elif rising <= 0 and value > listed[lowest] + least_turn:
            turns.append(lowest)
            rising, highest = 1, row
    # a signal that sets out at once has turned nowhere yet
    first = 2 if len(turns) > 1 and turns[1] == 0 else 1
    return [0, *turns[first:], len(listed) - 1]


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


def fallen_rows(lean: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the even rows (N,) at which a lean (N, 2) [rad] is lost."""
    return np.abs(lean).max(axis=1) > FALLEN


def balancing_rows(
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
        usable &= ~_near(fallen_rows(lean), AROUND_A_FALL)
    if commands is not None:
        usable &= _near(np.any(commands != 0.0, axis=1), OFF)
    return usable


def row_spans(rows: NDArray[np.float64], kept: NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
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
