"""Whether the wheels hold the ball: the friction that each contact needs, of the force that presses it.

Wheel i pushes the ball along t_i with f_i = tau_i / r_w, where tau_i is what its motor's torque has left after friction
and the wheel's own acceleration. So the ball pushes the body along -t_i with f_i and along n_i with N_i, and the body,
whose centre of mass has the acceleration a, needs in its own frame

    sum_i N_i n_i = m_r R^T (a + g e_z) + sum_i f_i t_i

which three wheels can in one way only (four: the one of least squares). Contact i slips where |f_i| > mu N_i, and has
lifted where N_i is not positive. Exact formulation; the rollers turn freely across t_i.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.compiled import compiled, inlined
from ballbot.mechanics.equations import ball_rate
from ballbot.mechanics.friction import dry_friction, sign
from ballbot.mechanics.geometry import contact_directions, rolling_directions
from ballbot.mechanics.lanes import LANES, ROWS
from ballbot.mechanics.parameters import load
from ballbot.mechanics.smooth import acceleration, ball_velocity, floor_friction, pose
from ballbot.mechanics.steps import load_state, start_lane
from ballbot.mechanics.vector import add, cross, dot, each, each_with, rotate_back, scale
from ballbot.robot import Robot

_LIFTED = 1e9  # the friction needed where nothing presses


def pack_contacts(robot: Robot) -> NDArray[np.float64]:
    """Return a robot's contacts as the row (2 + 3 n + n^2,) that compiled code reads: m_r, 1/r_w, what gives N_i."""
    n, t = contact_directions(robot.wheels), rolling_directions(robot.wheels)
    pressing = np.linalg.pinv(n.T)
    scalars = [robot.body.mass, 1.0 / robot.wheels.radius]
    return np.concatenate([scalars, pressing.ravel(), (pressing @ t.T).ravel() / robot.wheels.radius])


@inlined
def friction_needed(selected, P, state, u, row, pushes):
    """Return the largest |f_i| / N_i under wheel torques u; `pushes` (n,) is room to work in.

    `state` has the formulation's body rates; a wheel at rest counts as one without dry friction.
    """
    a, speeds = pose(selected, P, state)
    v, w = ball_velocity(state), (state[7], state[8], state[9])
    signs, dry = each(sign, speeds), each(dry_friction, P.wheels, speeds)
    v_dot, w_dot = acceleration(selected, P, a, v, w, u, speeds, signs, dry, floor_friction(P, v))
    z_dot = rotate_back(a.R, ball_rate(P, v_dot))
    for i, wheel in enumerate(P.wheels):
        speed = speeds[i]
        lost = wheel.b * speed + signs[i] * dry[i]
        pushes[i] = u[i] - lost - P.d1 * dot(wheel.axle, z_dot) + P.d2 * dot(wheel.axle, w_dot)
    e = (0.0, 0.0, 1.0)
    turning = add(cross(w_dot, e), cross(w, cross(w, e)))
    straight = rotate_back(a.R, (v_dot[0], v_dot[1], P.g))
    force = add(scale(straight, row[0]), scale(turning, P.ml))
    return _largest_share(row, force, pushes)


@inlined
def _largest_share(row, force, pushes):
    n, largest = len(pushes), 0.0
    for i in range(n):
        pressing = dot((row[2 + 3 * i], row[3 + 3 * i], row[4 + 3 * i]), force)
        for j in range(n):
            pressing += row[2 + 3 * n + n * i + j] * pushes[j]
        share = abs(pushes[i]) * row[1] / pressing if pressing > 0.0 else _LIFTED
        largest = max(largest, min(share, _LIFTED))
    return largest


@compiled
def friction_needed_along(selected, parameters, contacts, states, torques, out):
    """Fill `out` (N,) with the friction needed at states (N, 10), of Euler angles' rates, under torques (N, n)."""
    work, pushes = np.zeros(ROWS * LANES), np.zeros(torques.shape[1])
    for i in range(len(parameters)):
        work[i * LANES] = parameters[i]
    P = load(selected, work, 0)
    for k in range(len(states)):
        start_lane(selected, work, 0, states[k], 0.0)
        u = each_with(_torque_at, selected.wheels, torques[k])
        out[k] = friction_needed(selected, P, load_state(selected, work, 0), u, contacts, pushes)


@inlined
def _torque_at(wheel, u):
    return u[wheel]
