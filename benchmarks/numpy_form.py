"""The exact equations with friction of known signs in plain NumPy: what the compiled form must equal and peers run."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot

UNIT_Z, ROLLING = np.array([0.0, 0.0, 1.0]), np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
UNIT_Z_CROSS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


class Constants(NamedTuple):
    """What the exact equations are made of (docs/mechanics.md)."""

    r_b: float
    m_r: float
    l: float  # noqa: E741
    g: float
    D: tuple[NDArray, NDArray, NDArray]  #: D1, D2, D3
    J_0: NDArray
    m_t: float
    A: NDArray


def constants(robot: Robot) -> Constants:
    """Return the robot's constants."""
    r_b, j_w, j_r = robot.ball.radius, robot.wheels.inertia, robot.drive.reflected_inertia
    k, A = 1 + robot.wheels.radius / r_b, transforms(robot).T_owb
    D = A.T @ A
    return Constants(
        r_b=r_b,
        m_r=robot.body.mass,
        l=robot.body.center_of_mass,
        g=robot.gravity,
        D=((j_w + j_r) * D, (j_w * k + j_r) * D, (j_w * (2 * k - 1) + j_r) * D),
        J_0=robot.body.inertia_about_ball_center(),
        m_t=robot.ball.mass + robot.ball.inertia / r_b**2 + robot.body.mass,
        A=A,
    )


def rate_of_change(robot: Robot, *, smoothing: float = 0.0) -> Callable[[NDArray, NDArray], NDArray]:
    """Return f(state, u) for states (x, y, theta, phi, psi, v_x, v_y, w_1, w_2, w_3), after docs/mechanics.md.

    Dry friction has the sign w/sqrt(w^2 + smoothing^2) of a speed [rad/s].
    """
    r_b, m_r, l, g, (D1, D2, D3), J_0, m_t, A = constants(robot)  # noqa: E741
    e, E, e_cross = UNIT_Z, ROLLING, UNIT_Z_CROSS
    friction, weight = robot.friction, (robot.ball.mass + m_r) * g

    def wheel_torque(w: NDArray) -> NDArray:
        if smoothing == 0.0:
            return wheel_friction(w, friction)
        viscous = np.array(friction.viscous) * w
        return viscous + (wheel_friction(w, friction) - viscous) * np.abs(w) / np.hypot(w, smoothing)

    def f(state: NDArray, u: NDArray) -> NDArray:
        angles, v, w = state[2:5], state[5:7], state[7:]
        R, x = rotation(*angles), np.cross
        rolling = weight * friction.rolling * v / np.hypot(np.hypot(*v), r_b * smoothing)
        z = R.T @ E @ v / r_b
        H = J_0 @ w + (D3 - D2) @ (w - z)
        M_vw = -m_r * l * (R @ e_cross)[:2] - E.T @ R @ D2 / r_b
        M = np.block([[m_t * np.eye(2) + E.T @ R @ D1 @ R.T @ E / r_b**2, M_vw], [M_vw.T, J_0 + D3]])
        W = np.hstack([A @ R.T @ E / r_b, -A])
        force = W.T @ (u - wheel_torque(A @ (z - w)))
        force[:2] -= m_r * l * (R @ x(w, x(w, e)))[:2] + E.T @ R @ D1 @ x(z, w) / r_b + rolling
        force[2:] += m_r * g * l * x(R.T @ e, e) - x(w, H) + D2 @ x(z, w)
        return np.concatenate([v, np.linalg.solve(body_rates_matrix(*angles), w), np.linalg.solve(M, force)])

    return f
