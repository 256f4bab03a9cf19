"""The estimators on the twin: what they hear, and how they steer."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")

from ballbot.control.presets import nominal_controller
from ballbot.control.references import square
from ballbot.estimation.interface import Estimator
from ballbot.estimation.kalman import KalmanFilter
from ballbot.estimation.onboard import OnboardState
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.simulation.sensors import Accelerometer, FixSource, SensorFaults
from ballbot.twin import Scenario, Twin

ALTEN = Robot.load("alten")
NOMINAL = Scenario.nominal(ALTEN)


def balanced(scenario: Scenario, estimator: Estimator | None = None, *, duration: float = 0.5) -> Log:
    twin = Twin(ALTEN, scenario, estimator=estimator)
    return simulate(twin, nominal_controller(ALTEN), square(), duration=duration, seed=1)


def same(one: Log, other: Log) -> bool:
    return all((one[name] == other[name]).all() for name in one.names if name in other)


def test_sensors_without_faults_change_no_bit_and_faults_repeat() -> None:
    plain = balanced(NOMINAL)
    assert same(plain, balanced(NOMINAL, OnboardState(ALTEN, sample_time=0.005)))
    # what a fix or an accelerometer draws is not the noise's stream
    more = replace(
        NOMINAL, sensor_faults=SensorFaults(), accelerometer=Accelerometer(), fix=FixSource(rate=10)
    )
    assert same(plain, balanced(more))
    faulty = replace(more, sensor_faults=SensorFaults(gyro_bias=0.0015, lean_error=0.005, latency=0.005))
    filters = [KalmanFilter(ALTEN, sample_time=0.005) for _ in range(2)]
    one, other = (balanced(faulty, kalman) for kalman in filters)
    assert same(one, other)
    assert not same(one, plain)


def test_accelerometer_s_columns_are_there_where_it_is() -> None:
    assert "acc_x" not in balanced(NOMINAL, duration=0.1)
    log = balanced(replace(NOMINAL, accelerometer=Accelerometer(noise=0.0)), duration=0.5)
    force = np.array([log[f"acc_{axis}"] for axis in "xyz"])
    # upright within 2 degrees and slow: gravity, and contacts that give way
    np.testing.assert_allclose(force.mean(axis=1), [0, 0, 9.81], atol=0.5)
    assert force.std() > 0


@pytest.mark.slow
def test_filter_steers_more_quietly_than_the_thesis_s_way() -> None:
    thesis = balanced(NOMINAL, duration=5.0)
    kalman = balanced(NOMINAL, KalmanFilter(ALTEN, sample_time=0.005), duration=5.0)
    assert kalman.ended is None
    rough, quiet = (np.sqrt(np.mean(np.diff(log.torques, axis=0) ** 2)) for log in (thesis, kalman))
    assert quiet < rough / 3
    lean = np.degrees(kalman.states[:, 2:4] - kalman.truth().states[:, 2:4])
    assert np.sqrt(np.mean(np.sum(lean**2, axis=1))) < 0.15  # the thesis's: 0.14 of white noise alone
