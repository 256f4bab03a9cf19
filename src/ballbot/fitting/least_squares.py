"""Least squares of residuals that depend on each other in time, with standard errors that allow for it.

`minimize_squares` descends in any parameters within bounds. `fit_linear` fits a model that is linear in its parameters
and tests them.

Tests of linear parameters. Within a block of time, errors may depend on each other in any way. For q parameters,
W = p^T V^-1 p with the covariance V of `ballbot.fitting.uncertainty.covariance_in_time` is tested as Hotelling's T^2 of
G blocks, W (G - q) / (q (G - 1)) ~ F(q, G - q), with G the blocks in which the least frequent of the q columns is not
zero: a rare event is known from few blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special
from scipy.optimize import least_squares

from ballbot.fitting.uncertainty import covariance_in_time


@dataclass(frozen=True, kw_only=True, eq=False)
class LeastSquaresFit:
    """Where a descent of the sum of squares ended."""

    point: NDArray[np.float64]  #: (p,)
    jacobian: NDArray[np.float64]  #: (m, p), there
    residuals: NDArray[np.float64]  #: (m,), there
    at_bound: NDArray[np.int64]  #: (p,), -1 at the lower bound, 1 at the upper one, 0 between them


@dataclass(frozen=True, kw_only=True)
class Stopping:
    """When a descent of the sum of squares ends; the defaults are SciPy's."""

    most_evaluations: int | None = None  #: of the residuals, without those for derivatives
    least_gain: float = 1e-8  #: ends where a step lowers the sum of squares by less than this share
    least_step: float = 1e-8  #: ends where a step is shorter than this share of the point


_DEFAULT_STOPPING = Stopping()
#: half the central difference, as a share of the parameter, where no Jacobian is given
_RELATIVE_DIFFERENCE = 1e-2


def minimize_squares(
    residuals_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    start: NDArray[np.float64],
    *,
    jacobian_of: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
    bounds: tuple[ArrayLike, ArrayLike] = (-np.inf, np.inf),
    scale: ArrayLike | Literal["jac"] = 1.0,
    method: Literal["trf", "lm"] = "trf",
    stopping: Stopping = _DEFAULT_STOPPING,
) -> LeastSquaresFit:
    """Descend from `start` to a minimum of the sum of squared residuals within bounds.

    Parameters
    ----------
    residuals_of : callable
        From parameters (p,) to residuals (m,).
    start : ndarray (p,)
        Inside the bounds.
    jacobian_of : callable, optional
        From parameters (p,) to derivatives (m, p); central differences by default.
    bounds : (lower, upper)
        Numbers, or arrays (p,).
    scale : float, array (p,) or "jac"
        The size of each parameter; "jac" takes it from the Jacobian's columns.
    method : {"trf", "lm"}
        A reflective trust region (M. A. Branch, T. F. Coleman and Y. Li, SIAM J. Sci. Comput. 21 (1999) 1-23), or
        Levenberg and Marquardt's method by MINPACK, which takes no bounds.
    stopping : Stopping, optional
    """
    found = least_squares(
        residuals_of,
        start,
        jac=jacobian_of or "3-point",  # pyright: ignore[reportArgumentType] (SciPy takes a function too)
        diff_step=None if jacobian_of else _RELATIVE_DIFFERENCE,
        bounds=bounds,
        x_scale=scale,
        method=method,
        max_nfev=stopping.most_evaluations,
        ftol=stopping.least_gain,
        xtol=stopping.least_step,
    )
    return LeastSquaresFit(
        point=np.asarray(found.x, dtype=np.float64),
        jacobian=np.asarray(found.jac, dtype=np.float64),
        residuals=np.asarray(found.fun, dtype=np.float64),
        at_bound=np.asarray(found.active_mask, dtype=np.int64),
    )


#: blocks beyond the parameters tested, below which a test has no result
_LEAST_FREEDOM = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearFit:
    """Parameters (p,) of a linear model."""

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]  #: (p, p)
    residuals: NDArray[np.float64]  #: (n,), measured less fitted
    blocks: NDArray[np.int64]  #: (p,), blocks in which each parameter's column is not zero

    @property
    def errors(self) -> NDArray[np.float64]:
        """Standard errors (p,)."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def half_widths(self) -> NDArray[np.float64]:
        """Half widths of the 95 % intervals (p,)."""
        return special.stdtrit(np.maximum(self.blocks - 1, 1), 0.975) * self.errors

    def p_value(self, places: Sequence[int]) -> float:
        """Return the p-value of the parameters at `places`, for the hypothesis that all are zero.

        NaN if there are too few blocks.
        """
        blocks = int(self.blocks[list(places)].min())
        count, freedom = len(places), blocks - len(places)
        if freedom < _LEAST_FREEDOM:
            return float("nan")
        part, covariance = self.values[list(places)], self.covariance[np.ix_(places, places)]
        wald = float(part @ np.linalg.pinv(covariance, hermitian=True) @ part)
        return float(special.fdtrc(count, freedom, wald * freedom / (count * (blocks - 1))))


def fit_linear(
    design: NDArray[np.float64], values: NDArray[np.float64], blocks: NDArray[np.int64]
) -> LinearFit:
    """Fit values (n,) by columns (n, p), their errors clustered by `blocks` (n,)."""
    found = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    _, block = np.unique(blocks, return_inverse=True)
    count = int(block.max()) + 1
    residuals = values - design @ found
    present = [np.bincount(block, weights=column != 0.0, minlength=count) for column in design.T]
    return LinearFit(
        values=found,
        covariance=covariance_in_time(design, residuals, block),
        residuals=residuals,
        blocks=np.count_nonzero(present, axis=1),
    )


def central_differences(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    point: NDArray[np.float64],
    steps: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the derivatives (..., p) of a function (...) at a point (p,), with a step of each parameter (p,)."""
    columns = []
    for size, step in zip(steps, np.diag(steps), strict=True):
        columns.append((function(point + step) - function(point - step)) / (2.0 * size))
    return np.stack(columns, axis=-1)
