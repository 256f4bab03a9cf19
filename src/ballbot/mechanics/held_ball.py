"""The ball under a robot whose body is held upright by hand: what a wheel's torque moves then.

The ball rolls over the floor and takes the body with it, but the body neither leans nor turns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot


def held_ball_inertia(robot: Robot) -> NDArray[np.float64]:
    """Return the inertia (3, 3) [kg m^2] against the ball's angular acceleration, robot frame."""
    wheel = robot.wheels.inertia + robot.drive.reflected_inertia
    A, rolling = transforms(robot).T_owb, (robot.ball.mass + robot.body.mass) * robot.ball.radius**2
    return robot.ball.inertia * np.eye(3) + wheel * A.T @ A + np.diag([rolling, rolling, 0.0])


def wheel_mobility(robot: Robot) -> NDArray[np.float64]:
    """Return the acceleration of wheel i under a torque at wheel j (n, n) [rad/s^2 / (N m)], without friction."""
    A = transforms(robot).T_owb
    return A @ np.linalg.solve(held_ball_inertia(robot), A.T)
