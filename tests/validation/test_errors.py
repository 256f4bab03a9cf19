"""Intervals on the ratio of two models' errors: how often they contain a known truth, and the verdicts from them."""

from __future__ import annotations

import numpy as np
from scipy import stats
from scipy.signal import lfilter

from ballbot.fitting.comparison import verdicts
from ballbot.validation.models import ErrorPair


def _errors(
    random: np.random.Generator, *, runs: int, memory: float, columns: int = 10, ratio: float = 3.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return log-normal errors of two models whose means are in that ratio; a run is hard or easy for both."""
    white = random.normal(size=(2, runs + 50, columns))
    first, other = np.asarray(lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white, axis=1))[:, 50:]
    return np.exp(0.7 * first), ratio * np.exp(0.7 * (0.5 * first + np.sqrt(0.75) * other))


def _pair(first: np.ndarray, second: np.ndarray) -> ErrorPair:
    return ErrorPair(
        by_run=np.stack([first, second], axis=1),
        samples=np.full(len(first), 100),
        means=np.zeros_like(first),
        squares=np.ones_like(first),
    )


def test_better_requires_the_whole_interval_above_one():
    random = np.random.default_rng(5)
    said = []
    for _ in range(40):
        said.extend(_pair(*_errors(random, runs=20, memory=0.0, ratio=1.0)).verdicts())
    # two equal models: a word on either in 5 % of 400 cases, by the binomial at most 8.3 % in 1000 such tests
    assert np.mean([word != "undecided" for word in said]) < stats.binom.isf(1e-3, 400, 0.05) / 400
    assert set(_pair(*_errors(random, runs=60, memory=0.0)).verdicts()) == {"better"}
    assert set(_pair(*_errors(random, runs=60, memory=0.0)[::-1]).verdicts()) == {"worse"}
    assert verdicts(np.array([[0.9, 1.1, 0.5], [1.2, 1.3, 0.8]])) == ("undecided", "better", "worse")
