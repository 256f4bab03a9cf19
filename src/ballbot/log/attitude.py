"""Roll, pitch and yaw of an IMU as Ballbot's angles: R_world_body = Rx(theta) Ry(phi) Rz(psi).

An IMU gives R_world_imu = Rz(yaw) Ry(pitch) Rx(roll), the aerospace order. One whose x axis stands at an angle `turn`
from the robot's, towards the left, has R_world_body = R_world_imu Rz(-turn). Ballbot's lean angles are about axes of
the world, roll and pitch about axes that turn with the heading: they are the same only while the heading is zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def from_roll_pitch_yaw(angles: NDArray[np.float64], *, turn: float = 0.0) -> NDArray[np.float64]:
    """Return theta, phi, psi (N, 3) [rad], psi without jumps.

    Parameters
    ----------
    angles : ndarray (N, 3)
        Roll, pitch and yaw [rad]; NaN goes through.
    turn : float
        Angle of the IMU's x axis from the robot's, towards the left [rad].
    """
    roll, pitch, yaw = angles.T
    c_r, s_r, c_p, s_p = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    c_y, s_y = np.cos(yaw), np.sin(yaw)
    # columns of R_world_imu
    x = np.stack([c_y * c_p, s_y * c_p, -s_p])
    y = np.stack([c_y * s_p * s_r - s_y * c_r, s_y * s_p * s_r + c_y * c_r, c_p * s_r])
    z = np.stack([c_y * s_p * c_r + s_y * s_r, s_y * s_p * c_r - c_y * s_r, c_p * c_r])
    x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    theta, phi = np.arctan2(-z[1], z[2]), np.arcsin(np.clip(z[0], -1.0, 1.0))
    psi = np.arctan2(-y[0], x[0])
    known = np.isfinite(psi)
    psi[known] = np.unwrap(psi[known])
    return np.column_stack([theta, phi, psi])
