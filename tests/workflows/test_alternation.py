"""Runs in turn: a drift is no gain, and the interval holds what it promises."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.workflows.alternation import alternate, paired_gain
from ballbot.workflows.metrics import LogScore

small = st.floats(-0.5, 0.5)


@given(gain=small, drift=small, offset=small, rounds=st.integers(2, 5))
def test_steady_drift_is_not_a_gain(gain, drift, offset, rounds):
    k = np.arange(2 * rounds)
    found = paired_gain(np.exp(offset + drift * k + gain * (k % 2)))
    assert found.factor == pytest.approx(np.exp(gain), rel=1e-9)
    assert found.drift == pytest.approx(np.exp(drift), rel=1e-9)


@pytest.mark.parametrize("rounds", [2, 6])
def test_interval_contains_the_true_factor_as_often_as_it_states(rounds):
    random, k, runs = np.random.default_rng(rounds), np.arange(2 * rounds), 1500
    inside = 0
    for _ in range(runs):
        gain, drift = random.uniform(-1.0, 1.0), random.uniform(-0.2, 0.2)
        noise = 0.2 * random.standard_normal(2 * rounds)
        found = paired_gain(np.exp(gain * (k % 2) + drift * k + noise))
        inside += found.low <= np.exp(gain) <= found.high
    # four standard errors of a fraction of 0.95
    assert abs(inside / runs - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / runs)


def performance(error):
    return LogScore(peak_error=error, rms_error=0.5 * error, roughness=0.1, lean=0.02, torque_margin=0.7)


def test_verdict_needs_the_whole_interval():
    random = np.random.default_rng(0)
    better = [performance(error * np.exp(0.05 * random.standard_normal())) for error in (0.04, 0.01) * 4]
    assert alternate(better, []).gains["peak_error"].verdict == "smaller"
    equal = [performance(0.04 * np.exp(0.05 * random.standard_normal())) for _ in range(8)]
    assert alternate(equal, []).gains["peak_error"].verdict == "undecided"


def test_quantity_that_a_run_does_not_show_is_left_out():
    found = alternate([performance(0.02), performance(np.nan), performance(0.02), performance(0.01)], [])
    assert "peak_error" not in found.gains
    assert "roughness" in found.gains


@pytest.mark.parametrize("count", [2, 5])
def test_runs_that_do_not_alternate_are_refused(count):
    with pytest.raises(InputError, match="alternately"):
        alternate([performance(0.02)] * count, [])
