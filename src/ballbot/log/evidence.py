"""Probabilities of hypotheses, correlations as evidence, and jackknife standard errors over blocks.

A correlation r of two signals is evidence of a sign, an order or a scale only if unrelated signals would hardly have
it. Two autocorrelated series have larger accidental correlations than white ones. For independent series (M. Bartlett,
Journal of the Royal Statistical Society 98 (1935) 536-543),

    var r = (1 + 2 sum_k rho_1(k) rho_2(k)) / n

so the effective sample size is n over that sum, at most n, and r is tested by Student's t (`confidence_in`). And a
column is another's only if it explains half of it (`RELATED`).
"""

import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import TypeVar

import numpy as np
from scipy.special import ndtr, ndtri, softmax, stdtr

from ballbot.arrays import Floats

#: below this confidence a conclusion is undetermined
CONFIDENT = 0.9
#: weight of standard errors over blocks of a second: these are not independent, and the best of several explanations
#: fits better by chance
ERRORS_WEIGHT = 0.6
#: log ratio of the residuals of two explanations above which it counts
LEAST_RATIO = 0.2
#: from this correlation on, one column counts as a copy of another, or as following it: it then explains half of the
#: other's variance, more than anything independent of it can
RELATED = math.sqrt(0.5)
#: least correlation of two columns whose ratio is a scale: noise of one makes a slope too small by the square of the
#: correlation, a fifth at most
SCALED = 0.9
#: autocorrelations are summed up to lags of this share of the series
_REACH = 0.2
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


def advantage_confidence(z: Floats) -> Floats:
    """Return the confidence in explanations that are better than the next by z standard errors."""
    return np.minimum(ndtr(ERRORS_WEIGHT * z), MOST)


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


def slices(lengths: Sequence[int]) -> Iterator[slice]:
    """Yield the slice of each segment, given their lengths."""
    end = 0
    for length in lengths:
        yield slice(end, end + length)
        end += length


def autocovariance(values: Floats, segments: Sequence[int], *, lags: int) -> Floats:
    """Return the autocovariances (lags + 1, k) of columns (n, k) about their means, divided by n at every lag."""
    deviation = values - values.mean(axis=0)
    total = np.zeros((lags + 1, values.shape[1]))
    for where in slices(segments):
        part = deviation[where]
        size = 1 << int(2 * len(part) - 1).bit_length()
        spectrum = np.fft.rfft(part, size, axis=0)
        products = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)
        reach = min(lags + 1, len(part))
        total[:reach] += products[:reach]
    return total / len(values)


def effective_counts(columns: Floats, segments: Sequence[int]) -> Floats:
    """Return for each two columns (n, m), made of `segments`, how many independent samples they have (m, m)."""
    lags = int(min(max(segments) - 1, _REACH * len(columns)))
    covariances = autocovariance(columns, segments, lags=lags)
    memory = covariances / np.where(covariances[0] > 0.0, covariances[0], 1.0)
    return len(columns) / np.maximum(1.0 + 2.0 * memory[1:].T @ memory[1:], 1.0)


def chance_of(r: Floats, count: Floats) -> Floats:
    """Return the probability that unrelated signals of so many independent samples correlate by r or more."""
    t = np.abs(r) * np.sqrt(np.maximum(count - 2.0, 0.0) / np.maximum(1.0 - np.square(r), 1e-15))
    return np.asarray(stdtr(np.maximum(count - 2.0, 1.0), -t), dtype=np.float64)


def confidence_in(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the correlations (k, m) of columns of x (N, k) with those of y (N, m), and the confidence in their signs.

    >>> t = 0.01 * np.arange(2000)[:, None]
    >>> r, confidence = confidence_in(np.sin(9.0 * t), np.sin(9.0 * t) + np.sin(7.0 * t))
    >>> round(float(r[0, 0]), 1), float(confidence[0, 0]) > CONFIDENT
    (0.7, True)
    """
    r, k = correlations(x, y), x.shape[1]
    counts = effective_counts(np.column_stack([x, y]), [len(x)])[:k, k:]
    z = -ndtri(np.maximum(chance_of(r, counts), TINY))
    return r, advantage_confidence(z)


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
