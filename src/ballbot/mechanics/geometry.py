"""The transformation matrices of the thesis's Appendix II, and attitudes.

The directions n_i, t_i and a_i of each wheel are those of `ballbot.robot.wheel_directions`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.robot import Robot
from ballbot.robot.wheel_directions import contact_directions, rolling_directions

#: (II.12) the ball's pushes on the ground that count as positive force in x and in y
_GROUND_PUSHES = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def wheel_load(robot: Robot) -> float:
    """Return the least force [N] with which the robot, at rest and upright, presses one of its wheels on the ball."""
    weight = np.array([0.0, 0.0, robot.body.mass * robot.gravity])
    return float(
        (np.linalg.pinv(contact_directions(robot.wheels.azimuths, robot.wheels.tilt).T) @ weight).min()
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Transforms:
    """The transformation matrices of Appendix II, by its names, for n wheels; read-only arrays.

    A name states output and input: T_owb is the wheels' speed from the ball's. Vectors of ball, body
    and wheels are in the body frame, those of the ground in the world frame.
    """

    T_tbw: NDArray[np.float64]  #: (II.10) (3, n) torque on the ball [N m] from wheel torques [N m]
    T_trw: NDArray[np.float64]  #: (II.11) (3, n) torque on the body from the forces at the wheels' hubs
    T_tbg: NDArray[np.float64]  #: (II.12) (3, 2) torque on the ball from the forces on the ground [N]
    T_fgb: NDArray[np.float64]  #: (2, 3) force on the ground from torque on the ball: T_tbg's pseudo-inverse
    T_owb: NDArray[np.float64]  #: (II.13) (n, 3) wheel speed [rad/s] from the ball's angular velocity; "A"
    T_owr: NDArray[np.float64]  #: (II.14) (n, 3) absolute wheel speed from the body's angular velocity
    T_vgb: NDArray[np.float64]  #: (II.15) (3, 3) velocity over ground [m/s] from the ball's turning
    T_obw: NDArray[np.float64]  #: (V.3) (3, n) ball's angular velocity from wheel speeds


def transforms(robot: Robot) -> Transforms:
    """Build the transformation matrices as Appendix II does: levers crossed with directions of force.

    Two departures from print. (II.15) divides by r_w, which makes a velocity over ground into an angular one; T_vgb is
    without that division, so that T_vgb Omega_ball = (x_dot, y_dot, 0). And the T_owb of four wheels has no inverse:
    T_obw is then its pseudo-inverse, the ball's velocity of least squared error.
    """
    r_b, r_w = robot.ball.radius, robot.wheels.radius
    azimuths = robot.wheels.azimuths
    n, t = contact_directions(azimuths, robot.wheels.tilt), rolling_directions(azimuths)
    r_pw, r_cw = r_b * n, (r_b + r_w) * n
    r_pg = np.array([0.0, 0.0, -r_b])

    # (Omega x r) . u = Omega . (r x u): the velocity matrices are rows of the same cross products
    T_owb, T_owr, T_tbg = (_cross(r_pw, t) / r_w, _cross(r_cw, -t) / r_w, _cross(r_pg, _GROUND_PUSHES).T)
    matrices = {
        "T_tbw": T_owb.T,
        "T_trw": T_owr.T,
        "T_tbg": T_tbg,
        "T_fgb": T_tbg.T / r_b**2,
        "T_owb": T_owb,
        "T_owr": T_owr,
        "T_vgb": np.vstack([T_tbg.T, np.zeros(3)]),
        "T_obw": np.linalg.inv(T_owb) if robot.wheel_count == 3 else np.linalg.pinv(T_owb),
    }
    for matrix in matrices.values():
        matrix.setflags(write=False)
    return Transforms(**matrices)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a x b (n, 3), at a tenth of the time of NumPy's own for so few rows."""
    (a1, a2, a3), (b1, b2, b3) = a.T, b.T
    return np.stack([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1], axis=1)


def rotation(theta: ArrayLike, phi: ArrayLike, psi: ArrayLike) -> NDArray[np.float64]:
    """Return R = Rx(theta) Ry(phi) Rz(psi) (S, 3, 3), (II.8) with (II.6) mended, which takes body to world.

    The angles [rad] broadcast to one shape S.
    """
    theta, phi, psi = np.broadcast_arrays(theta, phi, psi)
    s1, c1, s2, c2, s3, c3 = (f(angle) for angle in (theta, phi, psi) for f in (np.sin, np.cos))
    rows = (
        (c2 * c3, -c2 * s3, s2),
        (c1 * s3 + s1 * s2 * c3, c1 * c3 - s1 * s2 * s3, -s1 * c2),
        (s1 * s3 - c1 * s2 * c3, s1 * c3 + c1 * s2 * s3, c1 * c2),
    )
    return _matrix(theta.shape, rows)


def rotation_to(direction: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation (3, 3) about a horizontal axis that takes e_z to a direction (3,) that is not downward."""
    up = np.asarray(direction, dtype=np.float64)
    x, y, z = up / np.linalg.norm(up)
    turn = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + turn + turn @ turn / (1.0 + z)


def quaternion_of(theta: float, phi: float, psi: float) -> NDArray[np.float64]:
    """Return the unit quaternion wxyz (4,), body to world, of R = Rx(theta) Ry(phi) Rz(psi)."""
    a, b, c = math.cos(theta / 2), math.cos(phi / 2), math.cos(psi / 2)
    p, q, r = math.sin(theta / 2), math.sin(phi / 2), math.sin(psi / 2)
    return np.array(
        [a * b * c - p * q * r, p * b * c + a * q * r, a * q * c - p * b * r, a * b * r + p * q * c]
    )


def roll_pitch_yaw(w: ArrayLike, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> NDArray[np.float64]:
    """Return the angles (3, ...) [rad] of R = Rz(yaw) Ry(pitch) Rx(roll), ROS's convention, of unit quaternions."""
    w, x, y, z = (np.asarray(part, dtype=np.float64) for part in (w, x, y, z))
    return np.stack(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ]
    )


def body_rates_matrix(theta: ArrayLike, phi: ArrayLike, psi: ArrayLike) -> NDArray[np.float64]:
    """Return B (S, 3, 3) with w = B (theta_dot, phi_dot, psi_dot): the body's angular velocity in its own frame.

    The angles [rad] broadcast to one shape S. B does not depend on theta. It is singular at phi = +-pi/2.
    """
    _, phi, psi = np.broadcast_arrays(theta, phi, psi)
    s2, c2, s3, c3 = (f(angle) for angle in (phi, psi) for f in (np.sin, np.cos))
    return _matrix(phi.shape, ((c2 * c3, s3, 0.0), (-c2 * s3, c3, 0.0), (s2, 0.0, 1.0)))


def _matrix(shape: tuple[int, ...], rows: Sequence[Sequence[ArrayLike]]) -> NDArray[np.float64]:
    # one robot in a loop: stacking its nine numbers would take ten times as long as computing them
    # complex angles stay complex: derivatives by a complex step pass through here
    dtype = np.result_type(np.float64, *(entry for row in rows for entry in row))
    matrix = np.empty((*shape, 3, 3), dtype)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            matrix[..., i, j] = entry
    return matrix


def angle_rates(attitude: NDArray[np.float64], body_rate: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Phi_dot = B(Phi)^-1 w (3,) [rad/s] of theta, phi, psi (3,) [rad] and w (3,) [rad/s] in the body's frame.

    |phi| is below pi/2, where B has no inverse. The inverse is written out: `body_rates_matrix` is for arrays of robots
    and takes ten times as long for one, which matters in a real-time loop.
    """
    _, phi, psi = attitude.tolist()
    w_x, w_y, w_z = body_rate.tolist()
    s3, c3 = math.sin(psi), math.cos(psi)
    theta_dot = (c3 * w_x - s3 * w_y) / math.cos(phi)
    return np.array([theta_dot, s3 * w_x + c3 * w_y, w_z - math.sin(phi) * theta_dot])
