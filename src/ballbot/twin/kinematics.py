"""From the robot's ten states to MuJoCo's coordinates and back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.geometry import body_rates_matrix, rotation


def attitude_of(quaternion_wxyz: NDArray[np.float64], *, near_psi: float) -> NDArray[np.float64]:
    """Return theta, phi, psi (3,) [rad] of R = Rx(theta) Ry(phi) Rz(psi).

    Parameters
    ----------
    quaternion_wxyz : array (4,)
        Unit quaternion, body to world.
    near_psi : float
        The heading's turns are chosen so that psi lies within half a turn of this [rad].
    """
    w, x, y, z = quaternion_wxyz.tolist()
    theta = math.atan2(2 * (w * x - y * z), 1 - 2 * (x * x + y * y))
    phi = math.asin(max(-1.0, min(1.0, 2 * (x * z + w * y))))
    psi = math.atan2(2 * (w * z - x * y), 1 - 2 * (y * y + z * z))
    return np.array([theta, phi, near_psi + math.remainder(psi - near_psi, 2 * math.pi)])


def quaternion_of(theta: float, phi: float, psi: float) -> NDArray[np.float64]:
    """Return the unit quaternion wxyz (4,), body to world, of R = Rx(theta) Ry(phi) Rz(psi)."""
    a, b, c = math.cos(theta / 2), math.cos(phi / 2), math.cos(psi / 2)
    p, q, r = math.sin(theta / 2), math.sin(phi / 2), math.sin(psi / 2)
    return np.array(
        [a * b * c - p * q * r, p * b * c + a * q * r, a * q * c - p * b * r, a * b * r + p * q * c]
    )


def body_rate(state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return w = B(Phi) Phi_dot (3,) [rad/s], body frame, of a state (10,)."""
    return body_rates_matrix(*state[2:5]) @ state[7:10]


def ball_rate(state: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return Omega (3,) [rad/s], world frame, of a ball that rolls without slip and does not pivot."""
    return np.array([-state[6], state[5], 0.0]) / radius


def encoder_speeds(
    state: NDArray[np.float64], wheels_from_ball: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return A (z - w) (n,) [rad/s]: the wheel speeds of a state (10,) without slip or play."""
    z = rotation(*state[2:5]).T @ ball_rate(state, radius)
    return wheels_from_ball @ (z - body_rate(state))


def turned(quaternion_wxyz: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a vector (3,) of a body's frame in the frame that the body's unit quaternion leads to."""
    w, axis = float(quaternion_wxyz[0]), quaternion_wxyz[1:]
    twice = 2.0 * np.cross(axis, vector)
    return vector + w * twice + np.cross(axis, twice)
