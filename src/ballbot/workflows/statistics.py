"""Statistics of a few runs: means, medians and fractions with their 95 % intervals, and controllers run by run.

Two controllers are compared seed by seed: the common effect of a seed cancels in their difference or ratio, so that the
interval is narrower than that of two means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import bdtr, betaincinv, stdtrit

from ballbot.arrays import Floats

CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A mean over seeds with the 95 % interval of its expectation; NaN if there are too few seeds."""

    mean: float
    low: float
    high: float
    runs: int  #: that it is the mean of

    @property
    def sign(self) -> int:
        """1 or -1 if the whole interval is above or below zero; 0 if the difference is not significant."""
        return 1 if self.low > 0.0 else -1 if self.high < 0.0 else 0


@dataclass(frozen=True, kw_only=True)
class MedianEstimate:
    """The median over runs with the 95 % interval of their distribution's median; NaN without a run."""

    median: float
    low: float
    high: float
    runs: int  #: that it is the median of

    def overlaps(self, other: MedianEstimate) -> bool:
        """Return whether the two intervals have a value in common."""
        return self.low <= other.high and other.low <= self.high


def mean_with_interval(values: Sequence[float] | Floats) -> Estimate:
    """Return the mean of the values that are numbers, with Student's interval m +- t s / sqrt(n)."""
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)]
    count = len(known)
    mean = float(known.mean()) if count else np.nan
    if count < 2:
        return Estimate(mean=mean, low=np.nan, high=np.nan, runs=count)
    half = student_quantile(count) * float(known.std(ddof=1) / np.sqrt(count))
    return Estimate(mean=mean, low=mean - half, high=mean + half, runs=count)


def student_quantile(count: int) -> float:
    """Return how many standard errors the interval of a mean of `count` values reaches to each side."""
    return float(stdtrit(count - 1, 0.5 + 0.5 * CONFIDENCE))


def median_with_interval(values: Sequence[float] | Floats) -> MedianEstimate:
    """Return the median of the values that are numbers, with the interval between two of them by rank.

    The number of n independent values below their distribution's median is binomial. Below six values the smallest and
    the largest enclose it with less than 95 % (five: 93.8 %).
    """
    known = np.sort(np.asarray(values, dtype=np.float64))
    known = known[~np.isnan(known)]
    count = len(known)
    if count == 0:
        return MedianEstimate(median=np.nan, low=np.nan, high=np.nan, runs=0)
    skipped = max(int(np.searchsorted(bdtr(np.arange(count + 1), count, 0.5), 0.5 - 0.5 * CONFIDENCE)) - 1, 0)
    return MedianEstimate(
        median=float(np.median(known)),
        low=float(known[skipped]),
        high=float(known[count - 1 - skipped]),
        runs=count,
    )


def mean_ratio(values: Floats, others: Floats) -> Estimate:
    """Return the geometric mean of values / others, (runs,) or (courses, runs), over the runs that have both."""
    logs = np.ma.masked_invalid(np.atleast_2d(np.log(values / others)))
    log_mean = mean_with_interval(logs.mean(axis=0).filled(np.nan))
    mean, low, high = np.exp([log_mean.mean, log_mean.low, log_mean.high]).tolist()
    return Estimate(mean=mean, low=low, high=high, runs=log_mean.runs)


def fraction_with_interval(count: int, runs: int) -> tuple[float, float]:
    """Return the interval of a probability of which `count` of `runs` came true (Clopper and Pearson's, exact)."""
    beyond = 0.5 - 0.5 * CONFIDENCE
    low = betaincinv(count, runs - count + 1, beyond) if count else 0.0
    high = betaincinv(count + 1, runs - count, 1.0 - beyond) if count < runs else 1.0
    return float(low), float(high)
