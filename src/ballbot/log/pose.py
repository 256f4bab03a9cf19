"""Where the robot is: the ball's position from the wheels (odometry), the body's pose from motion capture.

    z = T_obw wheel speeds + w,    Omega = R z,    v = r_b (Omega_y, -Omega_x)

(Appendix V of the thesis.) The ball rolls without slip; pivoting under the robot does not move it. Logs of motion
capture hold t, x y z of a point and qw qx qy qz of a body, with NaN where nothing was seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

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


QUATERNION_NAMES = ("qw", "qx", "qy", "qz")
PLACE_NAMES = ("x", "y", "z")
#: how far from one a quaternion's norm may be and still mean an orientation
_NORM_TOLERANCE = 0.1
_LEAST_POSES = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Poses:
    """What cameras saw, in their frame and on their clock."""

    t: NDArray[np.float64]  #: (M,) [s]
    rotations: Rotation  #: M of them, body to cameras; where unseen, the one seen last
    seen: NDArray[np.bool_]  #: (M,), the orientation is there
    places: NDArray[np.float64]  #: (M, 3) [m]; NaN where there is none

    def seen_only(self) -> Poses:
        """Return the poses whose orientation is there; where cameras saw nothing there is a gap in their times."""
        return Poses(
            t=self.t[self.seen],
            rotations=Rotation.from_quat(self.rotations.as_quat()[self.seen]),
            seen=self.seen[self.seen],
            places=self.places[self.seen],
        )


def read_poses(film: Log) -> Poses:
    """Return the poses of a log of motion capture; without x, y and z the places are NaN.

    Raises
    ------
    InputError
        Where there are no unit quaternions qw, qx, qy, qz.
    """
    wxyz = np.column_stack([film[name] for name in QUATERNION_NAMES])
    seen = np.isfinite(wxyz).all(axis=1) & (np.abs(np.linalg.norm(wxyz, axis=1) - 1.0) < _NORM_TOLERANCE)
    if seen.sum() < _LEAST_POSES:
        raise InputError("The motion capture has no poses; it needs unit quaternions in qw, qx, qy, qz.")
    last = np.maximum.accumulate(np.where(seen, np.arange(len(seen)), np.argmax(seen)))
    placed = all(name in film for name in PLACE_NAMES)
    places = np.column_stack([film[n] for n in PLACE_NAMES]) if placed else np.full((len(seen), 3), np.nan)
    return Poses(
        t=film.t,
        rotations=Rotation.from_quat(wxyz[last][:, [1, 2, 3, 0]]),
        seen=seen,
        places=np.where(np.isfinite(places).all(axis=1, keepdims=True), places, np.nan),
    )
