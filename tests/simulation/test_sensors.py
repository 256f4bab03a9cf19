"""The sensors: each error has the size that it was given, and none where none was."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.estimation import Fix
from ballbot.estimation.swing import swing
from ballbot.robot import Robot, Sensors
from ballbot.simulation.sensors import Accelerometer, FixSource, SensorFaults, SensorSuite

ALTEN = Robot.load("alten")
QUIET = replace(ALTEN.sensors, gyro_noise=0.0, attitude_noise=0.0, heading_drift=0.0)


class Ahrs:
    """The gyro and the attitude of a suite's readings."""

    def __init__(self, sensors: Sensors, seed: int, faults: SensorFaults | None = None) -> None:
        self.suite = SensorSuite(ALTEN, sensors, faults=faults)
        self.suite.reset(np.random.default_rng(seed), np.zeros(3))

    def read(
        self, t: float, rate: NDArray[np.float64], angles: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        truth, velocity = np.zeros(10), np.zeros(6)
        truth[2:5], velocity[3:] = angles, rate
        reading = self.suite.read(t, truth, velocity, np.zeros(3))
        return reading.gyro, reading.attitude


@pytest.mark.parametrize("window", [1, 4])
def test_encoders_count_and_difference(window: int) -> None:
    """A count is 360/55200 degrees; a steady speed is found to a count over the window."""
    suite = SensorSuite(ALTEN, ALTEN.sensors, window=window)
    count = 2 * np.pi / (2000 * 27.6)
    start, speeds = np.array([1.0, -3.0, 700.0]), np.array([3.0, -0.02, 0.0])
    suite.reset(np.random.default_rng(0), start)
    found = np.zeros(3)
    for k in range(50):
        reading = suite.read(0.005 * k, np.zeros(10), np.zeros(6), start + speeds * 0.005 * k)
        angles, found = reading.wheel_angles, reading.wheel_speeds
        error = speeds * 0.005 * k - angles
        assert (error > -1e-9).all()
        assert (error < count + 1e-9).all()
        np.testing.assert_allclose(angles / count, np.round(angles / count), atol=1e-6)
    np.testing.assert_allclose(found, speeds, atol=count / (window * 0.005) + 1e-9)


def test_heading_drifts_by_sixteen_degrees_in_three_minutes() -> None:
    """Appendix IV; noise of each kind has the size in the robot file."""
    sensors = ALTEN.sensors
    imu = Ahrs(sensors, 1)
    read = [imu.read(180.0, np.zeros(3), np.zeros(3)) for _ in range(4000)]
    gyro, attitude = (np.array(part) for part in zip(*read, strict=True))
    assert np.degrees(attitude[:, 2].mean()) == pytest.approx(16.0, abs=0.01)
    # 12000 and 4000 draws: a standard deviation is known to 0.7 and 1.2 %, four times that
    assert gyro.std() == pytest.approx(sensors.gyro_noise, rel=0.03)
    assert attitude[:, 0].std() == pytest.approx(sensors.attitude_noise, rel=0.05)
    gyro, attitude = Ahrs(QUIET, 1).read(9.0, np.ones(3), np.ones(3))
    assert (gyro == 1.0).all()
    assert (attitude == 1.0).all()


def faulty(faults: SensorFaults, seed: int, samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gyro and attitude (samples, 3) of a robot that stands still, with the faults and nothing else."""
    imu = Ahrs(QUIET, seed, faults)
    read = [imu.read(0.005 * k, np.zeros(3), np.zeros(3)) for k in range(samples)]
    gyro, attitude = zip(*read, strict=True)
    return np.array(gyro), np.array(attitude)


def test_bias_is_drawn_stays_and_turns_the_heading() -> None:
    biases = np.array([faulty(SensorFaults(gyro_bias=0.002), seed, 1)[0][0] for seed in range(400)])
    assert biases.std() == pytest.approx(0.002, rel=0.09)  # 1200 draws: 2.1 %, four times that
    gyro, attitude = faulty(SensorFaults(gyro_bias=0.002), 1, 2001)
    assert (gyro == gyro[0]).all()
    assert attitude[-1, 2] == pytest.approx(10 * gyro[0, 2])
    assert (attitude[:, :2] == 0).all()


def test_bias_walks_as_the_root_of_time() -> None:
    ends = [
        np.diff(faulty(SensorFaults(gyro_bias_walk=1e-3), seed, 201)[0][[0, -1]], axis=0)
        for seed in range(60)
    ]
    assert np.std(ends) == pytest.approx(1e-3, rel=0.21)  # 180 draws over 1 s: 5.3 %, four times that


def test_lean_error_has_its_size_from_the_start_and_forgets_itself() -> None:
    faults = SensorFaults(lean_error=0.01, lean_error_time=0.5)
    leans = np.array([faulty(faults, seed, 101)[1][:, :2] for seed in range(150)])  # 0.5 s
    # 300 draws: 4.1 %, four times that
    assert leans[:, 0].std() == pytest.approx(0.01, rel=0.17)
    assert leans[:, -1].std() == pytest.approx(0.01, rel=0.17)
    kept = np.mean(leans[:, 0] * leans[:, -1]) / 0.01**2
    assert kept == pytest.approx(np.exp(-1.0), abs=0.23)  # 1/sqrt(300), four times that


def test_latency_is_in_whole_samples() -> None:
    imu = Ahrs(QUIET, 0, SensorFaults(latency=0.010))
    found = [imu.read(0.005 * k, np.full(3, k), np.full(3, 0.1 * k)) for k in range(6)]
    assert [gyro[0] for gyro, _ in found] == [0, 0, 0, 1, 2, 3]
    assert [attitude[1] for _, attitude in found] == pytest.approx([0, 0, 0, 0.1, 0.2, 0.3])


@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-4, 4))
def test_drift_turns_the_whole_frame_and_leaves_the_upward_direction(theta, phi, psi):
    """Body to world is turned about the vertical by the drift, as scipy's rotations have it."""
    imu = Ahrs(replace(QUIET, heading_drift=0.1), 0)
    _, found = imu.read(5.0, np.zeros(3), np.array([theta, phi, psi]))
    turned = Rotation.from_euler("Z", 0.5) * Rotation.from_euler("XYZ", [theta, phi, psi])
    np.testing.assert_allclose(Rotation.from_euler("XYZ", found).as_matrix(), turned.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(swing(*found)[:2], swing(theta, phi, psi)[:2], atol=1e-12)
    assert abs(found[2] - psi - 0.5) < 0.2  # no turn lost


def test_accelerometer_feels_gravity_and_the_way_round() -> None:
    """At rest R^T g; on a turntable w^2 r inward; both without noise."""
    place = Accelerometer(position=(0.2, 0.0, 0.5), noise=0.0)

    def felt(*motions: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]) -> NDArray:
        """Return the last of the forces felt at velocities, rates and attitudes, a sample apart."""
        suite, found = SensorSuite(ALTEN, QUIET, accelerometer=place), None
        for velocity, rate, angles in motions:
            truth = np.zeros(10)
            truth[2:5] = angles
            found = suite.read(0.0, truth, np.concatenate([velocity, rate]), np.zeros(3)).acceleration
        assert found is not None
        return found

    still, angles, g = np.zeros(3), np.array([0.1, -0.2, 0.3]), ALTEN.gravity
    leaning = Rotation.from_euler("XYZ", angles).as_matrix()
    np.testing.assert_allclose(felt((still, still, angles)), leaning.T @ [0, 0, g], atol=1e-12)
    turning = (still, np.array([0.0, 0.0, 3.0]), still)
    np.testing.assert_allclose(felt(turning, turning), [-9 * 0.2, 0, g], atol=1e-12)
    # free fall, while it begins to pitch by 2 rad/s^2: the place above the centre lags
    falling = (np.array([0, 0, -g * 0.005]), np.array([0.0, 0.01, 0.0]), still)
    expected = [2 * 0.5 - 0.01**2 * 0.2, 0, -2 * 0.2 - 0.01**2 * 0.5]
    np.testing.assert_allclose(felt((still, still, still), falling), expected, atol=1e-9)


def test_fixes_come_at_their_rate_with_their_noise_and_go_missing() -> None:
    truth = np.array([1.0, -2.0, 0, 0, 0.5, 0, 0, 0, 0, 0])
    source = FixSource(rate=12.0, position_noise=0.01, heading_noise=0.03, missing=0.25)

    def fixes(one: FixSource, times: NDArray[np.float64]) -> list[Fix | None]:
        suite = SensorSuite(ALTEN, QUIET, fix=one)
        suite.reset(np.random.default_rng(2), np.zeros(3))
        return [suite.read(t, truth, np.zeros(6), np.zeros(3)).fix for t in times.tolist()]

    found = fixes(source, 0.005 * np.arange(20 * 200 + 1))
    there = [fix for fix in found if fix is not None]
    assert found[0] is None
    assert len(there) == pytest.approx(0.75 * 240, abs=27)  # binomial: 6.7, four times that
    errors = np.array([fix.position - truth[:2] for fix in there if fix.position is not None])
    assert errors.std() == pytest.approx(0.01, rel=0.16)  # 360 draws: 3.7 %, four times that
    assert np.std([fix.heading for fix in there if fix.heading is not None]) == pytest.approx(0.03, rel=0.22)
    assert there[0].position_deviation == 0.01
    (only_heading,) = fixes(replace(source, position=False, missing=0.0), np.array([0.1]))
    assert only_heading is not None
    assert only_heading.position is None
    assert only_heading.heading is not None
