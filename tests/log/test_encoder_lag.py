"""Speeds differenced and filtered by firmware: by how much they are late, and logs in which they are not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import lfilter

from ballbot import Log, Model, simulate_batch
from ballbot.control.presets import nominal_controller
from ballbot.control.references import square
from ballbot.log.pose import encoder_lag, without_encoder_lag
from ballbot.simulation.imperfections import Imperfections
from tests.support.control_examples import FRICTION, alten

ROBOT, STEP = alten(FRICTION), 0.005
COUNT = 2.0 * np.pi / 56_000  # of the BBR's encoders at the wheel [rad]


@settings(deadline=None, max_examples=25)
@given(window=st.integers(1, 4), kept=st.floats(0.0, 0.8), seed=st.integers(0, 1000))
def test_lag_of_differenced_and_filtered_counts(window, kept, seed):
    """Differences over n samples are late by n T / 2, a filter that keeps k of its last value by k / (1 - k) T."""
    random = np.random.default_rng(seed)
    t = STEP * np.arange(2000)
    frequency, phase = random.uniform(0.1, 0.8, (3, 4)), random.uniform(0.0, 6.0, (3, 4))
    angles = 2.0 * np.sin(2.0 * np.pi * frequency[..., None] * t + phase[..., None]).sum(axis=1)
    counted = COUNT * np.floor(angles / COUNT)
    before = np.concatenate([np.repeat(counted[:, :1], window, axis=1), counted[:, :-window]], axis=1)
    speeds = lfilter([1.0 - kept], [1.0, -kept], (counted - before) / (window * STEP), axis=1)
    columns = {f"wheel{i}": angle for i, angle in enumerate(counted, start=1)}
    columns |= {f"wheel{i}_dot": speed for i, speed in enumerate(speeds, start=1)}
    expected = STEP * (0.5 * window + kept / (1.0 - kept))
    # a filter's delay is that of slow motion; at 0.8 Hz it is shorter by less than 1 %
    assert encoder_lag(Log({"t": t} | columns), ROBOT) == pytest.approx(expected, rel=0.02, abs=2e-5)


def onboard_log() -> Log:
    sensors = replace(ROBOT.sensors, gyro_noise=0.0, attitude_noise=0.0, heading_drift=0.0)
    imperfections, course = Imperfections(sensors=sensors, known=ROBOT), square(period=4.0)
    controller = nominal_controller(ROBOT)
    return simulate_batch(Model(ROBOT), controller, course, duration=6.0, imperfections=imperfections).log(0)


def errors(log: Log, truth: Log) -> NDArray[np.float64]:
    """Return RMS errors of way, velocity and wheel speed, but for the first and last rows."""
    model = Model(ROBOT)
    speeds = model.wheel_speed(truth.states[:, :5], truth.states[:, 5:])
    seen = np.column_stack([log[f"wheel{i}_dot"] for i in (1, 2, 3)])
    away = [log.states[:, :2] - truth.states[:, :2], log.states[:, 5:7] - truth.states[:, 5:7], seen - speeds]
    return np.array([np.sqrt(np.mean((one - one[2])[2:-2] ** 2)) for one in away])


def test_velocity_and_position_hold_at_their_rows():
    log = onboard_log()
    truth, seen = log.truth(), log.without_truth()
    before, after = errors(seen, truth), errors(without_encoder_lag(seen, ROBOT), truth)
    assert encoder_lag(seen, ROBOT) == pytest.approx(0.5 * STEP)
    # the lag of half a sample is gone; the error of the counts remains, and averages out over a distance
    assert (after < np.array([0.05, 0.5, 0.5]) * before).all()
    np.testing.assert_array_equal(without_encoder_lag(seen, ROBOT).states[:, 2:5], seen.states[:, 2:5])


def test_logs_without_such_speeds_stay():
    log = onboard_log().without_truth()
    for other in (
        log.with_columns({"x_dot": 1.1 * log["x_dot"]}),  # not by the wheels
        Log({name: log[name] for name in log.names if name != "wheel2"}),
        Log({name: log[name][:5] for name in log.names}),
    ):
        assert without_encoder_lag(other, ROBOT) is other
    # a position from elsewhere stays, and holes stay holes
    speed = np.where((np.arange(len(log)) >= 300) & (np.arange(len(log)) < 310), np.nan, log["wheel1_dot"])
    measured = log.with_columns({"x": log["x"] + 0.01 * np.sin(3.0 * log.t), "wheel1_dot": speed})
    changed = without_encoder_lag(measured, ROBOT)
    np.testing.assert_array_equal(changed["x"], measured["x"])
    assert np.isnan(changed["wheel1_dot"]).sum() == 11


def test_a_section_that_is_left_out_does_not_count():
    """The wheels turn on while nothing is logged; on both sides of the gap the lag is taken away as before."""
    log = onboard_log().without_truth()
    rows = np.r_[0:500, 700 : len(log)]
    cut = Log({name: log[name][rows] for name in log.names})
    assert encoder_lag(cut, ROBOT) == pytest.approx(0.5 * STEP)
    whole, parts = (without_encoder_lag(one, ROBOT).states for one in (log, cut))
    np.testing.assert_allclose(parts[:499, [0, 1, 5, 6]], whole[:499, [0, 1, 5, 6]], atol=1e-12)
    np.testing.assert_allclose(parts[500:, 5:7], whole[700:, 5:7], atol=1e-12)
    np.testing.assert_allclose(np.diff(parts[500:, :2], axis=0), np.diff(whole[700:, :2], axis=0), atol=1e-12)


def test_a_lag_that_explains_little_is_none():
    """A counter that is reset now and then, as no lag makes its angles go ahead of its speeds."""
    t = STEP * np.arange(2000)
    speed = 2.0 * np.sin(t)
    angles = np.cumsum(speed) * STEP + 3.0 * (t > 4.0) - 5.0 * (t > 7.0)
    columns = {f"wheel{i}": angles for i in (1, 2, 3)} | {f"wheel{i}_dot": speed for i in (1, 2, 3)}
    assert encoder_lag(Log({"t": t} | columns), ROBOT) == 0.0
