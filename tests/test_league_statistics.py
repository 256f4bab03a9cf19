"""The intervals of the league hold what they promise."""

import numpy as np
import pytest
from scipy import stats

from ballbot.workflows.comparison import fraction_with_interval, mean_with_interval, paired_difference


def test_intervals_hold_the_truth_as_often_as_they_say():
    """2000 leagues of 10 seeds: 95 % of the intervals of the difference hold it, within 3.5 standard deviations."""
    draw = np.random.default_rng(7)
    of_seed = draw.normal(0.0, 1.0, (2000, 10))  # what a seed does to both
    ours = 0.3 + of_seed + draw.normal(0.0, 0.2, (2000, 10))
    theirs = of_seed + draw.normal(0.0, 0.2, (2000, 10))
    found = [paired_difference(one, other) for one, other in zip(ours, theirs, strict=True)]
    share = np.mean([one.low <= 0.3 <= one.high for one in found])
    assert share == pytest.approx(0.95, abs=3.5 * np.sqrt(0.95 * 0.05 / 2000))
    apart = np.array([mean_with_interval(one).high - mean_with_interval(one).low for one in ours[:200]])
    paired = np.array([one.high - one.low for one in found[:200]])
    assert np.median(paired) < 0.4 * np.median(apart)  # sqrt(2) 0.2 against sqrt(1.04)


def test_intervals_of_skewed_numbers_are_nearly_right():
    """Peaks are skewed: of log-normal ones with a shape of 0.5, intervals of ten seeds hold 92 % and more."""
    draw = np.random.default_rng(8)
    peaks = np.exp(draw.normal(0.0, 0.5, (2000, 10)))
    found = [mean_with_interval(one) for one in peaks]
    assert np.mean([one.low <= np.exp(0.125) <= one.high for one in found]) > 0.92 - 3.5 * 0.005


@pytest.mark.parametrize("runs", [1, 7, 30])
def test_the_interval_of_falls_holds_at_least_what_it_says(runs):
    """Summed over all outcomes: no probability is left out more often than once in twenty."""
    low, high = np.array([fraction_with_interval(count, runs) for count in range(runs + 1)]).T
    p = np.linspace(0.0, 1.0, 201)[:, None]
    held = stats.binom.pmf(np.arange(runs + 1), runs, p) * ((low <= p) & (p <= high))
    assert held.sum(axis=1).min() >= 0.95 - 1e-9
    assert high[0] == pytest.approx(1.0 - 0.025 ** (1.0 / runs))  # of no fall


def test_few_seeds_have_no_interval():
    one = paired_difference([2.0, np.nan], [1.0, 0.0])
    assert one.mean == 1.0
    assert one.runs == 1
    assert np.isnan([one.low, one.high]).all()
    assert one.sign == 0
    assert mean_with_interval([]).runs == 0
    assert paired_difference([2.0, 3.0], [1.0, 2.0]).sign == 1
