"""Least squares with standard errors that allow for residuals related in time.

What is left of kinematics is slip, play and rollers, the same for many windows on end. The windows are therefore
taken in clusters as long as that lasts, and the covariance is the jackknife's: with cluster c left out the estimate
moves by d_c = (H - H_c)^-1 g_c, H = J^T J, g_c = J_c^T r_c, and

    covariance = (C - 1) / C sum_c d_c d_c^T

(B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982). With some twenty clusters the sandwich
H^-1 (sum g_c g_c^T) H^-1 is too small: its 95 % intervals held 91 % of true values in a trial.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ballbot.errors import InputError

#: clusters, at the least, for each parameter; fewer make a covariance too small
CLUSTERS_PER_PARAMETER = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A least-squares estimate of p parameters."""

    values: NDArray[np.float64]  #: (p,)
    covariance: NDArray[np.float64]  #: (p, p)
    residuals: NDArray[np.float64]  #: (w, k)

    @property
    def errors(self) -> NDArray[np.float64]:
        """Standard errors (p,)."""
        return np.sqrt(self.covariance.diagonal())

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fit_clustered(
    residuals_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    start: NDArray[np.float64],
    *,
    scales: NDArray[np.float64],
    clusters: NDArray[np.int64],
) -> Fit:
    """Minimise the squares of residuals.

    Parameters
    ----------
    residuals_of : callable
        From parameters (p,) to residuals (w, k) of w windows.
    start : ndarray (p,)
    scales : ndarray (p,)
        Changes of the parameters that matter; differences are taken over a hundredth of them.
    clusters : ndarray (w,)
        Number of the cluster that each window belongs to.

    Raises
    ------
    InputError
        Where there are too few clusters for the parameters, or the windows do not determine them.
    """
    names, places = np.unique(clusters, return_inverse=True)
    least = CLUSTERS_PER_PARAMETER * len(start)
    if len(names) < least:
        raise InputError(
            f"The logs have {len(names)} intervals of usable motion for "
            f"{len(start)} unknowns, which need {least}; log for longer."
        )

    def scaled_residuals(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return residuals_of(start + z * scales).ravel()

    found = least_squares(scaled_residuals, np.zeros(len(start)), jac="3-point", diff_step=1e-2, x_scale=1.0)
    values = start + found.x * scales
    residuals = residuals_of(values)
    J = _jacobian(residuals_of, values, scales)
    H = np.einsum("wki,wkj->ij", J, J)
    if np.linalg.cond(H) > 1e10:
        raise InputError(
            "The motion in these logs does not determine the "
            "geometry; move in both directions and turn all wheels."
        )
    count, moves = len(names), []
    for cluster in range(count):
        inside = places == cluster
        own = np.einsum("wki,wkj->ij", J[inside], J[inside])
        score = np.einsum("wki,wk->i", J[inside], residuals[inside])
        moves.append(np.linalg.lstsq(H - own, score, rcond=None)[0])
    covariance = (count - 1) / count * np.array(moves).T @ np.array(moves)
    return Fit(values=values, covariance=covariance * np.outer(scales, scales), residuals=residuals)


def _jacobian(
    residuals_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    values: NDArray[np.float64],
    scales: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the derivatives (w, k, p) by values / scales, by central differences."""
    columns = []
    for place, scale in enumerate(scales):
        step = np.zeros(len(values))
        step[place] = 1e-2 * scale
        columns.append((residuals_of(values + step) - residuals_of(values - step)) / 2e-2)
    return np.stack(columns, axis=-1)
