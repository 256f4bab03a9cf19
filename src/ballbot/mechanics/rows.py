"""The equations as arrays: what the convex step and `Model` read.

Velocities in the order (v_x, v_y, w_1, w_2, w_3), and the ball's spin last where it pivots.
"""

import numpy as np

from ballbot.mechanics.compiled import by_types_of, inlined
from ballbot.mechanics.equations import SpinTerms, wheel_force
from ballbot.mechanics.parameters import Pivoting


@inlined
def fill(target, source):
    """Copy numbers one by one: an array's assignment brings text for its errors, which takes seconds to compile."""
    for i in range(len(source)):
        target[i] = source[i]


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
