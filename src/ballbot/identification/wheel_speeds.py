"""Wheel speeds as a log has them, and the ball's spin that follows from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import wheel_speed_names
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.mechanics.model import Model
from ballbot.robot import Robot


def measured_wheel_speeds(log: Log, robot: Robot) -> NDArray[np.float64]:
    """Return the wheel speeds (N, n) [rad/s]: the encoders', or where there are none those of the states."""
    names = wheel_speed_names(robot.wheel_count)
    if all(name in log for name in names):
        return np.column_stack([log[name] for name in names])
    states = _states(log)
    return Model(robot).wheel_speed(states[:, :5], states[:, 5:])


def ball_spin(log: Log, robot: Robot) -> NDArray[np.float64]:
    """Return the ball's spin about the vertical (N,) [rad/s], from the encoders and the body's rates.

    The encoders see A (z - w), w the body's rates and z = R^T Omega the ball's, both in the body's frame; so the spin
    is the vertical part of R (A^-1 wheel speeds + w).

    Raises
    ------
    InputError
        Where the log has no wheel speeds.
    """
    names = wheel_speed_names(robot.wheel_count)
    if not all(name in log for name in names):
        raise InputError(
            f"A pivoting ball needs the wheel speeds {names[0]} .. {names[-1]}, "
            "which the log does not have; exclude the heading from the cost instead."
        )
    angles, rates = _states(log)[:, 2:5], _states(log)[:, 7:10]
    w = (body_rates_matrix(*angles.T) @ rates[..., None])[..., 0]
    z = measured_wheel_speeds(log, robot) @ transforms(robot).T_obw.T + w
    return (rotation(*angles.T)[:, 2] * z).sum(axis=1)


def _states(log: Log) -> NDArray[np.float64]:
    return np.column_stack([log[name] for name in STATE_NAMES])
