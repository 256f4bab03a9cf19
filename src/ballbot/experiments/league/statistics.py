"""What a few seeds tell: means, paired differences and shares with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A mean over seeds and the interval that its expectation lies in; NaN where there are too few seeds."""

    mean: float
    low: float
    high: float
    runs: int  #: that it is the mean of

    @property
    def sign(self) -> int:
        """1 or -1 where the whole interval is above or below zero, else 0: nothing is shown."""
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


def mean_with_interval(values: Sequence[float] | NDArray[np.float64]) -> Estimate:
    """Return the mean of the values that are numbers, with Student's interval.

    m +- t s / sqrt(n), with t of n - 1 degrees of freedom: exact for normal values, and good for the skewed ones of
    peaks from some ten seeds on. Where all are equal the interval has no width.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)]
    count = len(known)
    mean = float(known.mean()) if count else np.nan
    if count < 2:
        return Estimate(mean=mean, low=np.nan, high=np.nan, runs=count)
    half = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1) * known.std(ddof=1) / np.sqrt(count))
    return Estimate(mean=mean, low=mean - half, high=mean + half, runs=count)


def median_with_interval(values: Sequence[float] | NDArray[np.float64]) -> MedianEstimate:
    """Return the median of the values that are numbers, with the interval between two of them by rank.

    The number of n independent values below their distribution's median is binomial, whatever that distribution is: of
    20 values the 6th and the 15th enclose it with 95.9 %. Below six values the smallest and the largest do, with less
    than 95 % (five: 93.8 %).
    """
    known = np.sort(np.asarray(values, dtype=np.float64))
    known = known[~np.isnan(known)]
    count = len(known)
    if count == 0:
        return MedianEstimate(median=np.nan, low=np.nan, high=np.nan, runs=0)
    skipped = max(int(stats.binom.ppf(0.5 - 0.5 * CONFIDENCE, count, 0.5)) - 1, 0)
    return MedianEstimate(
        median=float(np.median(known)),
        low=float(known[skipped]),
        high=float(known[count - 1 - skipped]),
        runs=count,
    )


def paired_difference(values: Sequence[float], others: Sequence[float]) -> Estimate:
    """Return the mean of values - others, seed by seed, with Student's interval.

    Both have the same seeds in the same order. What a seed does to both, it does not do to their difference: the
    interval is narrower than that of two means. A seed at which either is NaN does not count.
    """
    return mean_with_interval(np.subtract(values, others, dtype=np.float64))


def share_with_interval(count: int, runs: int) -> tuple[float, float]:
    """Return the interval of a probability of which `count` of `runs` came true (Clopper and Pearson's, exact).

    None of 100 leaves it below 3.7 %, none of 200 below 1.9 %.
    """
    found = stats.binomtest(count, runs).proportion_ci(CONFIDENCE, method="exact")
    return float(found.low), float(found.high)
