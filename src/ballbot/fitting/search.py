"""How a minimum is found: an evolution strategy for the basin, Gauss-Newton for the last digits.

Evolution. Every generation is one batch: CMA-ES as in N. Hansen, The CMA Evolution Strategy: A Tutorial,
arXiv:1604.00772, by the package `cmaes`.

Gauss-Newton, with Levenberg and Marquardt's damping on batched finite differences: K. Levenberg, Quarterly of Applied
Mathematics 2 (1944) 164-168; D. W. Marquardt, SIAM J. 11 (1963) 431-441. A parameter at a bound stays there if the step
would take it out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import NormalEquations
from ballbot.progress import Progress

#: the search ends early where this many generations together gain less than `LEAST_SEARCH_GAIN`; Gauss-Newton follows
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
    from cmaes import CMA  # with scipy.stats, which takes half a second

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
#: the descent ends if this many steps one after another gain less than `LEAST_GAIN`: b, c, s and v_s form a bent and
#: nearly level valley, in which one short step does not mean that its floor is reached
_STEP_PATIENCE = 2
LEAST_GAIN = 4e-6
_AT_BOUND = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussNewtonFit:
    """Where Gauss-Newton ended."""

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

    The run's checkpoint answers for costs and normal equations; the stage "gauss_newton" is reported after each step.
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
        run.progress(Progress(stage="gauss_newton", done=step, total=most_steps, cost=least))
        short_steps = 0 if gain > LEAST_GAIN else short_steps + 1
        if not gain > 0.0 or short_steps == _STEP_PATIENCE:
            break
    return GaussNewtonFit(point=point, equations=equations, history=tuple(history))


def at_bound(point: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which scaled parameters (p,) are at a bound."""
    return (point <= _AT_BOUND) | (point >= 1.0 - _AT_BOUND)


def leaving(point: NDArray[np.float64], gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which scaled parameters (p,) are at a bound that a descent would take them out of."""
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
