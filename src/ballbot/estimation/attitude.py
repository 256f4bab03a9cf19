"""Rates of theta, phi, psi from a gyro, for one sample at a time."""

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
