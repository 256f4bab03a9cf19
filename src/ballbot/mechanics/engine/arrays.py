"""The equations of motion as arrays: for the convex step, and at many states for `Model`.

Velocities are in the order (v_x, v_y, w_1, w_2, w_3), and the ball's spin last where it pivots. Each `evaluate_...`
takes one packed robot (`parameters.pack`), rows q = [x y theta phi psi] and their rates, with the ball's spin as a
sixth where it pivots, and fills `out`; m is 5 or 6.
"""

import numpy as np

from ballbot.mechanics.engine.compiled import by_types_of, compiled, inlined
from ballbot.mechanics.engine.lanes import LANES, put_robot
from ballbot.mechanics.engine.loading import load_parameters
from ballbot.mechanics.engine.smooth import acceleration, net_torques
from ballbot.mechanics.engine.vector import each, each_with, element, subtract
from ballbot.mechanics.equations import (
    SpinTerms,
    angle_rates,
    attitude,
    rates_from_angles,
    terms,
    wheel_force,
    wheel_speeds,
)
from ballbot.mechanics.floor import FloorFriction
from ballbot.mechanics.parameters import Pivoting, Thesis


@inlined
def fill(target, source):
    """Copy numbers one by one: an array's assignment brings text for its errors, which takes seconds to compile."""
    for i in range(len(source)):
        target[i] = source[i]


@inlined
def _fill_rows(target, source):
    for i in range(len(source)):
        fill(target[i], source[i])


def in_order(v, w) -> np.ndarray:  # pragma: no cover (compiled form below)
    """Return velocities or accelerations as an array."""
    raise NotImplementedError("compiled code only")


@by_types_of(in_order)
def _in_order(v, w):
    if len(v) == 2:
        return lambda v, w: np.array([v[0], v[1], w[0], w[1], w[2]])
    return lambda v, w: np.array([v[0], v[1], w[0], w[1], w[2], v[2]])


def mass_matrix(system) -> np.ndarray:  # pragma: no cover
    """Return M (5, 5), or (6, 6) where the ball pivots."""
    raise NotImplementedError("compiled code only")


@by_types_of(mass_matrix)
def _mass_matrix(system):
    if system.instance_class is SpinTerms:
        return lambda system: _mass_matrix_with_spin(system)

    def rolling(system):
        M = np.empty((5, 5))
        _fill_mass_matrix(system, M)
        return M

    return rolling


@inlined
def _mass_matrix_with_spin(system):
    M = np.empty((6, 6))
    _fill_mass_matrix(system.rolling, M)
    for i in range(2):
        M[i, 5] = M[5, i] = system.M_sv[i]
    for i in range(3):
        M[2 + i, 5] = M[5, 2 + i] = system.M_sw[i]
    M[5, 5] = system.M_ss
    return M


@inlined
def _fill_mass_matrix(system, M):
    M[0, 0], M[1, 1], M[0, 1] = system.M_vv
    M[1, 0] = M[0, 1]
    for i in range(2):
        for j in range(3):
            M[i, 2 + j] = M[2 + j, i] = system.M_vw[i][j]
    M[2, 2], M[3, 3], M[4, 4], M[2, 3], M[2, 4], M[3, 4] = system.M_ww
    M[3, 2], M[4, 2], M[4, 3] = M[2, 3], M[2, 4], M[3, 4]


@inlined
def wheel_rows(selected, P, a):
    """Return W (n, 5 or 6): the rows that give the wheel speeds."""
    W = np.empty((len(P.wheels), len(in_order(*wheel_force(selected, P, a, (0.0, 0.0, 0.0))))))
    i = 0
    for wheel in P.wheels:
        F, L = wheel_force(selected, P, a, wheel.axle)
        fill(W[i], in_order(F, L))
        i += 1
    return W


def box_rows(selected, P, a) -> np.ndarray:  # pragma: no cover
    """Return the rows that give the wheel speeds, and the spin where the ball pivots: (n, 5) or (n + 1, 6)."""
    raise NotImplementedError("compiled code only")


@by_types_of(box_rows)
def _box_rows(selected, P, a):
    if selected.instance_class is Pivoting:

        def with_spin(selected, P, a):
            C = np.zeros((len(P.wheels) + 1, 6))
            W = wheel_rows(selected, P, a)
            for wheel in range(len(W)):
                fill(C[wheel], W[wheel])
            C[len(W), 5] = 1.0
            return C

        return with_spin
    return lambda selected, P, a: wheel_rows(selected, P, a)


@inlined
def _load_row(selected, row):
    work = np.zeros(len(row) * LANES)
    put_robot(work, 0, row)
    return load_parameters(selected, work, 0)


@inlined
def _triple(values, first):
    return (values[first], values[first + 1], values[first + 2])


@inlined
def _nothing(value):
    return 0.0


def velocity_of(selected, q_dot) -> tuple:  # pragma: no cover (compiled form below)
    """Return v: (x_dot, y_dot), and the spin where the ball pivots."""
    raise NotImplementedError("compiled code only")


@by_types_of(velocity_of)
def _velocity_of(selected, q_dot):
    if selected.instance_class is Pivoting:
        return lambda selected, q_dot: (q_dot[0], q_dot[1], q_dot[5])
    return lambda selected, q_dot: (q_dot[0], q_dot[1])


@compiled
def evaluate_mass_matrix(selected, row, q, out):
    """Fill out (lanes, m, m) with M(q) in the coordinates q."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        S = _rates_matrix(selected, a, out.shape[1])
        _fill_rows(out[lane], S.T @ _mass_matrix_at(selected, P, a, out[lane, 0]) @ S)


@compiled
def evaluate_upright(selected, row, angles, mass, rows):
    """Fill mass (5, 5) with M, and rows (n, 5) with the matrix that gives wheel speeds; angles (3,) are zero.

    Upright at psi = 0, velocities are the rates of q, so that no product of matrices needs to be compiled: a first call
    takes half the time of `evaluate_mass_matrix` and `evaluate_wheel_rows`.
    """
    P = _load_row(selected, row)
    a = attitude(_triple(angles, 0))
    _fill_mass_matrix(terms(selected, P, a, (0.0, 0.0), (0.0, 0.0, 0.0)), mass)
    i = 0
    for wheel in P.wheels:
        F, L = wheel_force(selected, P, a, wheel.axle)
        fill(rows[i], (F[0], F[1], L[0], L[1], L[2]))
        i += 1


@compiled
def evaluate_acceleration(selected, row, q, q_dot, u, out):
    """Fill out (lanes, m) with q_ddot under wheel torques u (lanes, n); viscous friction counts, dry friction not."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        rates = _triple(q_dot[lane], 2)
        v, w = velocity_of(selected, q_dot[lane]), rates_from_angles(selected, a, rates)
        torques = each_with(element, selected.wheels, u[lane])
        speeds = wheel_speeds(selected, P, a, v, w)
        none, on_floor = each(_nothing, speeds), FloorFriction(each(_nothing, v), 0.0)
        net = net_torques(P, torques, speeds, none, none)
        v_dot, w_dot = acceleration(selected, P, a, v, w, net, on_floor)
        fill(out[lane], in_order(v_dot, angle_accelerations(selected, a, rates, w_dot)))


@compiled
def evaluate_wheel_speeds(selected, row, q, q_dot, out):
    """Fill out (lanes, n) with the formulation's wheel speeds."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        w = rates_from_angles(selected, a, _triple(q_dot[lane], 2))
        i = 0
        for speed in wheel_speeds(selected, P, a, velocity_of(selected, q_dot[lane]), w):
            out[lane, i] = speed
            i += 1


@compiled
def evaluate_wheel_rows(selected, row, q, out):
    """Fill out (lanes, n, m) with the matrix that gives wheel speeds from q_dot."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        _fill_rows(out[lane], wheel_rows(selected, P, a) @ _rates_matrix(selected, a, out.shape[2]))


@compiled
def evaluate_energy(selected, row, q, q_dot, out):
    """Fill out (lanes, 2) with kinetic and potential energy, 1/2 q_dot . M q_dot and V = m_r g l (R e).e."""
    P = _load_row(selected, row)
    for lane in range(len(q)):
        a = attitude(_triple(q[lane], 2))
        w = rates_from_angles(selected, a, _triple(q_dot[lane], 2))
        nu = in_order(velocity_of(selected, q_dot[lane]), w)
        out[lane, 0] = 0.5 * np.dot(nu, _mass_matrix_at(selected, P, a, q_dot[lane]) @ nu)
        out[lane, 1] = P.ml * P.g * a.R[2][2]


@inlined
def _mass_matrix_at(selected, P, a, any_velocity):
    v = each(_nothing, velocity_of(selected, any_velocity))
    return mass_matrix(terms(selected, P, a, v, (0.0, 0.0, 0.0)))


@inlined
def _rates_matrix(selected, a, size):
    """Return S (m, m), from q_dot to the formulation's velocities."""
    S = np.zeros((size, size))
    for i in range(size):
        S[i, i] = 1.0
    for axis in range(3):
        unit = (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0)
        S[2, 2 + axis], S[3, 2 + axis], S[4, 2 + axis] = rates_from_angles(selected, a, unit)
    return S


def angle_accelerations(selected, a, rates, w_dot) -> tuple:  # pragma: no cover (compiled form below)
    """Return the Euler angles' accelerations from the derivative of the formulation's body rates."""
    raise NotImplementedError("compiled code only")


@by_types_of(angle_accelerations)
def _angle_accelerations(selected, a, rates, w_dot):
    if selected.instance_class is Thesis:
        return lambda selected, a, rates, w_dot: w_dot
    return lambda selected, a, rates, w_dot: _from_body_rates(a, rates, w_dot)


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
