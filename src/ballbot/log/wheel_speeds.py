"""The wheel speeds of a log: by the encoders, or by the states.

An encoder sees A (z - w), with z = R^T Omega, Omega = (-y_dot, x_dot, 0) / r_b, w = B(Phi) Phi_dot, and A the thesis's
T_owb.
"""

from __future__ import annotations

import numpy as np

from ballbot.log.columns import STATE_NAMES, Floats, wheel_speed_names
from ballbot.log.log import Log
from ballbot.robot import Robot


def wheel_speeds_of_states(states: Floats, robot: Robot) -> Floats:
    """Return the wheel speeds (N, n) [rad/s] that an encoder sees at the states (N, 10), rolling without slip."""
    from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms

    theta, phi, psi = states[:, 2], states[:, 3], states[:, 4]
    x_dot, y_dot = states[:, 5], states[:, 6]
    Omega = np.column_stack([-y_dot, x_dot, np.zeros_like(x_dot)]) / robot.ball.radius
    z = np.einsum("nji,nj->ni", rotation(theta, phi, psi), Omega)
    w = np.einsum("nij,nj->ni", body_rates_matrix(theta, phi, psi), states[:, 7:10])
    return (z - w) @ transforms(robot).T_owb.T


def measured_wheel_speeds(log: Log, robot: Robot) -> Floats:
    """Return the wheel speeds (N, n) [rad/s]: the encoders', or those of the states where these are missing."""
    names = wheel_speed_names(robot.wheel_count)
    logged = set(names) <= set(log.names)
    speeds = np.column_stack([log[name] if logged else np.full(len(log), np.nan) for name in names])
    if np.isfinite(speeds).all():
        return speeds
    zero = np.zeros(len(log))  # the position does not matter
    states = np.column_stack([zero, zero, *(log[name] for name in STATE_NAMES[2:])])
    return np.where(np.isfinite(speeds), speeds, wheel_speeds_of_states(states, robot))
