"""Single rotations as matrices, without the cost of an object for each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def exponential(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation (3, 3) about v (3,) by its length [rad] (Rodrigues)."""
    angle = float(np.sqrt(v @ v))
    x, y, z = v
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-8:
        return np.eye(3) + K
    return np.eye(3) + np.sin(angle) / angle * K + (1.0 - np.cos(angle)) / angle**2 * (K @ K)


def logarithm(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return v (3,) with exponential(v) = R, for rotations by less than half a turn."""
    odd = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.sqrt(odd @ odd))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(R) - 1.0)))
    return odd if sine < 1e-12 else odd * (angle / sine)
