"""Wheels that slip, and pushes, in readings that are made by kinematics alone."""

import numpy as np
import pytest

from ballbot.estimation.interface import Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot

H = 0.005
STANDS = np.zeros(200)
#: samples in which wheels slip, and those after them until they count again: 40 ms
SLIPS, AFTER = slice(100, 140), slice(140, 148)


def estimated(robot: Robot, speed: np.ndarray, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return states (N, 10) and whether the wheels were left out (N,), upright on a ball with speeds (N,) along x.

    `slip` (N, n) [rad/s] is what the wheels turn besides.
    """
    kept, angles, states, left_out = KalmanFilter(robot, sample_time=H), np.zeros(robot.wheel_count), [], []
    for v, by in zip(speed, slip, strict=True):
        rate = transforms(robot).T_owb @ np.array([0.0, v / robot.ball.radius, 0.0]) + by
        angles = angles + H * rate
        reading = Reading(wheel_angles=angles, wheel_speeds=rate, gyro=np.zeros(3), attitude=np.zeros(3))
        states.append(kept.update(reading))
        left_out.append(kept._memory["slip"]["lasting"][0] > 0.0)
    return np.array(states), np.array(left_out)


def slipping(robot: Robot, *wheels: float, count: int = len(STANDS)) -> np.ndarray:
    """Return by how much each wheel slips for 0.2 s [rad/s], as fast as on the twin after a push if that is 15."""
    slip = np.zeros((count, robot.wheel_count))
    slip[SLIPS, : len(wheels)] = wheels
    return slip


# two wheels that slip against each other look like a push if they slip as fast
@pytest.mark.parametrize("wheels", [(15.0,), (0.0, -15.0), (0.0, 0.0, 15.0), (15.0, 0.0, -8.0), (10.0, 6.0)])
def test_wheels_that_slip_move_nothing(wheels):
    states, left_out = estimated(Robot.load("alten"), STANDS, slipping(Robot.load("alten"), *wheels))
    assert left_out[SLIPS].all()
    assert left_out[AFTER][:-1].all()
    assert not left_out[: SLIPS.start].any()
    assert not left_out[AFTER.stop :].any()
    # in all of it one wheel alone would move the ball by 0.2 m
    assert np.abs(states[:, :2]).max() < 1e-3
    assert np.abs(states[:, 4]).max() < np.radians(0.1)


def test_one_of_four_wheels_that_slips_moves_nothing():
    states, left_out = estimated(Robot.load("cmu"), STANDS, slipping(Robot.load("cmu"), 0.0, 0.0, 15.0))
    assert left_out[SLIPS].all()
    assert np.abs(states[:, :2]).max() < 1e-3


def test_speed_that_was_hidden_by_slip_moves_the_position_once_the_wheels_roll():
    """A push that is too short to count as one ends in slip; until the wheels roll again the ball seems to stand."""
    speed = 0.12 * np.clip((np.arange(200) - 96) / 4.0, 0.0, 1.0)
    states, left_out = estimated(Robot.load("alten"), speed, slipping(Robot.load("alten"), 15.0))
    assert left_out[SLIPS].all()
    errors = states[:, 0] - H * np.cumsum(speed)
    assert errors[SLIPS][-1] < -0.015
    # of 29 mm; three tenths are taken for a push that came only meanwhile
    assert np.abs(errors[AFTER.stop + 10 :]).max() < 0.009


def test_wheels_that_slip_on_and_on_count_again_after_a_second():
    slip = np.zeros((500, 3))
    slip[100:, 0] = 15.0
    _, left_out = estimated(Robot.load("alten"), np.zeros(500), slip)
    assert left_out[100:300].all()
    assert not left_out[320:].any()


def test_ball_that_pivots_is_no_slip():
    _, left_out = estimated(Robot.load("alten"), STANDS, slipping(Robot.load("alten"), 15.0, 15.0, 15.0))
    assert not left_out.any()


def test_push_is_followed():
    """The momentum alone knows nothing of a push."""
    speed = np.clip(10.0 * H * (np.arange(200) - 100), 0.0, 1.0)
    states, left_out = estimated(Robot.load("alten"), speed, np.zeros((200, 3)))
    assert not left_out.any()
    # behind by the time over which it is averaged, 20 ms of 10 m/s^2
    assert np.abs(states[120:, 5] - 1.0).max() < 0.2
    assert np.abs(states[160:, 5] - 1.0).max() < 0.02
