"""Smooth values and slopes of signals sampled at uneven times, by a cubic fitted around every row.

The weights are the tricube's (W. S. Cleveland, J. Am. Stat. Assoc. 74 (1979) 829-836), over a fixed number of rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DEGREE = 3
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
        powers = ((t[places] - t[block, None]) / scale)[..., None] ** np.arange(DEGREE + 1)
        normal = np.einsum("nki,k,nkj->nij", powers, weights, powers)
        # rows that share one time leave the fit without a slope; this makes it zero
        normal += 1e-9 * np.eye(DEGREE + 1)
        right = np.einsum("nki,k,nkc->nic", powers, weights, values[places] - values[block, None])
        found = np.linalg.solve(normal, right)
        smooth[block], rates[block] = values[block] + found[:, 0], found[:, 1] / scale
    return smooth, rates
