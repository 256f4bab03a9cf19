"""Whether the floor still carries the robot: where it would have to pull, the model no longer holds.

The centre of mass is at the height l cos(theta) cos(phi) above the ball's centre, so the floor pushes with

    (m_b + m_r) g + m_r l d^2/dt^2 (cos theta cos phi)

which falls to zero where the height's second derivative is -(m_b + m_r) g / (m_r l) (`lift_off`).
"""

from __future__ import annotations

import numpy as np

from ballbot.mechanics.compiled import compiled, inlined
from ballbot.mechanics.equations import rates_of_angles
from ballbot.mechanics.evaluate import angle_accelerations
from ballbot.mechanics.friction import dry_friction, sign
from ballbot.mechanics.lanes import LANES, ROWS
from ballbot.mechanics.parameters import load
from ballbot.mechanics.smooth import acceleration, ball_velocity, body_velocity, floor_friction, pose
from ballbot.mechanics.steps import load_state, start_lane
from ballbot.mechanics.vector import each, each_with
from ballbot.robot import Robot


def lift_off(robot: Robot) -> float:
    """Return -d^2/dt^2 (cos theta cos phi) [1/s^2] at which the floor no longer pushes."""
    body = robot.body
    return (robot.ball.mass + body.mass) * robot.gravity / (body.mass * body.center_of_mass)


@inlined
def sinking(selected, P, state, u):
    """Return -d^2/dt^2 (cos theta cos phi) [1/s^2] under wheel torques u and all friction of moving parts.

    `state` has the formulation's body rates; a wheel at rest counts as one without dry friction.
    """
    a, speeds = pose(selected, P, state)
    v, w = ball_velocity(state), body_velocity(state)
    signs, dry = each(sign, speeds), each(dry_friction, P.wheels, speeds)
    _, w_dot = acceleration(selected, P, a, v, w, u, speeds, signs, dry, floor_friction(P, v))
    rates = rates_of_angles(selected, a, w)
    theta, phi = rates[0], rates[1]
    accelerations = angle_accelerations(selected, a, rates, w_dot)
    st, ct, sp, cp = a.sin_theta, a.cos_theta, a.sin_phi, a.cos_phi
    centripetal = ct * cp * (theta * theta + phi * phi) - 2.0 * st * sp * theta * phi
    return centripetal + st * cp * accelerations[0] + ct * sp * accelerations[1]


@compiled
def sinking_of(selected, row, state, u):
    """Return `sinking` of one packed robot, under wheel torques u (n,).

    `state` is (10,), or (11,) with the spin where the ball pivots; its rates are the Euler angles'.
    """
    work = np.zeros(ROWS * LANES)
    for i in range(len(row)):
        work[i * LANES] = row[i]
    start_lane(selected, work, 0, state, 0.0)
    moving = load_state(selected, work, 0)
    return sinking(selected, load(selected, work, 0), moving, each_with(_torque_at, selected.wheels, u))


@inlined
def _torque_at(wheel, u):
    return u[wheel]
