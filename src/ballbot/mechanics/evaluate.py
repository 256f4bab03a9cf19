"""The equations of motion at many states in one compiled call: what `Model` shows of the engine's inside.

Each function takes one packed robot (`parameters.pack`), rows q = [x y theta phi psi] and their rates, and
fills `out`.
"""

import numpy as np

from ballbot.mechanics.compiled import by_types_of, compiled, inlined
from ballbot.mechanics.engine import mass_matrix, wheel_rows
from ballbot.mechanics.equations import (
    angle_rates,
    attitude,
    rates_from_angles,
    terms,
    wheel_speeds,
)
from ballbot.mechanics.parameters import LANES, Exact, load
from ballbot.mechanics.smooth import acceleration
from ballbot.mechanics.vector import each, subtract


@inlined
def _load_row(selected, row):
    work = np.zeros(len(row) * LANES)
    for i in range(len(row)):
        work[i * LANES] = row[i]
    return load(selected, work, 0)


@inlined
def _triple(values, first):
    return (values[first], values[first + 1], values[first + 2])


@inlined
def _value_at(wheel, values):
    return values[wheel]


@inlined
def _no_sign(wheel, unused):
    return 2.0


@compiled
def evaluate_mass_matrix(selected, row, q, out):
    """Fill out (lanes, 5, 5) with M(q) in the coordinates q."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        M = mass_matrix(terms(selected, P, a, (0.0, 0.0), (0.0, 0.0, 0.0)))
        S = _rates_matrix(selected, a)
        out[lane] = S.T @ M @ S


@compiled
def evaluate_acceleration(selected, row, q, q_dot, u, out):
    """Fill out (lanes, 5) with q_ddot under wheel torques u (lanes, n); viscous friction counts, dry friction not."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        rates = _triple(q_dot[lane], 2)
        v, w = (q_dot[lane, 0], q_dot[lane, 1]), rates_from_angles(selected, a, rates)
        torques = each(_value_at, selected.wheels, u[lane])
        v_dot, w_dot, _ = acceleration(selected, P, a, v, w, torques, each(_no_sign, P.wheels, 0), 0.0)
        angles = angle_accelerations(selected, a, rates, w_dot)
        out[lane, 0], out[lane, 1] = v_dot
        out[lane, 2], out[lane, 3], out[lane, 4] = angles


@compiled
def evaluate_wheel_speeds(selected, row, q, q_dot, out):
    """Fill out (lanes, n) with the formulation's wheel speeds."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        w = rates_from_angles(selected, a, _triple(q_dot[lane], 2))
        i = 0
        for speed in wheel_speeds(selected, P, a, (q_dot[lane, 0], q_dot[lane, 1]), w):
            out[lane, i] = speed
            i += 1


@compiled
def evaluate_wheel_rows(selected, row, q, out):
    """Fill out (lanes, n, 5) with the matrix that gives wheel speeds from q_dot."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        out[lane] = wheel_rows(selected, P, a) @ _rates_matrix(selected, a)


@compiled
def evaluate_energy(selected, row, q, q_dot, out):
    """Fill out (lanes, 2) with kinetic and potential energy, 1/2 q_dot . M q_dot and V = m_r g l (R e).e."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        w = rates_from_angles(selected, a, _triple(q_dot[lane], 2))
        nu = np.array([q_dot[lane, 0], q_dot[lane, 1], w[0], w[1], w[2]])
        M = mass_matrix(terms(selected, P, a, (0.0, 0.0), (0.0, 0.0, 0.0)))
        out[lane, 0] = 0.5 * np.dot(nu, M @ nu)
        out[lane, 1] = P.ml * P.g * a.R[2][2]


@inlined
def _rates_matrix(selected, a):
    """Return S (5, 5), from q_dot to the formulation's velocities."""
    S = np.zeros((5, 5))
    S[0, 0] = S[1, 1] = 1.0
    for axis in range(3):
        unit = (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0)
        S[2, 2 + axis], S[3, 2 + axis], S[4, 2 + axis] = rates_from_angles(selected, a, unit)
    return S


def angle_accelerations(selected, a, rates, w_dot) -> tuple:  # pragma: no cover (compiled form below)
    """Return the Euler angles' accelerations from the derivative of the formulation's body rates."""
    raise NotImplementedError("compiled code only")


@by_types_of(angle_accelerations)
def _angle_accelerations(selected, a, rates, w_dot):
    if selected.instance_class is Exact:
        return lambda selected, a, rates, w_dot: _from_body_rates(a, rates, w_dot)
    return lambda selected, a, rates, w_dot: w_dot


@inlined
def _from_body_rates(a, rates, w_dot):
    """Phi_ddot = B^-1 (w_dot - B_dot Phi_dot)."""
    t, p, s = rates
    cos_phi_dot, sin_phi_dot = -a.sin_phi * p, a.cos_phi * p
    cos_psi_dot, sin_psi_dot = -a.sin_psi * s, a.cos_psi * s
    turning = (
        (cos_phi_dot * a.cos_psi + a.cos_phi * cos_psi_dot) * t + sin_psi_dot * p,
        cos_psi_dot * p - (cos_phi_dot * a.sin_psi + a.cos_phi * sin_psi_dot) * t,
        sin_phi_dot * t,
    )
    return angle_rates(a, subtract(w_dot, turning))
