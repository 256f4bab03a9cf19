"""Errors of competing models on the same runs: a 95 % interval of their ratio.

The interval is from a block bootstrap of the runs. Neighbouring runs share a stretch of floor and a swing of the limit
cycle, so blocks of neighbours are drawn (`ballbot.fitting.uncertainty`), with the errors of both models together. With
r* the ratio of a draw,

    log r  +-  t  s*,     s* = std(log r*) sqrt(m / (m - 1)),     m = runs / block,   t Student's with m - 1

On log-normal errors of 10 to 100 independent runs this contained the truth in 95 to 96 % of cases, and in 86 to 92 % if
neighbours correlated by 0.5; the percentiles of r* themselves in 86 to 93 % and 65 to 92 %
(tests/fitting/test_comparison.py checks a sample).

The blocks are as long as their mean needs (P. Hall, J. Horowitz and B.-Y. Jing, Biometrika 82 (1995) 561-574) for the
correlation rho of neighbours, taken as a first-order process: (1.5 (2 rho / (1 - rho^2))^2 runs)^(1/3), and at least
runs^(1/3) and twice the runs that overlap.
"""

from typing import Literal

import numpy as np
from scipy import special

from ballbot.arrays import Floats
from ballbot.fitting.uncertainty import block_length, resampled_means

#: with fewer runs there is no interval
LEAST_RUNS = 8

#: of the first model against the second: "better" or "worse" only if the whole interval is above or below one
Verdict = Literal["better", "worse", "undecided"]


def verdicts(interval: Floats) -> tuple[Verdict, ...]:
    """Return the verdicts of intervals (2, k) on ratios of the second model's errors to the first's."""
    return tuple(
        "better" if lower > 1.0 else "worse" if upper < 1.0 else "undecided" for lower, upper in interval.T
    )


#: resamples; the standard error is then known to 1 / sqrt(2 * 2000) = 1.6 %
_REPEATS = 2000
#: blocks are short enough that there are this many
_LEAST_BLOCKS = 4


def ratio_interval(numerator: Floats, denominator: Floats, *, overlap: int = 1, power: float = 1.0) -> Floats:
    """Return the ends (2, k) of the interval on (mean of numerator / mean of denominator)^power.

    Both are positive, (runs, k), in the order of time. `overlap` neighbouring runs share part of the log. The power is
    one half for ratios of root mean squares, given squares.
    """
    runs, trifle = len(numerator), np.finfo(float).tiny  # an error of exactly zero has no logarithm
    numerator, denominator = numerator + trifle, denominator + trifle
    above, below = numerator.mean(axis=0), denominator.mean(axis=0)
    block = _bootstrap_block(numerator / above - denominator / below, overlap)
    means = resampled_means(np.hstack([numerator, denominator]), block=block, repeats=_REPEATS, seed=0)
    logs = np.log(means[:, : len(above)] / means[:, len(above) :])
    blocks = runs / block
    half = special.stdtrit(blocks - 1.0, 0.975) * np.sqrt(blocks / (blocks - 1.0)) * logs.std(axis=0, ddof=1)
    return np.exp(power * (np.log(above / below) + np.array([-half, half])))


def _bootstrap_block(influence: Floats, overlap: int) -> int:
    """Return the length of a block from the influence (runs, k) of each run on the ratio."""
    runs = len(influence)
    products = np.sum(influence[1:] * influence[:-1], axis=0)
    squares = np.sum(influence**2, axis=0)
    # the columns' median, which chance moves little, less its bias (M. Kendall, Biometrika 41 (1954) 403-404)
    seen = float(np.median(products / np.where(squares > 0.0, squares, 1.0)))
    rho = float(np.clip(seen + (1.0 + 3.0 * seen) / runs, 0.0, 0.9))
    wanted = (1.5 * (2.0 * rho / (1.0 - rho**2)) ** 2 * runs) ** (1.0 / 3.0)
    longest = max(1, runs // _LEAST_BLOCKS)
    return min(longest, max(block_length(runs), 2 * overlap if overlap > 1 else 1, round(wanted)))


#: smallest RMS error that counts, in m, rad and their rates: a thousandth of the finest sensor's resolution, and a
#: million times the rounding of a double
FINEST = 1e-9
