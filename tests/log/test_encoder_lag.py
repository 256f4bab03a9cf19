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
    columns = {f"wheel{i + 1}": counted[i] for i in range(3)} | {
        f"wheel{i + 1}_dot": speeds[i] for i in range(3)
    }
    expected = STEP * (0.5 * window + kept / (1.0 - kept))
    # a filter's delay is that of slow motion; at 0.8 Hz it is shorter by less than 1 %
    assert encoder_lag(Log({"t": t} | columns), ROBOT) == pytest.approx(expected, rel=0.02, abs=2e-5)


def onboard_log() -> Log:
    sensors = replace(ROBOT.sensors, gyro_noise=0.0, attitude_noise=0.0, heading_drift=0.0)
    borne = Imperfections(sensors=sensors, known=ROBOT)
    batch = simulate_batch(
        Model(ROBOT), nominal_controller(ROBOT), square(period=4.0), duration=6.0, imperfections=borne
    )
    return batch.log(0)


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
    # half a sample of motion goes; what is left are counts, which average out over a way
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
    measured = log.with_columns(
        {"x": log["x"] + 0.01 * np.sin(3.0 * log.t), "wheel1_dot": holed(log["wheel1_dot"])}
    )
    changed = without_encoder_lag(measured, ROBOT)
    np.testing.assert_array_equal(changed["x"], measured["x"])
    assert np.isnan(changed["wheel1_dot"]).sum() == 11


def holed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where((np.arange(len(values)) >= 300) & (np.arange(len(values)) < 310), np.nan, values)
