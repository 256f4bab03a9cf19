"""Rows in the order of their times: stamps that jitter, runs that were joined, clocks that were set."""

import numpy as np
import pytest

from ballbot.log.row_order import increasing_rows, longest_run

EVEN = np.asarray(0.005 * np.arange(2000), dtype=np.float64)


@pytest.mark.parametrize("size", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_stamps_that_jitter_are_one_run(size, seed):
    t = EVEN + size * 0.005 * np.random.default_rng(seed).standard_normal(len(EVEN))
    assert longest_run(t) == (0, len(t))
    kept = increasing_rows(t)
    assert (np.diff(t[kept]) > 0.0).all()


@pytest.mark.parametrize("back", [0.05, 3.5, 20.0])
def test_time_that_stays_back_is_another_run(back):
    t = EVEN - back * (np.arange(len(EVEN)) >= 700)
    assert longest_run(t) == (700, len(t))


def test_runs_that_jitter_are_parted_where_time_starts_again():
    noise = 0.006 * np.random.default_rng(5).standard_normal(3200)
    t = np.concatenate([EVEN[:1200], EVEN]) + noise
    first, end = longest_run(t)
    # of jitter next to the start, a few rows go with the other run
    assert abs(first - 1200) < 15
    assert end == len(t)
