"""Numbers over several seeds: their median, and an interval for it that asks nothing of their distribution."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np

#: runs that a verdict on the twin or on a model with friction is taken over
RUNS = 9
#: three-minute runs that the sensors are judged by; the fewest whose whole range is an interval of 95 %
LONG_RUNS = 6
#: coverage asked of an interval
_COVERAGE = 0.95


def run_seed(seed: int, number: int) -> int:
    """Return the seed of a run by the command's seed and the run's number."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return an interval that holds the median of what the values are drawn from with at least 95 %, if six are given.

    It lies between order statistics: k values lie below the median as often as k of n coins show heads, whatever the
    distribution is (W. R. Thompson, Ann. Math. Statist. 7 (1936) 122-128). With fewer than six it is their range.
    """
    ordered, n = sorted(values), len(values)
    first = 0
    while first + 1 < n // 2 and 1.0 - 2.0 * _share_below(n, first + 2) >= _COVERAGE:
        first += 1
    return ordered[first], ordered[n - 1 - first]


def _share_below(n: int, count: int) -> float:
    """Return the probability of fewer than `count` heads of n coins."""
    return sum(comb(n, k) for k in range(count)) / 2.0**n
