"""Intervals on the ratio of two models' errors: how often they contain a known truth, verdicts, errors by horizon."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from ballbot.fitting.comparison import ratio_interval, verdicts


def _errors(
    random: np.random.Generator, *, runs: int, memory: float, columns: int = 10, ratio: float = 3.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return log-normal errors of two models whose means are in that ratio; a run is hard or easy for both."""
    white = random.normal(size=(2, runs + 50, columns))
    first, other = np.asarray(lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white, axis=1))[:, 50:]
    return np.exp(0.7 * first), ratio * np.exp(0.7 * (0.5 * first + np.sqrt(0.75) * other))


@pytest.mark.parametrize(("runs", "memory", "least"), [(10, 0.0, 0.91), (100, 0.4, 0.87)])
def test_ratio_interval_covers_the_truth_at_its_level(runs, memory, least):
    random = np.random.default_rng(2)
    held = []
    for _ in range(30):
        first, second = _errors(random, runs=runs, memory=memory)
        lower, upper = ratio_interval(second, first)
        held.append((lower <= 3.0) & (upper >= 3.0))
    # of 300 intervals, 95 % hold it give or take 1.3 %, and a little fewer with memory
    assert least < np.mean(held) <= 0.99


def test_better_requires_the_whole_interval_above_one():
    random = np.random.default_rng(5)

    def said(first: np.ndarray, second: np.ndarray) -> tuple[str, ...]:
        return verdicts(ratio_interval(second, first))

    equal = [word for _ in range(40) for word in said(*_errors(random, runs=20, memory=0.0, ratio=1.0))]
    # two equal models: a word on either in 5 % of 400 cases, by the binomial at most 8.3 % in 1000 such tests
    assert np.mean([word != "undecided" for word in equal]) < stats.binom.isf(1e-3, 400, 0.05) / 400
    assert set(said(*_errors(random, runs=60, memory=0.0))) == {"better"}
    assert verdicts(np.array([[0.9, 1.1, 0.5], [1.2, 1.3, 0.8]])) == ("undecided", "better", "worse")


def test_overlapping_forecasts_do_not_make_an_interval_narrower():
    random = np.random.default_rng(8)
    # every forecast counted five times, as starts that overlap are
    squares = np.repeat(random.lognormal(size=(2, 60, 120)), 5, axis=1)

    def width(which: slice) -> float:
        first, second = squares[:, which]
        lower, upper = np.log(ratio_interval(second, first, overlap=5, power=0.5))
        return float(np.mean(upper - lower))

    # 300 rows that are 60 have about the width of 60 (which few blocks widen), not one over the root of five of it
    assert width(slice(None)) > 0.75 * width(slice(None, None, 5))
