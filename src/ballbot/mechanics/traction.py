"""Forces between wheels and ball, and the largest torque that the grip between them transmits.

Wheel i pushes the ball along t_i with f_i = tau_i / r_w, where tau_i is what its motor's torque has left after friction
and the wheel's own acceleration. So the ball pushes the body along -t_i with f_i and along n_i with N_i, and the body,
whose centre of mass has the acceleration a, needs in its own frame

    sum_i N_i n_i = m_r R^T (a + g) + sum_i f_i t_i          g: upward, (0, 0, g) on a level floor

which three wheels can in one way only (four: the one of least squares). Contact i slips where |f_i| > mu N_i, and has
lifted where N_i is not positive. Exact formulation; the rollers turn freely across t_i.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.engine.lanes import unpacked
from ballbot.mechanics.engine.slip import loads
from ballbot.mechanics.engine.vector import dot, rotate_back, scale
from ballbot.mechanics.equations import balancing_attitude, ball_rate
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.wheel_directions import contact_directions, rolling_directions

#: lean [rad] and torque [N m] over which forces are differenced, push [N], and directions of a fall
_SMALL, _DIRECTIONS = 1e-3, np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)


def pack_contacts(robot: Robot) -> NDArray[np.float64]:
    """Return a robot's contacts as the row (2 + 3 n + n^2,) that compiled code reads: m_r, 1/r_w, and N_i's factors."""
    azimuths = robot.wheels.azimuths
    n, t = contact_directions(azimuths, robot.wheels.tilt), rolling_directions(azimuths)
    pressing = np.linalg.pinv(n.T)
    scalars = [robot.body.mass, 1.0 / robot.wheels.radius]
    return np.concatenate([scalars, pressing.ravel(), (pressing @ t.T).ravel() / robot.wheels.radius])


def forces_at_contacts(P, a, w, accelerations, net, row):
    """Return f_i r_w, N_i and the floor's force for an attitude, a body velocity, (v_dot, w_dot) and net torques."""
    v_dot, w_dot = accelerations
    z_dot = rotate_back(a.R, ball_rate(P.inv_rb, v_dot))
    pushes = tuple(
        torque - P.d1 * dot(wheel.axle, z_dot) + P.d2 * dot(wheel.axle, w_dot)
        for wheel, torque in zip(P.wheels, net, strict=True)
    )
    return pushes, *loads(P, a.R, row, scale(P.gravity, row[0]), w, accelerations, pushes)


def torques_of_lean(model: Model) -> NDArray[np.float64]:
    """Return the wheel torques (n, 2) [N m/rad] that hold a lean theta, phi while the ball accelerates; linear."""
    linear = model.linearize()
    return -np.linalg.pinv(linear.B[7:]) @ linear.A[7:, 2:4]


class ContactForces(NamedTuple):
    """Forces between wheels and ball, upright and slow, to first order.

    In leans theta, phi [rad], wheel torques [N m], and a push of the body in x and y [N]: 4 + n values.
    """

    load: NDArray[np.float64]  #: (n,) N_i at rest [N]
    traction: NDArray[np.float64]  #: (n, 4 + n) f_i by the values [N]
    pressing: NDArray[np.float64]  #: (n, 4 + n) change of N_i by the values [N]


def contact_forces(model: Model, height: float = 0.0) -> ContactForces:
    """Return the forces between wheels and ball of a model without friction; a push is at a height [m]."""
    row, n = pack_contacts(model.robot).tolist(), model.robot.wheel_count
    P, pushed = unpacked(model.selected, model.packed.item), np.zeros((5, 2))
    pushed[[0, 1, 2, 3], [0, 1, 1, 0]] = 1.0, 1.0, -height, height
    by_push = np.linalg.inv(model.mass_matrix(np.zeros(5))) @ pushed
    carried = np.reshape(row[2 : 2 + 3 * n], (n, 3))[:, :2]

    def forces(values: NDArray[np.float64]) -> NDArray[np.float64]:
        (theta, phi, *torques), push = values[:-2].tolist(), values[-2:]
        a, q = balancing_attitude((theta, phi, 0.0)), [0.0, 0.0, theta, phi, 0.0]
        rates = (model.acceleration(q, np.zeros(5), torques) + by_push @ push).tolist()
        moments, pressing, _ = forces_at_contacts(P, a, (0.0,) * 3, (rates[:2], rates[2:]), torques, row)
        return np.array([np.divide(moments, model.robot.wheels.radius), pressing - carried @ push])

    steps = _SMALL * np.eye(4 + n)
    slopes = np.array([forces(step) - forces(-step) for step in steps]) / (2.0 * _SMALL)
    return ContactForces(forces(np.zeros(4 + n))[1], slopes[:, 0].T, slopes[:, 1].T)


def traction_torque(model: Model, grip: float) -> float:
    """Return the largest torque [N m] of a wheel up to which a robot that catches a fall slips at no wheel.

    At rest it leans by what the torques hold. Lean, torques and accelerations load some wheels and unload others: to
    first order, in the worst direction. The model is without friction, the grip a coefficient of friction.

    >>> round(traction_torque(Model("alten"), 0.4), 2)
    1.62
    """
    held, forces = torques_of_lean(model), contact_forces(model)
    falls = np.stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)], axis=-1)
    values = falls @ np.vstack([np.eye(2), held, np.zeros((2, 2))]).T
    traction, load = values @ forces.traction.T, values @ forces.pressing.T
    # |f| s = mu (N_0 + N s)
    leans = grip * forces.load / np.maximum(np.abs(traction) - grip * load, 1e-9)
    return float((leans.min(axis=1) * np.abs(falls @ held.T).max(axis=1)).min())
