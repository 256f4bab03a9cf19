"""Spoilt rows: markers and glitches are found, motion and noise are not, and no window is fitted to one."""

import numpy as np
import pytest

from ballbot import Log
from ballbot.identification.windows import cut_windows
from ballbot.log.checks import check
from ballbot.log.checks.values import spikes
from tests.support.identification_examples import balancing_log

RANDOM = np.random.default_rng(3)
N = 20_000
T = 0.005 * np.arange(N)


@pytest.mark.parametrize("value", [9999.0, -5.0, 1e300])
def test_only_the_marker_value_is_found(value):
    signal = 0.2 * np.sin(T)
    signal[[700, 4000]] = value
    np.testing.assert_array_equal(np.flatnonzero(spikes(signal)), [700, 4000])


@pytest.mark.parametrize(
    "signal",
    [
        RANDOM.standard_normal(N),
        np.cumsum(RANDOM.standard_normal(N)),
        RANDOM.standard_t(4.0, N),  # heavy tails, as of encoders' differences with lost counts
        np.sign(RANDOM.standard_normal(N)),  # a motor that is switched to and fro
        np.where(np.abs(T - 50.0) < 0.02, 5.0, 0.01 * np.sin(T)),  # a blow of 8 rows
        np.where(np.arange(N) < 10_000, 0.0, 3.0),  # a step
        np.zeros(N),
    ],
)
def test_motion_is_not_a_spike(signal):
    assert not spikes(signal).any()


def spoilt(name: str, value: float) -> Log:
    log = balancing_log()
    column = log[name].copy()
    column[len(log) // 2] = value
    return log.with_columns({name: column})


def test_check_log_reports_spikes():
    told = [found for found in check(spoilt("x", 9999.0)) if found.code == "spike"]
    assert [found.where.columns for found in told] == [("x",)]
    assert "in 1 row, to 9999 at row" in told[0].text
    assert not [found for found in check(balancing_log()) if found.code == "spike"]


@pytest.mark.parametrize("name", ["x", "theta_dot", "u1"])
def test_windows_leave_it_out_as_they_do_a_missing_value(name):
    cut = [cut_windows([spoilt(name, value)], wheel_count=3, duration=0.25).spans for value in (1e5, np.nan)]
    assert cut[0] == cut[1]
    assert len(cut[0]) < len(cut_windows([balancing_log()], wheel_count=3, duration=0.25))
