"""How sure each number is: standard errors clustered by window, correlations, and what has no influence.

Residuals within a window are one trajectory and far from independent, so the usual s^2 (J^T J)^-1 is several
times too small. With a window's score g_w = J_w^T r_w the covariance is

    H^-1 (sum_w g_w g_w^T) H^-1 W / (W - 1)          H = sum_w J_w^T J_w

(K.-Y. Liang and S. L. Zeger, Longitudinal data analysis using generalized linear models, Biometrika 73 (1986) 13-22).
A window's residuals are smaller than its errors were, as the fit follows them, the more the fewer windows there are.
Where each window's H_w is known its score is therefore taken without that, (I - H_w H^-1)^-1 g_w, which makes of the
above the jackknife that leaves out one window after another (R. Bell and D. McCaffrey, Bias reduction in standard
errors for linear regression with multi-stage samples, Survey Methodology 28 (2002) 169-181).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.problem import NormalEquations

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


def unleveraged(
    matrices: NDArray[np.float64], scores: NDArray[np.float64], estimated: NDArray[np.bool_]
) -> NormalEquations:
    """Return normal equations whose scores are those of errors and not of residuals, see the module's text.

    Parameters
    ----------
    matrices : ndarray (w, p, p)
        J^T J of each window.
    scores : ndarray (w, p)
    estimated : ndarray (p,)
        Which parameters the fit moved; the other scores stay.
    """
    places = np.flatnonzero(estimated)
    matrix, result = matrices.sum(axis=0), scores.copy()
    if len(places):
        own = matrices[:, places[:, None], places]
        # scaled, so that what is held against what does not depend on units
        scale = 1.0 / np.sqrt(np.maximum(matrix.diagonal()[places], np.finfo(float).tiny))
        own, total = own * np.outer(scale, scale), matrix[np.ix_(places, places)] * np.outer(scale, scale)
        # (I - H_w H^-1)^-1 = H (H - H_w)^-1; one window may be all that tells a parameter
        rest = total - own + 1e-12 * np.eye(len(places))
        scaled = np.linalg.solve(rest, (scores[:, places] * scale)[..., None])[..., 0]
        result[:, places] = np.einsum("ij,wj->wi", total, scaled, optimize=False) / scale
    return NormalEquations(matrix=matrix, scores=result)


def without_influence(equations: NormalEquations) -> NDArray[np.bool_]:
    """Return which parameters (p,) the residuals hardly depend on, even with all others known."""
    H = equations.matrix.diagonal()
    spread = np.sqrt((equations.scores**2).sum(axis=0))
    # one unit of H is one residual as large as its standard deviation, over a parameter's whole range
    return (H < 1.0) | (spread > NO_INFLUENCE * H)


def correlation(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the correlation matrix (p, p) of a covariance; NaN where that is."""
    variance = covariance.diagonal()
    deviation = np.sqrt(np.where(variance > 0.0, variance, np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        return covariance / np.outer(deviation, deviation)


def _inverse(H: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return H^-1, with directions that the data say nothing of kept, as very uncertain ones."""
    scale = 1.0 / np.sqrt(H.diagonal())
    values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-13 * values[-1])) @ vectors.T
    return inverse * np.outer(scale, scale)
