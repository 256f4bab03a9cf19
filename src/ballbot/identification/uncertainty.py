"""How sure each number is: standard errors clustered by window, correlations, and what has no influence.

Residuals within a window are one trajectory and far from independent, so the usual s^2 (J^T J)^-1 is several
times too small. With a window's score g_w = J_w^T r_w the covariance is

    H^-1 (sum_w g_w g_w^T) H^-1 W / (W - 1)          H = sum_w J_w^T J_w

(K.-Y. Liang and S. L. Zeger, Longitudinal data analysis using generalized linear models, Biometrika 73 (1986) 13-22).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.polish import NormalEquations

#: a parameter has no influence where its standard error, all others known, is this share of its range
NO_INFLUENCE = 0.5


def covariance(equations: NormalEquations, estimated: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the clustered covariance (p, p) in scaled coordinates; NaN for parameters not `estimated` (p,)."""
    places = np.flatnonzero(estimated)
    result = np.full((len(estimated), len(estimated)), np.nan)
    if len(places):
        inverse = _inverse(equations.matrix[np.ix_(places, places)])
        scores = equations.scores[:, places]
        spread = np.einsum("wi,wj->ij", scores, scores, optimize=False)
        count = len(scores)
        result[np.ix_(places, places)] = count / (count - 1) * inverse @ spread @ inverse
    return result


def without_influence(equations: NormalEquations) -> NDArray[np.bool_]:
    """Return which parameters (p,) the residuals hardly depend on, even with all others known."""
    H = equations.matrix.diagonal()
    spread = np.sqrt((equations.scores**2).sum(axis=0))
    # one unit of H is one residual as large as its standard deviation, over a parameter's whole range
    return (H < 1.0) | (spread > NO_INFLUENCE * H)


def correlation(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the correlation matrix (p, p) of a covariance; NaN where that is."""
    deviation = np.sqrt(covariance.diagonal())
    with np.errstate(divide="ignore", invalid="ignore"):
        return covariance / np.outer(deviation, deviation)


def _inverse(H: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return H^-1, with directions that the data say nothing of kept, as very uncertain ones."""
    scale = 1.0 / np.sqrt(H.diagonal())
    values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-13 * values[-1])) @ vectors.T
    return inverse * np.outer(scale, scale)
