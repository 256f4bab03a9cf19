"""Probabilities of hypotheses, and jackknife standard errors over blocks."""

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from scipy.special import ndtr, softmax

from ballbot.arrays import Floats

#: below this confidence a conclusion is undetermined
CONFIDENT = 0.9
#: weight of standard errors over blocks of a second: these are not independent, and the best of several explanations
#: fits better by chance
ERRORS_WEIGHT = 0.6
#: log ratio of the residuals of two explanations above which it counts
LEAST_RATIO = 0.2
#: power of the prior in a confidence: the usual one of explanations that fit alike is preferred, but is not made
#: certain
PRIOR_POWER = 0.7
#: no log gives more confidence than this
MOST = 0.999
#: smallest normal number: a denominator of at least this keeps the ratio of two zeros finite
TINY = float(np.finfo(np.float64).tiny)

Candidate = TypeVar("Candidate", bound=Hashable)


def probabilities(log_weights: Mapping[Candidate, float]) -> dict[Candidate, float]:
    """Return the candidates' probabilities from the logarithms of their weights, the likeliest first."""
    shares = zip(log_weights, softmax(list(log_weights.values())).tolist(), strict=True)
    return dict(sorted(shares, key=lambda share: -share[1]))


def advantage_confidence(z: float) -> float:
    """Return the confidence in an explanation that is better than the next by z standard errors."""
    if math.isnan(z):
        return 0.5
    return min(float(ndtr(ERRORS_WEIGHT * z)), MOST)


def behind(z: Floats, log_ratio: Floats, seconds: float, *, each_second: float) -> Floats:
    """Return by how much (logarithm of odds) explanations are less likely than one that is z standard errors better.

    Either the difference repeats in every block of a second, or it is so large that few blocks are enough: the log
    ratio of the residuals above `LEAST_RATIO` counts with a weight for each second. Both were chosen so that the fewest
    windows of 4 to 12 s of the campaign's recordings are wrong with confidence.
    """
    repeated = ERRORS_WEIGHT * np.clip(z, 0.0, 60.0)
    return np.maximum(0.5 * repeated**2, each_second * seconds * np.maximum(log_ratio - LEAST_RATIO, 0.0))


def posterior(prior: Sequence[float], odds: Floats) -> dict[int, float]:
    """Return the probabilities of explanations by their numbers, the likeliest first; `odds` as `behind` gives them."""
    return probabilities({h: PRIOR_POWER * math.log(p) - float(odds[h]) for h, p in enumerate(prior)})


def gains_over(score: Floats, left_out: Floats) -> tuple[Floats, Floats]:
    """Return by how much the best of explanations is better than each (H,), and that in standard errors.

    By the logarithms of what they leave, and those (B, H) with each block of a second left out in turn.
    """
    best = int(np.argmin(score))
    gained, errors = score - score[best], jackknife_error(left_out - left_out[:, best : best + 1])
    return gained, np.where(errors > 0.0, gained / np.maximum(errors, TINY), 0.0)


def correlations(x: Floats, y: Floats) -> Floats:
    """Return the correlations (k, m) of columns of x (N, k) with those of y (N, m); zero if one stands still."""
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    size = np.outer(np.linalg.norm(x, axis=0), np.linalg.norm(y, axis=0))
    return np.divide(x.T @ y, size, out=np.zeros_like(size), where=size > 1e-12)


def jackknife_error(estimates: Floats) -> Floats:
    """Return the standard errors of estimates from their values (B, ..), each block left out; nan below 3 blocks."""
    count = len(estimates)
    if count < 3:
        return np.full(estimates.shape[1:], math.nan)
    return np.sqrt((count - 1) / count * np.square(estimates - estimates.mean(axis=0)).sum(axis=0))


def vertex_with_error(points: Floats, by_block: Floats) -> tuple[float, float]:
    """Return the minimum of the sum over blocks of values (K, B) at K points, and its standard error; inf at an end."""
    total = by_block.sum(axis=1)
    if np.argmin(total) in (0, len(total) - 1):
        return _vertex(points, total), math.inf  # it may lie beyond
    used = by_block.sum(axis=0) > 0.0
    each = np.array([_vertex(points, total - values) for values in by_block.T[used]])
    return _vertex(points, total), float(jackknife_error(each))


def _vertex(points: Floats, values: Floats) -> float:
    """Return the vertex of a parabola through the least of the values and its neighbours."""
    k = int(np.clip(np.argmin(values), 1, len(points) - 2))
    before, at, after = values[k - 1 : k + 2]
    curve = before - 2.0 * at + after
    shift = 0.5 * (before - after) / curve if curve > 0.0 else 0.0
    return float(points[k] + np.clip(shift, -1.0, 1.0) * (points[1] - points[0]))
