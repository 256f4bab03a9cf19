"""What the driveline cannot hide: the robot's angular momentum about the point where the ball touches the floor.

Wheel torques, their friction and the gearboxes' play act between body and ball. They cancel in the sum of the
ball's equation of motion and the body's, taken with the lever r_b (design section 5, W = [A R^T E / r_b, -A]):

    (row v) + E^T R / r_b (row w)        E = [[0, -1], [1, 0], [0, 0]]

What is left, linear in the rates and for a small lean, in the heading frame:

    d/dt (v + C w) = -Lambda g

v is the ball's velocity, w the body's angular velocity, g = (x and y of R^T e_z) the upward direction in the body's
frame: (-sin phi, sin theta) at psi = 0, to second order. s = v + C w is the momentum as a speed; only gravity changes
it, and what pushes the robot from outside: rolling friction, a slope, a hand. No friction of the driveline, identified
or not, is in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.model import Model
from ballbot.robot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactMomentum:
    """The two matrices of d/dt (v + C w) = -Lambda g, heading frame."""

    lever: NDArray[np.float64]  #: (2, 3) C [m]
    pull: NDArray[np.float64]  #: (2, 2) Lambda [m/s^2]


def contact_momentum(robot: Robot) -> ContactMomentum:
    """Return the law of the momentum about the floor's contact, from the exact model's mass matrix upright."""
    E = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    both = np.hstack([np.eye(2), E.T / robot.ball.radius])  # (row v) + E^T / r_b (row w)
    mass = both @ Model(robot).mass_matrix(np.zeros(5))
    moment = robot.body.mass * robot.gravity * robot.body.center_of_mass  # gravity's, for a whole radian
    # gravity turns the body about g x e_z = (g_y, -g_x), and E^T (g_y, -g_x, 0) = -g
    pull = np.linalg.solve(mass[:, :2], np.eye(2) * moment / robot.ball.radius)
    lever = np.linalg.solve(mass[:, :2], mass[:, 2:])
    return ContactMomentum(lever=np.asarray(lever, dtype=np.float64), pull=np.asarray(pull, dtype=np.float64))
