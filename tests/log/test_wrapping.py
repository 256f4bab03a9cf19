"""Headings kept within one turn and clocks that begin again are continued where a log is read."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot import Log
from ballbot.log.clock import continuous_clock
from ballbot.log.wrapping import continuous_heading
from tests.support.log_examples import smooth_log

TURN = 2.0 * np.pi


def to_pi(heading):
    return (heading + np.pi) % TURN - np.pi


def to_two_pi(heading):
    return heading % TURN


def turning_log(*, start: float = 0.0, rate: float = 0.8) -> Log:
    """Return a log that turns, with a reference ahead of it."""
    log = smooth_log(rows=4000)
    psi = start + log["psi"] + rate * log.t
    reference = {"ref_x": log["x"], "ref_y": log["y"], "ref_psi": psi + 0.3}
    return log.with_columns({"psi": psi, **reference})


@given(
    start=st.integers(-3100, 3100), rate=st.integers(-2000, 2000), wrap=st.sampled_from([to_pi, to_two_pi])
)
def test_a_wrapped_log_is_the_whole_one(start, rate, wrap):
    log = turning_log(start=1e-3 * start, rate=1e-3 * rate)
    wrapped = {name: wrap(log[name]) for name in ("psi", "ref_psi")}
    read = Log({**log.columns, **wrapped})
    # rounding of sums of up to ten turns; a heading that never reaches the end of its turn keeps the turn it is in
    turns = np.round((read["psi"][0] - log["psi"][0]) / TURN)
    assert turns == 0.0 or not any(one.where.columns == ("psi",) for one in read.changes)
    for name in wrapped:
        np.testing.assert_allclose(read[name] - TURN * turns, log[name], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    "heading",
    [
        [0.0, np.pi],  # a commanded half turn keeps its sign
        [0.0, -np.pi, 0.0],
        [0.0, TURN],  # and a whole one is one
        [0.0, 1.6 * np.pi, 3.2 * np.pi],  # several turns
        [np.nan, 1.0, np.nan],
        [np.nan],
    ],
)
def test_headings_that_are_whole_stay_as_they_are(heading):
    found, rows = continuous_heading(np.array(heading))
    np.testing.assert_array_equal(found, heading)
    assert not rows.size


def test_missing_values_and_spikes_do_not_hide_a_jump():
    heading = np.linspace(2.0, 5.0, 400)
    wrapped = to_pi(heading)
    wrapped[[100, 152, 153]] = np.nan
    wrapped[300] = 9999.0
    found, rows = continuous_heading(wrapped)
    same = np.isfinite(wrapped) & (wrapped < 100.0)
    np.testing.assert_allclose(found[same], heading[same], atol=1e-12)
    assert rows.size == 1


@pytest.mark.parametrize("period", [2.0**16, 2.0**32, 2.0**32 * 1e-6, 86400.0])
def test_a_clock_that_begins_again_is_continued(period):
    step = 5.0 if period > 5000.0 else 0.005
    t = period - 200.0 * step + step * np.arange(500)
    found, rows = continuous_clock(t % period)
    np.testing.assert_allclose(found, t, rtol=1e-12)
    assert rows.tolist() == [200]
