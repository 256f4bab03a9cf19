"""Where the ball went, by the wheels: x, y and their rates for a log that has none.

    z = T_obw wheel speeds + w,    Omega = R z,    v = r_b (Omega_y, -Omega_x)

(Appendix V of the thesis.) Without slip; and what pivots under the robot does not move it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.columns import wheel_speed_names
from ballbot.log.log import Log
from ballbot.robot import Robot

_NEEDED = ("theta", "phi", "psi", "theta_dot", "phi_dot", "psi_dot")


def with_odometry(log: Log, robot: Robot) -> Log:
    """Return the log with x, y [m] and x_dot, y_dot [m/s] from its wheel speeds and attitude.

    Parameters
    ----------
    log : Log
        With theta, phi, psi, their rates, and every wheel's speed.
    robot : Robot
        Gives the geometry.

    Raises
    ------
    InputError
        Where a column is missing or has missing values.
    """
    from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms

    names = wheel_speed_names(robot.wheel_count)
    log.require(*_NEEDED, *names)
    theta, phi, psi, theta_dot, phi_dot, psi_dot = (log[name] for name in _NEEDED)
    rates = np.column_stack([theta_dot, phi_dot, psi_dot])
    w = np.einsum("nij,nj->ni", body_rates_matrix(theta, phi, psi), rates)
    z = np.column_stack([log[name] for name in names]) @ transforms(robot).T_obw.T + w
    Omega = np.einsum("nij,nj->ni", rotation(theta, phi, psi), z)
    x_dot, y_dot = robot.ball.radius * Omega[:, 1], -robot.ball.radius * Omega[:, 0]
    return log.with_columns(
        {"x": _integral(log.t, x_dot), "y": _integral(log.t, y_dot), "x_dot": x_dot, "y_dot": y_dot}
    )


def with_position(log: Log, robot: Robot) -> Log:
    """Return the log as it is where it has x, else with what `with_odometry` adds.

    Raises
    ------
    InputError
        If it has neither x nor the columns that give it.
    """
    if "x" in log:
        return log
    missing = [name for name in (*_NEEDED, *wheel_speed_names(robot.wheel_count)) if name not in log]
    if missing:
        raise InputError(f"The log has no x, and lacks {', '.join(missing)}, from which x could be computed.")
    return with_odometry(log, robot)


def _integral(t: NDArray[np.float64], rate: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))))
