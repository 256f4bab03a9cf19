"""The exact equations with friction of known signs in plain NumPy: what the compiled form must equal and peers run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot
from ballbot.robot.derived import reflected_rotor_inertia


def rate_of_change(robot: Robot) -> Callable[[NDArray, NDArray], NDArray]:
    """Return f(state, u) for states (x, y, theta, phi, psi, v_x, v_y, w_1, w_2, w_3), after docs/mechanics.md."""
    r_b, m_r, l, g = robot.ball.radius, robot.body.mass, robot.body.center_of_mass, robot.gravity  # noqa: E741
    drive, friction = robot.drive, robot.friction
    j_w = robot.wheels.inertia
    j_r = reflected_rotor_inertia(
        gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )
    k, J_0 = 1 + robot.wheels.radius / r_b, robot.body.inertia_about_ball_center()
    m_t = robot.ball.mass + robot.ball.inertia / r_b**2 + m_r
    A = transforms(robot).T_owb
    D = A.T @ A
    D1, D2, D3 = (j_w + j_r) * D, (j_w * k + j_r) * D, (j_w * (2 * k - 1) + j_r) * D
    e, E = np.array([0.0, 0.0, 1.0]), np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    e_cross = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    rolling = (robot.ball.mass + m_r) * g * friction.rolling

    def f(state: NDArray, u: NDArray) -> NDArray:
        angles, v, w = state[2:5], state[5:7], state[7:]
        R, x = rotation(*angles), np.cross
        z = R.T @ E @ v / r_b
        H = J_0 @ w + (D3 - D2) @ (w - z)
        M_vw = -m_r * l * (R @ e_cross)[:2] - E.T @ R @ D2 / r_b
        M = np.block([[m_t * np.eye(2) + E.T @ R @ D1 @ R.T @ E / r_b**2, M_vw], [M_vw.T, J_0 + D3]])
        W = np.hstack([A @ R.T @ E / r_b, -A])
        force = W.T @ (u - wheel_friction(A @ (z - w), friction))
        force[:2] -= (
            m_r * l * (R @ x(w, x(w, e)))[:2] + E.T @ R @ D1 @ x(z, w) / r_b + rolling * v / np.hypot(*v)
        )
        force[2:] += m_r * g * l * x(R.T @ e, e) - x(w, H) + D2 @ x(z, w)
        return np.concatenate([v, np.linalg.solve(body_rates_matrix(*angles), w), np.linalg.solve(M, force)])

    return f
