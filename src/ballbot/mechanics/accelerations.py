"""From generalised forces to accelerations: M nu_dot = f solved by blocks, and by the ball's spin where it pivots."""

from ballbot.mechanics.engine.tracing import greatest, least, traced
from ballbot.mechanics.engine.vector import add, dot, scale, subtract, symmetric_times
from ballbot.mechanics.equations import SpinTerms, Terms
from ballbot.mechanics.parameters import Pivoting

_TWO, _THREE, _SIX = (0.0,) * 2, (0.0,) * 3, (0.0,) * 6
_TERMS = Terms(_THREE, (_THREE, _THREE), _SIX, _TWO, _THREE)
_SPIN_TERMS = SpinTerms(_TERMS, 0.0, _TWO, _THREE, 0.0)


def _solve_rolling(system, force_v, force_w):
    """Return M^-1 (force_v, force_w), of the five velocities by blocks: v is eliminated first."""
    a, c, b = system.M_vv
    inverse = 1.0 / (a * c - b * b)
    i_xx, i_yy, i_xy = c * inverse, a * inverse, -b * inverse
    X, Y = system.M_vw
    # rows of M_vv^-1 M_vw
    U = add(scale(X, i_xx), scale(Y, i_xy))
    V = add(scale(X, i_xy), scale(Y, i_yy))
    xx, yy, zz, xy, xz, yz = system.M_ww
    S = (
        xx - X[0] * U[0] - Y[0] * V[0],
        yy - X[1] * U[1] - Y[1] * V[1],
        zz - X[2] * U[2] - Y[2] * V[2],
        xy - X[0] * U[1] - Y[0] * V[1],
        xz - X[0] * U[2] - Y[0] * V[2],
        yz - X[1] * U[2] - Y[1] * V[2],
    )
    rest = subtract(force_w, add(scale(U, force_v[0]), scale(V, force_v[1])))
    w = _solve_symmetric(S, rest)
    f_x, f_y = force_v[0] - dot(X, w), force_v[1] - dot(Y, w)
    return (i_xx * f_x + i_xy * f_y, i_xy * f_x + i_yy * f_y), w


def _solve_symmetric(S, right):
    """Return S^-1 right for a symmetric 3 x 3 matrix, by cofactors."""
    xx, yy, zz, xy, xz, yz = S
    c_xx, c_xy, c_xz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    c_yy, c_yz, c_zz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    inverse = 1.0 / (xx * c_xx + xy * c_xy + xz * c_xz)
    return scale(symmetric_times((c_xx, c_yy, c_zz, c_xy, c_xz, c_yz), right), inverse)


@traced
def solve(system, force_v, force_w, holding=0.0):
    """Return M^-1 (force_v, force_w) as (v_dot, w_dot), where at most `holding` [N m] holds a spin that there is."""
    if isinstance(system, SpinTerms):
        return _solve_with_spin(system, force_v, force_w, holding)
    return _solve_rolling(system, force_v, force_w)


def _solve_with_spin(system, force_v, force_w, holding):
    """Return M^-1 (force_v, force_w) of six velocities: the spin is eliminated last.

    A torque of at most `holding` opposes the spin's acceleration; where it suffices, that is exactly zero.
    """
    v, w = _solve_rolling(system.rolling, (force_v[0], force_v[1]), force_w)
    dv, dw = _solve_rolling(system.rolling, system.M_sv, system.M_sw)
    coupling = system.M_sv[0] * v[0] + system.M_sv[1] * v[1] + dot(system.M_sw, w)
    stiffness = system.M_ss - system.M_sv[0] * dv[0] - system.M_sv[1] * dv[1] - dot(system.M_sw, dw)
    torque = force_v[2] - coupling
    spin = (torque - least(greatest(torque, -holding), holding)) / stiffness
    return (v[0] - spin * dv[0], v[1] - spin * dv[1], spin), subtract(w, scale(dw, spin))


@traced
def accelerated(system, holding):
    """Return (v_dot, w_dot) under the forces in the system."""
    force_v, force_w = forces_in(system)
    return solve(system, force_v, force_w, holding)


def forces_in(system):
    """Return the generalised forces in `Terms` or `SpinTerms`, (on v, on w)."""
    if isinstance(system, SpinTerms):
        return (*system.rolling.f_v, system.f_s), system.rolling.f_w
    return system.f_v, system.f_w


def with_forces(system, force_v, force_w):
    """Return the system with these forces in it."""
    if isinstance(system, SpinTerms):
        rolling = with_forces(system.rolling, force_v[:2], force_w)
        return system._replace(rolling=rolling, f_s=force_v[2])
    return system._replace(f_v=force_v, f_w=force_w)


def system_like(selected):
    """Return `Terms` or `SpinTerms` of zeros, of the kind that the selected equations have."""
    return _SPIN_TERMS if isinstance(selected, Pivoting) else _TERMS
