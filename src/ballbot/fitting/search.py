"""How a minimum is found: an evolution strategy for the basin, Gauss-Newton for the last digits, least squares.

Evolution. Every generation is one batch: CMA-ES as in N. Hansen, The CMA Evolution Strategy: A Tutorial,
arXiv:1604.00772, by the package `cmaes`.

Gauss-Newton, with Levenberg and Marquardt's damping on batched finite differences: K. Levenberg, Quarterly of Applied
Mathematics 2 (1944) 164-168; D. W. Marquardt, SIAM J. 11 (1963) 431-441. A parameter at a bound that would leave it
stays there.

Least squares with standard errors that allow for residuals related in time.

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
from typing import Literal, Protocol

import numpy as np
from cmaes import CMA
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import NormalEquations
from ballbot.progress import Progress

#: the search ends early where this many generations together gain less than `LEAST_SEARCH_GAIN`; a polish follows
SEARCH_PATIENCE = 25
LEAST_SEARCH_GAIN = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchResult:
    """What a search found."""

    best: NDArray[np.float64]  #: (p,), scaled to 0 .. 1
    history: tuple[float, ...]  #: best cost after each generation


def evolve(
    cost_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    *,
    size: int,
    generations: int,
    population: int,
    run: Run,
) -> SearchResult:
    """Minimise a cost over the unit cube.

    Parameters
    ----------
    cost_of : callable
        From a population (population, p) to its costs (population,).
    size : int
        Number of coordinates, p.
    generations, population : int
    run : Run
        Its seed fixes the search bit for bit; its checkpoint answers for the costs of a generation, and the stage
        "evolution" is reported after each.
    """
    strategy = CMA(
        mean=np.full(size, 0.5),
        sigma=0.3,
        bounds=np.tile([0.0, 1.0], (size, 1)),
        population_size=population,
        seed=run.seed,
    )

    def costs_of(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        return run.memoize("evolution", candidates, lambda: [cost_of(candidates)])[0]

    best, least, history = np.full(size, 0.5), np.inf, []
    for generation in range(1, generations + 1):
        candidates = np.array([strategy.ask() for _ in range(population)])
        costs = costs_of(candidates)
        strategy.tell([(candidate, float(cost)) for candidate, cost in zip(candidates, costs, strict=True)])
        if costs.min() < least:
            best, least = candidates[costs.argmin()], float(costs.min())
        history.append(least)
        run.progress(Progress(stage="evolution", done=generation, total=generations, cost=least))
        waited = len(history) > SEARCH_PATIENCE and history[-SEARCH_PATIENCE - 1] - least < LEAST_SEARCH_GAIN
        if waited or strategy.should_stop():
            break
    return SearchResult(best=best, history=tuple(history))


#: all of them are tried at each step, in one batch, each by itself and lengthened: where large residuals make
#: Gauss-Newton's curvature too great, a longer step goes further
DAMPINGS = 10.0 ** np.arange(-4.0, 2.0)
LENGTHS = (1.0, 3.0, 9.0)
CANDIDATES = len(DAMPINGS) * len(LENGTHS)
#: the polish ends where this many steps one after another gain less than this: b, c, s and v_s form a bent and
#: nearly level valley, in which one short step does not mean that its floor is reached
_STEP_PATIENCE = 2
LEAST_GAIN = 4e-6
_AT_BOUND = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussNewtonFit:
    """Where the polish ended."""

    point: NDArray[np.float64]  #: (p,), scaled
    equations: NormalEquations  #: there
    history: tuple[float, ...]  #: cost after each step


class Differentiable(Protocol):
    """A weighted least-squares problem in scaled coordinates."""

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the costs (sets,) of points (sets, p)."""
        ...

    def linearize(self, point: NDArray[np.float64]) -> NormalEquations:
        """Return the normal equations about a point (p,)."""
        ...


def gauss_newton(
    problem: Differentiable,
    start: NDArray[np.float64],
    *,
    free: NDArray[np.bool_],
    most_steps: int,
    run: Run = DEFAULT_RUN,
) -> GaussNewtonFit:
    """Descend from `start` (p,), scaled, moving the parameters marked in `free` (p,), at most so many steps.

    The run's checkpoint answers for costs and normal equations; the stage "polish" is reported after each step.
    """

    def costs_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return run.memoize("costs", points, lambda: [problem.costs(points)])[0]

    def equations_about(point: NDArray[np.float64]) -> NormalEquations:
        def answer() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            equations = problem.linearize(point)
            return equations.matrix, equations.scores

        matrix, scores = run.memoize("equations", point, answer)
        return NormalEquations(matrix=matrix, scores=scores)

    point, least, history = start, float(costs_of(start[None])[0]), []
    short_steps = 0
    equations = equations_about(point)
    for step in range(1, most_steps + 1):
        candidates = _candidates(point, equations, free)
        costs = costs_of(candidates)
        gain = least - float(costs.min())
        if gain > 0.0:
            point, least = candidates[costs.argmin()], float(costs.min())
            equations = equations_about(point)
        history.append(least)
        run.progress(Progress(stage="polish", done=step, total=most_steps, cost=least))
        short_steps = 0 if gain > LEAST_GAIN else short_steps + 1
        if not gain > 0.0 or short_steps == _STEP_PATIENCE:
            break
    return GaussNewtonFit(point=point, equations=equations, history=tuple(history))


def at_bound(point: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which scaled parameters (p,) stand at a bound."""
    return (point <= _AT_BOUND) | (point >= 1.0 - _AT_BOUND)


def leaving(point: NDArray[np.float64], gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which scaled parameters (p,) stand at a bound that a descent would take them out of."""
    return ((point <= _AT_BOUND) & (gradient > 0.0)) | ((point >= 1.0 - _AT_BOUND) & (gradient < 0.0))


def _candidates(
    point: NDArray[np.float64], equations: NormalEquations, free: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the points (dampings x lengths, p) that the damped steps lead to."""
    gradient = equations.scores.sum(axis=0)
    moved = np.flatnonzero(free & ~leaving(point, gradient) & (equations.matrix.diagonal() > 0.0))
    H = equations.matrix[np.ix_(moved, moved)]
    steps = np.zeros((len(DAMPINGS), len(point)))
    for step, damping in zip(steps, DAMPINGS, strict=True):
        step[moved] = -np.linalg.solve(H + damping * np.diag(H.diagonal()), gradient[moved])
    return np.clip(np.concatenate([point + length * steps for length in LENGTHS]), 0.0, 1.0)


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


#: clusters, at the least, for each parameter; fewer make a covariance too small
CLUSTERS_PER_PARAMETER = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class ClusteredFit:
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
) -> ClusteredFit:
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

    values = start + minimize_squares(scaled_residuals, np.zeros(len(start))).point * scales
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
    return ClusteredFit(values=values, covariance=covariance * np.outer(scales, scales), residuals=residuals)


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
