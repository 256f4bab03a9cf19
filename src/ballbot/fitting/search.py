"""How the basin of a minimum is found: an evolution strategy; and which parameters end at a bound.

Every generation is one batch: CMA-ES as in N. Hansen, The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772, by the
package `cmaes`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.run import Run
from ballbot.progress import Progress

#: the search ends early where this many generations together gain less than `LEAST_SEARCH_GAIN`; a descent follows
SEARCH_PATIENCE = 25
LEAST_SEARCH_GAIN = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchResult:
    """What a search found."""

    best: NDArray[np.float64]  #: (p,), scaled to 0 .. 1
    history: tuple[float, ...]  #: best cost after each generation
    other: NDArray[np.float64] | None = (
        None  #: (p,), where it also ended, elsewhere; None if there is no such place
    )


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
        Its seed fixes the search bit for bit; the stage "evolution" is reported after each generation.
    """
    from cmaes import CMA  # with scipy.stats, which takes half a second

    strategy = CMA(
        mean=np.full(size, 0.5),
        sigma=0.3,
        bounds=np.tile([0.0, 1.0], (size, 1)),
        population_size=population,
        seed=run.seed,
    )

    best, least, history = np.full(size, 0.5), np.inf, []
    for generation in range(1, generations + 1):
        candidates = np.array([strategy.ask() for _ in range(population)])
        costs = cost_of(candidates)
        strategy.tell([(candidate, float(cost)) for candidate, cost in zip(candidates, costs, strict=True)])
        if costs.min() < least:
            best, least = candidates[costs.argmin()], float(costs.min())
        history.append(least)
        run.progress(Progress(stage="evolution", done=generation, total=generations, cost=least))
        waited = len(history) > SEARCH_PATIENCE and history[-SEARCH_PATIENCE - 1] - least < LEAST_SEARCH_GAIN
        if waited or strategy.should_stop():
            break
    return SearchResult(best=best, history=tuple(history))


#: ends that differ by more in some scaled parameter are not of one optimum
_ELSEWHERE = 0.05


def elsewhere(point: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether two scaled ends (p,) of a fit are different optima."""
    return bool(np.abs(point - other).max() > _ELSEWHERE)


_AT_BOUND = 1e-9


def at_bound(point: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which scaled parameters (p,) are at a bound."""
    return (point <= _AT_BOUND) | (point >= 1.0 - _AT_BOUND)


def leaving(point: NDArray[np.float64], gradient: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which scaled parameters (p,) are at a bound that a descent would take them out of."""
    return ((point <= _AT_BOUND) & (gradient > 0.0)) | ((point >= 1.0 - _AT_BOUND) & (gradient < 0.0))
