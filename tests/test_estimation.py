"""The on-board state against motions whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.estimation import OnboardState
from ballbot.estimation.attitude import angle_rates
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot
from ballbot.simulation.sensors import AttitudeSensor, Encoders

ALTEN = Robot.load("alten")

states = arrays(np.float64, 10, elements=st.floats(-1.2, 1.2))


def sensors_of(state: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Perfect wheel speeds and gyro of a state: A (z - w) and w, straight from design.md section 5."""
    gyro = body_rates_matrix(*state[2:5]) @ state[7:10]
    omega = np.array([-state[6], state[5], 0.0]) / ALTEN.ball.radius
    return transforms(ALTEN).T_owb @ (rotation(*state[2:5]).T @ omega - gyro), gyro


@given(states)
def test_perfect_sensors_give_back_the_state(state: NDArray[np.float64]) -> None:
    onboard = OnboardState(ALTEN, sample_time=0.005)
    onboard.reset(position=(state[0], state[1]))
    wheel_speeds, gyro = sensors_of(state)
    # rounding of two inverses, the second worst near phi = 1.2
    np.testing.assert_allclose(onboard.update(wheel_speeds, gyro, state[2:5]), state, atol=1e-12)


@given(arrays(np.float64, 3, elements=st.floats(-1.4, 1.4)), arrays(np.float64, 3, elements=st.floats(-9, 9)))
def test_angle_rates_invert_the_body_rates_matrix(attitude: NDArray, rates: NDArray) -> None:
    body_rate = body_rates_matrix(*attitude) @ rates
    np.testing.assert_allclose(angle_rates(attitude, body_rate), rates, atol=1e-11)


def test_position_of_a_circle_driven_while_turning() -> None:
    """One lap of radius 0.5 m in 10 s while the heading turns the other way: x, y stay the world's."""
    onboard = OnboardState(ALTEN, sample_time=0.005)
    onboard.reset()
    speed = 2 * np.pi / 10
    for t in 0.005 * np.arange(2001):
        state = np.zeros(10)
        state[4], state[9] = -0.7 * t, -0.7
        state[5], state[6] = 0.5 * speed * np.cos(speed * t), 0.5 * speed * np.sin(speed * t)
        found = onboard.update(*sensors_of(state), state[2:5])
        place = [0.5 * np.sin(speed * t), 0.5 * (1 - np.cos(speed * t))]
        # trapezoid's error: h^2/12 times path times speed^2
        np.testing.assert_allclose(found[:2], place, atol=1e-5)


def test_reset_forgets() -> None:
    onboard = OnboardState(ALTEN, sample_time=0.005)
    fresh = OnboardState(ALTEN, sample_time=0.005)
    fresh.reset()
    for _ in range(5):
        onboard.update(np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.2, 0.3]), np.array([0.1, -0.1, 0.3]))
    onboard.reset()
    for _ in range(3):
        sample = np.array([0.3, 0.1, -0.4]), np.array([0.0, 0.1, 0.0]), np.zeros(3)
        assert (onboard.update(*sample) == fresh.update(*sample)).all()


def test_refuses_a_sample_time_of_zero() -> None:
    with pytest.raises(InputError, match="above 0 s"):
        OnboardState(ALTEN, sample_time=0.0)


@pytest.mark.parametrize("window", [1, 4])
def test_encoders_count_and_difference(window: int) -> None:
    """A count is 360/55200 degrees; a steady speed is found to a count over the window."""
    encoders = Encoders(ALTEN, ALTEN.sensors, window=window)
    count = 2 * np.pi / (2000 * 27.6)
    start, speeds = np.array([1.0, -3.0, 700.0]), np.array([3.0, -0.02, 0.0])
    encoders.reset(start)
    for k in range(50):
        angles, found = encoders.read(start + speeds * 0.005 * k)
        error = speeds * 0.005 * k - angles
        assert (error > -1e-9).all()
        assert (error < count + 1e-9).all()
        np.testing.assert_allclose(angles / count, np.round(angles / count), atol=1e-6)
    np.testing.assert_allclose(found, speeds, atol=count / (window * 0.005) + 1e-9)


def test_heading_drifts_by_sixteen_degrees_in_three_minutes() -> None:
    """Appendix IV; noise of each kind has the size that the robot file says."""
    sensors = ALTEN.sensors
    imu = AttitudeSensor(sensors, np.random.default_rng(1))
    read = [imu.read(180.0, np.zeros(3), np.zeros(3)) for _ in range(4000)]
    gyro, attitude = (np.array(part) for part in zip(*read, strict=True))
    assert np.degrees(attitude[:, 2].mean()) == pytest.approx(16.0, abs=0.01)
    # 12000 and 4000 draws: a standard deviation is known to 0.7 and 1.2 %, four times that
    assert gyro.std() == pytest.approx(sensors.gyro_noise, rel=0.03)
    assert attitude[:, 0].std() == pytest.approx(sensors.attitude_noise, rel=0.05)
    quiet = replace(sensors, gyro_noise=0.0, attitude_noise=0.0, heading_drift=0.0)
    gyro, attitude = AttitudeSensor(quiet, np.random.default_rng(1)).read(9.0, np.ones(3), np.ones(3))
    assert (gyro == 1.0).all()
    assert (attitude == 1.0).all()
