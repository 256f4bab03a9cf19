"""A Kalman filter's two linear steps, compiled: the covariance on, and one number seen at a time.

Seen numbers are taken in one after the other, each as a row h of the measurement matrix with a variance r of its
own, so that no matrix is inverted. Joseph's form keeps the covariance symmetric and positive whatever the gain's
rounding (Bucy and Joseph, Filtering for Stochastic Processes with Applications to Guidance, 1968, chapter 16):

    k = P h / (h^T P h + r)        P+ = (I - k h^T) P (I - k h^T)^T + k r k^T
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.compiled import compiled


@compiled
def propagate(P: NDArray[np.float64], F: NDArray[np.float64], Q: NDArray[np.float64]) -> None:
    """Overwrite the covariance P (m, m) by F P F^T + Q, made symmetric."""
    spread = np.dot(np.dot(F, P), F.T)
    m = len(P)
    for i in range(m):
        for j in range(i + 1):
            P[i, j] = 0.5 * (spread[i, j] + spread[j, i]) + Q[i, j]
            P[j, i] = P[i, j]


@compiled
def absorb(
    x: NDArray[np.float64],
    P: NDArray[np.float64],
    residuals: NDArray[np.float64],
    rows: NDArray[np.float64],
    variances: NDArray[np.float64],
) -> float:
    """Take in p numbers that were seen, changing the state x (m,) and its covariance P (m, m).

    Parameters
    ----------
    x, P : arrays (m,), (m, m)
        Overwritten.
    residuals : array (p,)
        Seen less expected at the x given.
    rows : array (p, m)
        What was seen, derived by x.
    variances : array (p,)
        Of each number's own error, independent of the others'.

    Returns
    -------
    float
        Sum of the squared residuals over their variances, each given those before it: chi-squared with p degrees of
        freedom where the filter's sizes are right.
    """
    m = len(x)
    change = np.zeros(m)
    surprise = 0.0
    for i in range(len(residuals)):
        h = rows[i]
        Ph = np.dot(P, h)
        variance = np.dot(h, Ph) + variances[i]
        residual = residuals[i] - np.dot(h, change)
        surprise += residual * residual / variance
        k = Ph / variance
        change += k * residual
        half = P - np.outer(k, Ph)  # (I - k h^T) P
        half_h = np.dot(half, h)
        for a in range(m):
            for b in range(a + 1):
                P[a, b] = half[a, b] - half_h[a] * k[b] + k[a] * variances[i] * k[b]
                P[b, a] = P[a, b]
    x += change
    return surprise
