"""Smooth values and slopes of signals sampled at uneven times, by a cubic fitted around every row.

The weights are the tricube's (W. S. Cleveland, J. Am. Stat. Assoc. 74 (1979) 829-836), over a fixed number of rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DEGREE = 3


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
    places = np.clip(np.arange(len(t))[:, None] + offsets, 0, len(t) - 1)
    weights = (1.0 - np.abs(offsets / (rows + 1.0)) ** 3) ** 3
    scale = max(float(np.median(t[places[:, -1]] - t[places[:, 0]])) / 2.0, 1e-12)
    powers = ((t[places] - t[:, None]) / scale)[..., None] ** np.arange(DEGREE + 1)
    normal = np.einsum("nki,k,nkj->nij", powers, weights, powers)
    # rows that share one time leave the fit without a slope; this makes it zero
    normal += 1e-9 * np.eye(DEGREE + 1)
    right = np.einsum("nki,k,nkc->nic", powers, weights, values[places] - values[:, None])
    found = np.linalg.solve(normal, right)
    return values + found[:, 0], found[:, 1] / scale
