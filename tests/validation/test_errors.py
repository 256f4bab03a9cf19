"""Intervals on the ratio of two models' errors: how often they hold a known truth, and what they lead to say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from ballbot.fitting.uncertainty import resampled_means, resamples
from ballbot.validation.errors import ErrorPair, StateErrors, ratio_interval, verdicts
from ballbot.validation.prediction import HorizonErrors


def _errors(
    random: np.random.Generator, *, runs: int, memory: float, columns: int = 10, ratio: float = 3.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return log-normal errors of two models whose means are in that ratio; a run is hard or easy for both."""
    white = random.normal(size=(2, runs + 50, columns))
    first, other = np.asarray(lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white, axis=1))[:, 50:]
    return np.exp(0.7 * first), ratio * np.exp(0.7 * (0.5 * first + np.sqrt(0.75) * other))


@pytest.mark.parametrize(("runs", "memory", "least"), [(10, 0.0, 0.91), (25, 0.0, 0.91), (100, 0.4, 0.87)])
def test_ratio_interval_covers_the_truth_at_its_level(runs, memory, least):
    random = np.random.default_rng(2)
    held = []
    for _ in range(30):
        first, second = _errors(random, runs=runs, memory=memory)
        lower, upper = ratio_interval(second, first)
        held.append((lower <= 3.0) & (upper >= 3.0))
    # of 300 intervals, 95 % hold it give or take 1.3 %, and a little fewer with memory
    assert least < np.mean(held) <= 0.99


def test_the_interval_narrows_with_runs_and_the_root_of_squares_is_halved():
    random = np.random.default_rng(3)
    few, many = (ratio_interval(*_errors(random, runs=runs, memory=0.0)[::-1]) for runs in (100, 10_000))
    # a hundred times the runs: a tenth of the width, of which a column's own scatter is about a sixth
    narrower = np.mean(np.log(many[1] / many[0])) / np.mean(np.log(few[1] / few[0]))
    assert 0.07 < narrower < 0.13
    first, second = _errors(random, runs=50, memory=0.0)
    np.testing.assert_allclose(
        ratio_interval(second, first, power=0.5), np.sqrt(ratio_interval(second, first)), rtol=1e-12
    )


def test_resampled_means_are_those_of_the_rows_drawn():
    values = np.random.default_rng(4).normal(size=(23, 3))
    # 23 rows in blocks of one: the same draws, counted and summed
    drawn = resamples(23, block=1, repeats=7, seed=5)
    np.testing.assert_allclose(
        resampled_means(values, block=1, repeats=7, seed=5), drawn @ values / 23, atol=1e-14
    )
    means = resampled_means(values, block=4, repeats=4000, seed=6)
    # their mean is that of the rows, to a standard error over sqrt(4000)
    np.testing.assert_allclose(
        means.mean(axis=0), values.mean(axis=0), atol=4.0 * means.std() / np.sqrt(4000)
    )


def _pair(first: np.ndarray, second: np.ndarray) -> ErrorPair:
    samples = np.full(len(first), 100)
    return ErrorPair(
        first=StateErrors(by_run=first, samples=samples),
        second=StateErrors(by_run=second, samples=samples),
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


def test_too_few_runs_have_no_interval_and_no_verdict():
    pair = _pair(*_errors(np.random.default_rng(6), runs=7, memory=0.0))
    assert np.isnan(pair.ratio_interval()).all()
    assert set(pair.verdicts()) == {"undecided"}


def test_normalised_errors_against_numpy():
    random = np.random.default_rng(7)
    measured = [random.normal(size=(n, 10)) * 3.0 + 5.0 for n in (40, 70)]
    first, second = ([run + 0.1 * random.normal(size=run.shape) for run in measured] for _ in range(2))
    pair = ErrorPair.of_runs(measured, first, second)
    everything = np.concatenate(measured)
    for errors, modelled in zip(pair.normalised_rmse, (first, second), strict=True):
        rmse = np.sqrt(np.mean((everything - np.concatenate(modelled)) ** 2, axis=0))
        np.testing.assert_allclose(errors, rmse / everything.std(axis=0), rtol=1e-9)


def test_overlapping_forecasts_do_not_make_an_interval_narrower():
    random = np.random.default_rng(8)
    # every forecast counted five times, as starts that overlap are
    squares = np.repeat(random.lognormal(size=(2, 60, 12, 10)), 5, axis=1)

    def width(which: slice) -> float:
        errors = HorizonErrors(
            horizons=np.linspace(0.005, 0.5, 12),
            first_squares=squares[0, which],
            second_squares=squares[1, which],
            noise_floor=np.ones((12, 10)),
            spread=np.ones(10),
        )
        lower, upper = np.log(errors.ratio_interval())
        return float(np.mean(upper - lower))

    # 300 rows that are 60 have about the width of 60 (which few blocks widen), not one over the root of five of it
    assert width(slice(None)) > 0.75 * width(slice(None, None, 5))
