"""Wheels that slip, and pushes, in readings that are made by kinematics alone."""

import numpy as np
import pytest

from ballbot.estimation.interface import Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot

H = 0.005
STANDS = np.zeros(200)


def estimated(robot: Robot, speed: np.ndarray, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return states (N, 10) and the wheels that were taken to slip (N,), upright on a ball with speeds (N,) along x.

    `slip` (N, n) [rad/s] is what the wheels turn besides.
    """
    kept, angles, states, wheels = KalmanFilter(robot, sample_time=H), np.zeros(robot.wheel_count), [], []
    for v, by in zip(speed, slip, strict=True):
        rate = transforms(robot).T_owb @ np.array([0.0, v / robot.ball.radius, 0.0]) + by
        angles = angles + H * rate
        reading = Reading(wheel_angles=angles, wheel_speeds=rate, gyro=np.zeros(3), attitude=np.zeros(3))
        states.append(kept.update(reading))
        wheels.append(kept._memory["slip"]["wheel"][0])
    return np.array(states), np.array(wheels)


def slipping(robot: Robot, wheels: list[int]) -> np.ndarray:
    """Return what wheels slip by for 0.2 s [rad/s]: as fast as on the twin after a push."""
    slip = np.zeros((len(STANDS), robot.wheel_count))
    slip[100:140, wheels] = 15.0
    return slip


@pytest.mark.parametrize("wheel", range(3))
def test_wheel_that_slips_moves_nothing(wheel):
    states, wheels = estimated(Robot.load("alten"), STANDS, slipping(Robot.load("alten"), [wheel]))
    assert set(wheels[100:140]) == {wheel + 1}
    assert not wheels[:100].any()
    assert not wheels[140:].any()
    # two samples of the slip at most, of which it would move the ball by 10 mm; by 0.2 m in all of it
    assert np.abs(states[:, :2]).max() < 0.01
    assert np.abs(states[:, 4]).max() < np.radians(0.1)


def test_one_of_four_wheels_that_slips_moves_nothing():
    states, wheels = estimated(Robot.load("cmu"), STANDS, slipping(Robot.load("cmu"), [2]))
    assert set(wheels[100:140]) == {3}
    assert np.abs(states[:, :2]).max() < 0.01


def test_ball_that_pivots_is_no_slip():
    _, wheels = estimated(Robot.load("alten"), STANDS, slipping(Robot.load("alten"), [0, 1, 2]))
    assert not wheels.any()


def test_push_is_followed():
    """The momentum alone knows nothing of a push."""
    speed = np.clip(10.0 * H * (np.arange(200) - 100), 0.0, 1.0)
    states, wheels = estimated(Robot.load("alten"), speed, np.zeros((200, 3)))
    assert not wheels.any()
    # behind by the time over which it is averaged, 20 ms of 10 m/s^2
    assert np.abs(states[120:, 5] - 1.0).max() < 0.2
    assert np.abs(states[160:, 5] - 1.0).max() < 0.02
