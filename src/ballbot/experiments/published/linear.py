"""Linear models about upright: of any mixture of the thesis's approximations, and in a source's own state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.model import LinearModel
from ballbot.mechanics.symbolic import Corrections, equations
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class SourceModel:
    """x_dot = A x + B u in the state and order that a source has; such as `ballbot.lqr` takes."""

    A: NDArray[np.float64]  #: (m, m)
    B: NDArray[np.float64]  #: (m, n)


def mixture_model(robot: Robot, corrections: Corrections) -> LinearModel:
    """Return the linear model about upright of the equations with these corrections, without friction.

    As `Model.linearize`, which has the two named formulations; M and the torques' generalised force at rest come
    from the symbolic Lagrangian, and gravity tips with m_r g l whatever is corrected.
    """
    derived, upright = equations(robot, corrections), np.zeros(5)
    M = derived.mass_matrix(upright)
    Q = np.stack([derived.generalized_force(upright, upright, u) for u in np.eye(robot.wheel_count)], axis=1)
    tipping = robot.body.mass * robot.gravity * robot.body.center_of_mass
    A, B = np.zeros((10, 10)), np.zeros((10, robot.wheel_count))
    A[:5, 5:] = np.eye(5)
    A[5:, :5] = np.linalg.solve(M, np.diag([0.0, 0.0, tipping, tipping, 0.0]))
    B[5:] = np.linalg.solve(M, Q)
    return LinearModel(A=A, B=B)


def in_state(model: LinearModel, T: NDArray[np.float64]) -> SourceModel:
    """Return the model in the state z = T x, T (m, 10).

    Where z has fewer states than x they must be ones that the others do not act on.
    """
    back = np.linalg.pinv(T)
    return SourceModel(A=T @ model.A @ back, B=T @ model.B)


def unstable_poles(model: LinearModel) -> tuple[float, float]:
    """Return the poles [rad/s] with which the robot falls about its two horizontal axes, the faster first."""
    first, second = np.real(model.poles())[:2]
    return float(first), float(second)
