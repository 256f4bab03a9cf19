"""Smooth signals and their derivatives on even rows, for tests of a foreign log.

A value, rate or acceleration at a row is that of the cubic fitted around it with Gaussian weights: one filter for all
signals, so that a linear relation between them is kept, whatever the filter takes away.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from ballbot.sizes import rows_between

#: interval of the even rows [s]
INTERVAL = 0.005
#: standard deviation of the weights [s]: balancing happens at 1 to 3 Hz, an IMU's noise is above
WIDTH = 0.05
DEGREE = 3
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
    powers = np.vander(x, DEGREE + 1, increasing=True)
    fit = np.linalg.solve(powers.T @ (weights[:, None] * powers), (powers * weights[:, None]).T)
    return factorial(order) * fit[order][::-1]
