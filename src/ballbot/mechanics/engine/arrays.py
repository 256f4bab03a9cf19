"""The equations of motion as arrays: for the convex step, and at many states for `Model`.

Velocities are in the order (v_x, v_y, w_1, w_2, w_3), and the ball's spin last where it pivots: m is 5 or 6. What
`Model` asks for is NumPy's: the traced functions, on arrays in place of numbers.
"""

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.smooth import acceleration, net_torques
from ballbot.mechanics.engine.tracing import traced
from ballbot.mechanics.engine.vector import subtract
from ballbot.mechanics.equations import (
    Attitude,
    SpinTerms,
    angle_rates,
    attitude,
    rates_from_angles,
    terms,
    wheel_force,
    wheel_speeds,
)
from ballbot.mechanics.floor import FloorFriction
from ballbot.mechanics.parameters import Exact, Pivoting, RobotNumbers, Thesis


@inlined
def fill(target, source):
    """Copy numbers one by one: an array's assignment brings text for its errors, which takes seconds to compile."""
    for i in range(len(source)):
        target[i] = source[i]


@traced
def in_order(v, w):
    """Return velocities or accelerations in the order of the arrays."""
    return v[:2] + w + v[2:]


@traced
def mass_rows(system):
    """Return M by rows."""
    rolling = system.rolling if isinstance(system, SpinTerms) else system
    (a, b, c), (x, y), (p, q, r, pq, pr, qr) = rolling.M_vv, rolling.M_vw, rolling.M_ww
    rows = ((a, c, *x), (c, b, *y), (x[0], y[0], p, pq, pr), (x[1], y[1], pq, q, qr), (x[2], y[2], pr, qr, r))
    if rolling is system:
        return rows
    spin = (*system.M_sv, *system.M_sw)
    return (*((*row, last) for row, last in zip(rows, spin, strict=True)), (*spin, system.M_ss))


def wheel_rows(selected, P, a):
    """Return the rows that give the wheel speeds."""
    return tuple(in_order(*wheel_force(selected, P, a, wheel.axle)) for wheel in P.wheels)


@traced
def angle_accelerations(selected, a, rates, w_dot):
    """Return the Euler angles' accelerations from the derivative of the formulation's body rates.

    Phi_ddot = B^-1 (w_dot - B_dot Phi_dot).
    """
    if isinstance(selected, Thesis):
        return w_dot
    t, p, s = rates
    cos_phi_dot, sin_phi_dot = -a.sin_phi * p, a.cos_phi * p
    cos_psi_dot, sin_psi_dot = -a.sin_psi * s, a.cos_psi * s
    turning = (
        (cos_phi_dot * a.cos_psi + a.cos_phi * cos_psi_dot) * t + sin_psi_dot * p,
        cos_psi_dot * p - (cos_phi_dot * a.sin_psi + a.cos_phi * sin_psi_dot) * t,
        sin_phi_dot * t,
    )
    return angle_rates(a, subtract(w_dot, turning))


# --- NumPy's: q (..., 5) = [x y theta phi psi] and rates q_dot (..., m) ---


def mass_matrices(selected: Exact | Thesis | Pivoting, P: RobotNumbers, q: NDArray) -> NDArray[np.float64]:
    """Return M(q) (..., m, m) in the coordinates q."""
    a = _attitude_at(q)
    M, S = _body_mass(selected, P, a), _rates_matrix(selected, a)
    return np.swapaxes(S, -1, -2) @ M @ S


def wheel_jacobians(selected: Exact | Thesis | Pivoting, P: RobotNumbers, q: NDArray) -> NDArray[np.float64]:
    """Return the matrices (..., n, m) that give wheel speeds from q_dot."""
    a = _attitude_at(q)
    return _matrix(wheel_rows(selected, P, a)) @ _rates_matrix(selected, a)


def wheel_speeds_at(
    selected: Exact | Thesis | Pivoting, P: RobotNumbers, q: NDArray, q_dot: NDArray
) -> NDArray[np.float64]:
    """Return the formulation's wheel speeds (..., n)."""
    a = _attitude_at(q)
    v, w = _velocities(selected, a, q_dot)
    return np.stack(wheel_speeds(selected, P, a, v, w), axis=-1)


def accelerations(
    selected: Exact | Thesis | Pivoting, P: RobotNumbers, q: NDArray, q_dot: NDArray, u: NDArray
) -> NDArray[np.float64]:
    """Return q_ddot (..., m) under wheel torques u (..., n); viscous friction counts, dry friction not."""
    a = _attitude_at(q)
    v, w = _velocities(selected, a, q_dot)
    none = (0.0,) * u.shape[-1]
    net = net_torques(P, _parts(u), wheel_speeds(selected, P, a, v, w), none, none)
    v_dot, w_dot = acceleration(selected, P, a, v, w, net, FloorFriction((0.0,) * len(v), 0.0))
    rates = _parts(q_dot[..., 2:5])
    return np.stack(in_order(v_dot, angle_accelerations(selected, a, rates, w_dot)), axis=-1)


def energies(
    selected: Exact | Thesis | Pivoting, P: RobotNumbers, q: NDArray, q_dot: NDArray
) -> NDArray[np.float64]:
    """Return kinetic and potential energy (...), 1/2 q_dot . M q_dot + m_r g l (R e).e."""
    a = _attitude_at(q)
    nu = np.stack(in_order(*_velocities(selected, a, q_dot)), axis=-1)
    return (
        0.5 * np.einsum("...i,...ij,...j", nu, _body_mass(selected, P, a), nu)
        + P.ml * P.gravity[2] * a.R[2][2]
    )


def _parts(vectors: NDArray) -> tuple:
    return tuple(np.moveaxis(vectors, -1, 0))


def _matrix(rows: tuple) -> NDArray[np.float64]:
    """Return rows of numbers or arrays (...) as (..., rows, columns)."""
    columns = len(rows[0])
    entries = np.broadcast_arrays(*(entry for row in rows for entry in row))
    return np.stack(entries, axis=-1).reshape(*entries[0].shape, len(rows), columns)


def _attitude_at(q: NDArray) -> Attitude:
    return attitude(_parts(q[..., 2:5]))


def _velocities(selected: Exact | Thesis | Pivoting, a: Attitude, q_dot: NDArray) -> tuple[tuple, tuple]:
    """Return v and w of rates q_dot."""
    rates = _parts(q_dot)
    return rates[:2] + rates[5:], rates_from_angles(selected, a, rates[2:5])


def _body_mass(selected: Exact | Thesis | Pivoting, P: RobotNumbers, a: Attitude) -> NDArray[np.float64]:
    """Return M (..., m, m) of the formulation's velocities."""
    at_rest = (0.0,) * (3 if isinstance(selected, Pivoting) else 2)
    return _matrix(mass_rows(terms(selected, P, a, at_rest, (0.0, 0.0, 0.0))))


def _rates_matrix(selected: Exact | Thesis | Pivoting, a: Attitude) -> NDArray[np.float64]:
    """Return S (..., m, m), from q_dot to the formulation's velocities."""
    size = 6 if isinstance(selected, Pivoting) else 5
    columns = [list(column) for column in np.eye(size).tolist()]
    for axis in range(3):
        columns[2 + axis][2:5] = rates_from_angles(selected, a, np.eye(3)[axis].tolist())
    return _matrix(tuple(zip(*columns, strict=True)))
