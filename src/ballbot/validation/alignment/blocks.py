"""Errors of a least-squares fit to a time series, whose residuals go together over seconds: clustered by blocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

#: length of a block [s], and how many there are at least
_BLOCK = 5.0
_LEAST_BLOCKS = 8


def clustered(
    J: NDArray[np.float64],
    residuals: NDArray[np.float64],
    times: NDArray[np.float64],
    inverse: NDArray[np.float64],
    *,
    weights: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], float]:
    """Return the covariance of the parameters and Student's t for 95 % with as many blocks.

    The sandwich of K.-Y. Liang and S. Zeger, Biometrika 73 (1986) 13-22: within a block, anything may go together.

    Parameters
    ----------
    J : ndarray (n, c, p)
        Derivative of the residuals by the parameters.
    residuals : ndarray (n, c)
    times : ndarray (n,)
        Of the residuals [s], increasing.
    inverse : ndarray (p, p)
        Of the weighted J^T J.
    weights : ndarray (n,), optional
    """
    length = max(min(_BLOCK, (times[-1] - times[0]) / _LEAST_BLOCKS), 1e-9)
    block = ((times - times[0]) / length).astype(np.int64)
    w = np.ones(len(times)) if weights is None else weights
    sums = np.zeros((int(block[-1]) + 1, J.shape[2]))
    np.add.at(sums, block, np.einsum("k,kij,ki->kj", w, J, residuals))
    count = len(np.unique(block))
    meat = sums.T @ sums * count / max(count - 1, 1)
    return inverse @ meat @ inverse, float(stats.t.ppf(0.975, max(count - 1, 1)))


def fitted(
    J: NDArray[np.float64], values: NDArray[np.float64], times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the parameters (p,) with which J explains the values (n, c), and their 95 % half widths (p,)."""
    flat = J.reshape(-1, J.shape[2])
    inverse = np.linalg.pinv(flat.T @ flat).astype(np.float64)
    found = inverse @ flat.T @ values.ravel()
    covariance, quantile = clustered(J, values - J @ found, times, inverse)
    return found, quantile * np.sqrt(np.diag(covariance))
