"""How sure the numbers are where residuals depend on their neighbours.

    (J^T J)^-1 S (J^T J)^-1      S = sum_|k| <= L (1 - |k|/(L + 1)) sum_b g_b g_(b+k)^T      g_b = J_b^T r_b

with the rows taken together in blocks b of time, and neighbouring blocks with falling weights: W. Newey and K. West,
A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix, Econometrica
55 (1987) 703-708. With L = 0 it is the clustered one of `ballbot.identification.uncertainty`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def clustered_covariance(
    J: NDArray[np.float64], residual: NDArray[np.float64], block: NDArray[np.int64], *, neighbours: int = 0
) -> NDArray[np.float64]:
    """Return the covariance (p, p) of a least-squares estimate.

    Parameters
    ----------
    J : ndarray (m, p)
        Of the residuals by the parameters.
    residual : ndarray (m,)
    block : ndarray (m,)
        The number of each row's block, from 0 in the order of time.
    neighbours : int
        L, how many blocks on either side depend on each other.
    """
    count = int(block.max()) + 1
    scores = np.zeros((count, J.shape[1]))
    np.add.at(scores, block, J * residual[:, None])
    spread = scores.T @ scores
    for k in range(1, min(neighbours, count - 1) + 1):
        both = scores[:-k].T @ scores[k:]
        spread += (1.0 - k / (neighbours + 1.0)) * (both + both.T)
    # columns of length one first: mass, viscosity and stiffness are of very different sizes
    lengths = np.linalg.norm(J, axis=0)
    scaled = J / lengths
    inverse = np.linalg.pinv(scaled.T @ scaled, hermitian=True) / np.outer(lengths, lengths)
    return count / max(count - 1, 1) * inverse @ spread @ inverse
