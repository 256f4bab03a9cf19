"""The nonholonomic constraints that make a robot of the freed mechanism, and their elimination in NumPy.

    G nu = 0:   v_b - r_b Omega x e_z = 0                               the ball rolls on the floor
                Omega . e_z = 0                                         and does not pivot
                v_o - v_b = 0                                           the body stays at the ball's centre
                (velocity of rim - velocity of ball) . t_i = 0          each wheel drives the ball

    [ M  -G^T ] [ nu_dot ]   [ tau - bias  ]
    [ G    0  ] [ lambda ] = [ -G_dot nu   ]

M and bias are an engine's, nu is in the order of `freed_mechanism`. The multipliers are the constraints' forces: the
floor's on the ball at its lowest point, the pivot's torque, the ball's force on the body, the ball's on each rim.
"""

from dataclasses import dataclass

import numpy as np

from ballbot.arrays import Floats
from ballbot.robot import Robot
from tests.support.freed_mechanism import Motion, X, Y, Z, euler_axes, wheel_places

#: the row of G that keeps the ball from pivoting
NO_PIVOT = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Freed:
    """M nu_dot + bias = tau of the freed mechanism at N configurations, gravity within the bias."""

    mass_matrix: Floats  #: (N, 12 + n, 12 + n)
    bias: Floats  #: (N, 12 + n)


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """What the constrained mechanism does at N states."""

    accelerations: Floats  #: nu_dot (N, 12 + n)
    floor_force: Floats  #: (N, 3) [N], on the ball


def constraints(robot: Robot, motion: Motion) -> tuple[Floats, Floats]:
    """Return G (N, 7 + n, 12 + n) and G_dot nu (N, 7 + n).

    Only the wheels' rows turn, and they turn with the body: slip = (v_o - v_b) . t + (w - Omega) . (p x t)
    + rate (axle x rim) . t, with the contact p = hub + rim from the ball's centre.
    """
    n, r_b, r_w = robot.wheel_count, robot.ball.radius, robot.wheels.radius
    nu, w = motion.velocities, motion.velocities[:, 9:12]
    G, G_dot_nu = np.zeros((len(motion), 7 + n, 12 + n)), np.zeros((len(motion), 7 + n))
    G[:, :3, :3] = np.eye(3)
    G[:, :3, 3:6] = -r_b * np.array([np.cross(axis, Z) for axis in (X, Y, Z)]).T
    G[:, 3, 5] = 1.0
    G[:, 4:7, :3], G[:, 4:7, 6:9] = -np.eye(3), np.eye(3)
    for i, place in enumerate(wheel_places(robot)):
        rim = -r_w * place.contact
        t = motion.body.apply(place.rolling)
        arm = motion.body.apply(np.cross(place.hub + rim, place.rolling))
        row = G[:, 7 + i]
        row[:, 0:3], row[:, 6:9] = -t, t
        row[:, 3:6], row[:, 9:12] = -arm, arm
        row[:, 12 + i] = np.cross(place.axle, rim) @ place.rolling
        G_dot_nu[:, 7 + i] = np.sum(
            np.cross(w, t) * (nu[:, 6:9] - nu[:, :3]) + np.cross(w, arm) * (w - nu[:, 3:6]), axis=1
        )
    return G, G_dot_nu


def constrained(
    robot: Robot,
    motion: Motion,
    freed: Freed,
    torques: Floats,
    *,
    released: tuple[int, ...] = (),
) -> Solution:
    """Return the accelerations and the floor's force under wheel torques (N, n) and viscous friction.

    `released` are rows of G that do not hold: (NO_PIVOT,) lets the ball pivot.
    """
    size = motion.velocities.shape[1]
    G, G_dot_nu = (np.delete(part, released, axis=1) for part in constraints(robot, motion))
    tau = np.zeros_like(freed.bias)
    tau[:, 12:] = torques - np.array(robot.friction.viscous) * motion.velocities[:, 12:]
    matrix = np.zeros((len(motion), size + G.shape[1], size + G.shape[1]))
    matrix[:, :size, :size] = freed.mass_matrix
    matrix[:, :size, size:], matrix[:, size:, :size] = -np.swapaxes(G, 1, 2), G
    right = np.concatenate([tau - freed.bias, -G_dot_nu], axis=1)
    solution = np.linalg.solve(matrix, right[..., None])[..., 0]
    return Solution(accelerations=solution[:, :size], floor_force=solution[:, size : size + 3])


def robot_acceleration(q: Floats, q_dot: Floats, accelerations: Floats) -> Floats:
    """Return q_ddot (N, 5) from nu_dot (N, 12 + n): w_dot = axes . Phi_ddot + the turning of the axes.

    The axis of phi turns with theta's rate; that of psi with theta's and phi's.
    """
    axes, rates = euler_axes(q), q_dot[:, 2:5, None]
    about_theta = rates[:, 0] * axes[:, 0]
    about_phi = rates[:, 1] * axes[:, 1]
    turning = np.cross(about_theta, about_phi) + np.cross(about_theta + about_phi, rates[:, 2] * axes[:, 2])
    right = accelerations[:, 9:12] - turning
    angles = np.linalg.solve(np.swapaxes(axes, 1, 2), right[..., None])[..., 0]
    return np.concatenate([accelerations[:, :2], angles], axis=1)
