"""Attitudes: the rates of theta, phi, psi from a gyro, and an attitude as a heading and a lean that are independent.

R = Rz(psi_s) M(g), with g the upward direction in the body's frame, M(g) the shortest turn that takes it upright and
psi_s the heading. Turning the robot about the vertical changes psi_s and nothing else; of theta, phi, psi it changes
all three.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def angle_rates(attitude: NDArray[np.float64], body_rate: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Phi_dot = B(Phi)^-1 w.

    The inverse is written out: `ballbot.mechanics.geometry.body_rates_matrix` is for arrays of robots and
    takes ten times as long for one, which a real-time loop feels.

    Parameters
    ----------
    attitude : array (3,)
        theta, phi, psi [rad]; |phi| below pi/2, where B has no inverse.
    body_rate : array (3,)
        Angular velocity w, body frame [rad/s].

    Returns
    -------
    array (3,)
        theta_dot, phi_dot, psi_dot [rad/s].
    """
    _, phi, psi = attitude.tolist()
    w_x, w_y, w_z = body_rate.tolist()
    s3, c3 = math.sin(psi), math.cos(psi)
    theta_dot = (c3 * w_x - s3 * w_y) / math.cos(phi)
    return np.array([theta_dot, s3 * w_x + c3 * w_y, w_z - math.sin(phi) * theta_dot])


def lean_of(theta: float, phi: float, psi: float) -> NDArray[np.float64]:
    """Return x and y (2,) of g = R^T e_z, R = Rx(theta) Ry(phi) Rz(psi)."""
    s3, c3 = math.sin(psi), math.cos(psi)
    forward, left = -math.cos(theta) * math.sin(phi), math.sin(theta)  # before the turn by psi
    return np.array([c3 * forward + s3 * left, c3 * left - s3 * forward])


def heading_of(theta: float, phi: float, psi: float) -> float:
    """Return psi_s [rad], with the turns of psi."""
    return psi + 2.0 * math.atan(math.tan(0.5 * theta) * math.tan(0.5 * phi))


def attitude_of_swing(lean: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    """Return theta, phi, psi (3,) [rad] of the lean g (2,) and psi_s [rad]; psi has psi_s's turns."""
    g_x, g_y = lean.tolist()
    g_z = math.sqrt(max(1.0 - g_x * g_x - g_y * g_y, 1e-6))
    share = 1.0 / (1.0 + g_z)
    s, c = math.sin(heading), math.cos(heading)
    # rows of M; R = Rz M; theta, phi, psi by R's last column and first row
    m11, m12, m22 = 1.0 - share * g_x * g_x, -share * g_x * g_y, 1.0 - share * g_y * g_y
    theta = math.atan2(s * g_x + c * g_y, g_z)
    phi = math.asin(max(-1.0, min(1.0, -c * g_x + s * g_y)))
    psi = math.atan2(s * m22 - c * m12, c * m11 - s * m12)
    return np.array([theta, phi, heading + math.remainder(psi - heading, 2.0 * math.pi)])


def turned_about_vertical(attitude: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Return theta, phi, psi (3,) of Rz(angle) R [rad]: the same attitude, seen from a frame turned by -angle.

    Where the angle is zero, they are the same to the bit.
    """
    if angle == 0.0:
        return attitude
    theta, phi, psi = attitude.tolist()
    return attitude_of_swing(lean_of(theta, phi, psi), heading_of(theta, phi, psi) + angle)
