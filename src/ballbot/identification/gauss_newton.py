"""The last digits: Gauss-Newton with Levenberg and Marquardt's damping on batched finite differences.

K. Levenberg, Quarterly of Applied Mathematics 2 (1944) 164-168; D. W. Marquardt, SIAM J. 11 (1963) 431-441. Each state
weighs one over the variance of its residual, taken anew at every step, which makes small the `Cost`. A parameter
at a bound that would leave it stays there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import NormalEquations
from ballbot.identification.prediction import Problem
from ballbot.progress import Progress

#: all of them are tried at each step, in one batch, each by itself and lengthened: where large residuals make
#: Gauss-Newton's curvature too great, a longer step goes further
DAMPINGS = 10.0 ** np.arange(-4.0, 2.0)
LENGTHS = (1.0, 3.0, 9.0)
CANDIDATES = len(DAMPINGS) * len(LENGTHS)
#: the polish ends where this many steps one after another gain less than this: b, c, s and v_s form a bent and
#: nearly level valley, in which one short step does not mean that its floor is reached
PATIENCE = 2
LEAST_GAIN = 4e-6
_AT_BOUND = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussNewtonFit:
    """Where the polish ended."""

    point: NDArray[np.float64]  #: (p,), scaled
    equations: NormalEquations  #: there
    history: tuple[float, ...]  #: cost after each step


def gauss_newton(
    problem: Problem,
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
        if not gain > 0.0 or short_steps == PATIENCE:
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
