"""The last digits: Gauss-Newton with Levenberg and Marquardt's damping on batched finite differences.

K. Levenberg, Quarterly of Applied Mathematics 2 (1944) 164-168; D. W. Marquardt, SIAM J. 11 (1963) 431-441. Each state
weighs one over the variance of its residual, taken anew at every step, which makes small the `Cost`. A parameter
at a bound that would leave it stays there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.coordinates import Coordinates
from ballbot.identification.prediction import Cost, Predictor, chunks
from ballbot.identification.windows import Windows

#: all of them are tried at each step, in one batch, each by itself and lengthened: where large residuals make
#: Gauss-Newton's curvature too great, a longer step goes further
DAMPINGS = 10.0 ** np.arange(-4.0, 2.0)
LENGTHS = (1.0, 3.0, 9.0)
#: half the central difference, in the scaled coordinate; wide enough to average over single sticking steps
DIFFERENCE = 2e-3
#: the polish ends where this many steps one after another gain less than this: b, c, s and v_s form a bent and
#: nearly level valley, in which one short step does not mean that its floor is reached
PATIENCE = 2
LEAST_GAIN = 4e-6
_AT_BOUND = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class NormalEquations:
    """The weighted least-squares problem about a point, in scaled coordinates."""

    matrix: NDArray[np.float64]  #: H = sum J^T J (p, p)
    scores: NDArray[np.float64]  #: J^T r of each window (w, p); their sum is the gradient


@dataclass(frozen=True, kw_only=True, eq=False)
class Polished:
    """Where the polish ended."""

    point: NDArray[np.float64]  #: (p,), scaled
    equations: NormalEquations  #: there
    history: tuple[float, ...]  #: cost after each step


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Windows to fit and how."""

    predictor: Predictor
    windows: Windows
    coordinates: Coordinates
    cost: Cost

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the costs (sets,) of scaled parameters (sets, p)."""
        return self.cost(self._square_sums(points))

    def linearize(self, point: NDArray[np.float64]) -> NormalEquations:
        """Return the normal equations about `point` (p,)."""
        size, every = len(point), self.windows.comparison_interval
        forward = np.clip(point + DIFFERENCE * np.eye(size), 0.0, 1.0)
        backward = np.clip(point - DIFFERENCE * np.eye(size), 0.0, 1.0)
        distance = (forward - backward).diagonal()
        friction = self.coordinates.physical(np.concatenate([point[None], forward, backward]))
        compared = len(self.windows) * (self.windows.samples // every)
        variance = self._square_sums(point[None])[0] / compared
        # the floor of `Cost`, and for a state that nothing moves any weight will do
        weight = 1.0 / np.sqrt(variance + 1e-12 * self.cost.reference / compared + np.finfo(float).tiny)

        matrix, scores = np.zeros((size, size)), []
        for chunk in chunks(self.windows):
            residuals = self.predictor.residuals(friction, chunk, every=every) * weight
            residuals = residuals.reshape(1 + 2 * size, len(chunk), -1)
            J = (residuals[1 : 1 + size] - residuals[1 + size :]) / distance[:, None, None]
            # einsum and not BLAS, whose order of summation depends on its threads
            matrix += np.einsum("iwk,jwk->ij", J, J, optimize=False)
            scores.append(np.einsum("iwk,wk->wi", J, residuals[0], optimize=False))
        return NormalEquations(matrix=matrix, scores=np.concatenate(scores))

    def _square_sums(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        friction = self.coordinates.physical(points)
        return self.predictor.square_sums(friction, self.windows, every=self.windows.comparison_interval)


def polish(
    problem: Problem,
    start: NDArray[np.float64],
    *,
    free: NDArray[np.bool_],
    most_steps: int,
    report: Callable[[int, float], None],
) -> Polished:
    """Descend from `start` (p,), scaled, moving the parameters marked in `free` (p,), at most so many steps."""
    point, least, history = start, float(problem.costs(start[None])[0]), []
    short_steps = 0
    equations = problem.linearize(point)
    for step in range(1, most_steps + 1):
        candidates = _candidates(point, equations, free)
        costs = problem.costs(candidates)
        gain = least - float(costs.min())
        if gain > 0.0:
            point, least = candidates[costs.argmin()], float(costs.min())
            equations = problem.linearize(point)
        history.append(least)
        report(step, least)
        short_steps = 0 if gain > LEAST_GAIN else short_steps + 1
        if not gain > 0.0 or short_steps == PATIENCE:
            break
    return Polished(point=point, equations=equations, history=tuple(history))


def at_bound(point: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which scaled parameters (p,) stand at a bound."""
    return (point <= _AT_BOUND) | (point >= 1.0 - _AT_BOUND)


def _candidates(
    point: NDArray[np.float64], equations: NormalEquations, free: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the points (dampings x lengths, p) that the damped steps lead to."""
    gradient = equations.scores.sum(axis=0)
    leaving = ((point <= _AT_BOUND) & (gradient > 0.0)) | ((point >= 1.0 - _AT_BOUND) & (gradient < 0.0))
    moved = np.flatnonzero(free & ~leaving & (equations.matrix.diagonal() > 0.0))
    H = equations.matrix[np.ix_(moved, moved)]
    steps = np.zeros((len(DAMPINGS), len(point)))
    for step, damping in zip(steps, DAMPINGS, strict=True):
        step[moved] = -np.linalg.solve(H + damping * np.diag(H.diagonal()), gradient[moved])
    return np.clip(np.concatenate([point + length * steps for length in LENGTHS]), 0.0, 1.0)
