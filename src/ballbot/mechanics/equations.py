"""The equations of motion, compiled: both formulations of docs/mechanics.md.

Velocities are nu = (v, w): the ball's (v_x, v_y) in the world and three rates of the body, which are its
angular velocity in its own frame in the exact formulation and the Euler angles' rates Phi_dot in the thesis's.
Either way the equations read

    M(Phi) nu_dot = f(Phi, nu) + W^T tau        wheel speeds  W nu
    W = [ A R^T E / r_b , -A ]  (exact)         W = [ A R^T E / r_b , -k A R^T ]  (thesis)

The ball may also be let pivot on the floor (`Pivoting`): its spin about the vertical, sigma, is then a sixth velocity
and v = (v_x, v_y, sigma), so that Omega = E v_xy / r_b + sigma e_z and W has one more column, A R^T e_z.

Above, A^T tau is the wheels' torque on the ball in the body's frame. The thesis's approximations (its
mistakes 4 to 7, docs/generated/reproduce.md) are the differences between the two functions `terms_exact` and
`terms_thesis`.
"""

from typing import NamedTuple

from ballbot.mechanics.engine.elementary import sine_cosine, sine_cosine_of_lean
from ballbot.mechanics.engine.tracing import greatest, least, traced
from ballbot.mechanics.engine.vector import (
    add,
    advanced,
    cross,
    dot,
    rotate,
    rotate_back,
    scale,
    subtract,
    symmetric_times,
    total,
)
from ballbot.mechanics.parameters import Pivoting, Thesis

#: beyond this lean, theta or phi [rad], a simulation ends: no wheel touches the ball any more
LARGEST_LEAN = 1.2


class Attitude(NamedTuple):
    """Rotation matrix by rows, body to world, and the sines and cosines that made it."""

    R: tuple
    sin_theta: float
    cos_theta: float
    sin_phi: float
    cos_phi: float
    sin_psi: float
    cos_psi: float


class Terms(NamedTuple):
    """Mass matrix by blocks and generalised forces; `terms` returns those that are not the wheels'."""

    M_vv: tuple  #: xx, yy, xy
    M_vw: tuple  #: two rows of three
    M_ww: tuple  #: symmetric
    f_v: tuple  #: 2
    f_w: tuple  #: 3


class SpinTerms(NamedTuple):
    """`Terms` with the ball's spin as a sixth velocity."""

    rolling: Terms  #: the five others
    M_ss: float
    M_sv: tuple  #: 2
    M_sw: tuple  #: 3
    f_s: float


@traced
def attitude(angles):
    """Return R = Rx(theta) Ry(phi) Rz(psi) and its sines and cosines."""
    theta, phi, psi = sine_cosine(angles[0]), sine_cosine(angles[1]), sine_cosine(angles[2])
    return attitude_of(theta + phi + psi)


@traced
def balancing_attitude(angles):
    """Return the `Attitude` of a robot that leans by less than 1.3 rad; past `LARGEST_LEAN` its simulation ends."""
    theta, phi, psi = sine_cosine_of_lean(angles[0]), sine_cosine_of_lean(angles[1]), sine_cosine(angles[2])
    return attitude_of(theta + phi + psi)


@traced
def sines(a):
    """Return sine and cosine of theta, phi and psi."""
    return (a.sin_theta, a.cos_theta, a.sin_phi, a.cos_phi, a.sin_psi, a.cos_psi)


@traced
def attitude_of(sines):
    """Return the `Attitude` from sine and cosine of theta, phi and psi."""
    st, ct, sp, cp, ss, cs = sines
    R = (
        (cp * cs, -cp * ss, sp),
        (ct * ss + st * sp * cs, ct * cs - st * sp * ss, -st * cp),
        (st * ss - ct * sp * cs, st * cs + ct * sp * ss, ct * cp),
    )
    return Attitude(R, st, ct, sp, cp, ss, cs)


@traced
def body_rates(a, angle_rates):
    """Return w = B(Phi) Phi_dot."""
    t, p, s = angle_rates
    return (
        a.cos_phi * a.cos_psi * t + a.sin_psi * p,
        a.cos_psi * p - a.cos_phi * a.sin_psi * t,
        a.sin_phi * t + s,
    )


@traced
def angle_rates(a, w):
    """Return Phi_dot = B(Phi)^-1 w; singular where cos(phi) = 0."""
    theta_dot = (a.cos_psi * w[0] - a.sin_psi * w[1]) / a.cos_phi
    return (theta_dot, a.sin_psi * w[0] + a.cos_psi * w[1], w[2] - a.sin_phi * theta_dot)


@traced
def ball_rate(inv_rb, v):
    """Return Omega = E v / r_b (+ sigma e_z): the ball's angular velocity in the world; it rolls without slip."""
    return (-v[1] * inv_rb, v[0] * inv_rb, v[2] if len(v) == 3 else 0.0)


def ground_force(P, T):
    """Return E^T T / r_b: the force on the ball's path that a torque T on it, in the world, amounts to."""
    return (T[1] * P.inv_rb, -T[0] * P.inv_rb)


def _mass_vv(P, a, spin_inertia):
    """M_vv = m_t I + E^T R D1 R^T E / r_b^2, D1 = spin_inertia D, and the rows x, y of R D."""
    D_x, D_y = symmetric_times(P.D, a.R[0]), symmetric_times(P.D, a.R[1])
    factor = spin_inertia * P.inv_rb * P.inv_rb
    M_vv = (P.m_t + factor * dot(D_y, a.R[1]), P.m_t + factor * dot(D_x, a.R[0]), -factor * dot(D_x, a.R[1]))
    return M_vv, D_x, D_y


def terms_exact(P, a, v, w):
    """Return the `Terms` of the exact formulation (docs/mechanics.md), e = (0, 0, 1).

    The wheels' rates A (z - w) are no derivatives of functions of q, so Lagrange's equation may not be given
    energies in which they are already put in: each wheel keeps its own momentum until d'Alembert's principle
    has been applied. What is left of the gyroscopic terms is w x H, with H the part of the angular momentum of body
    and turning wheels that is fixed to the body.

    Products with the zeros of e are left out by hand: the compiler may not, since 0 times infinity is no 0.
    """
    R = a.R
    z = _rotate_back_rate(R, ball_rate(P.inv_rb, v), v)
    D_zxw = symmetric_times(P.D, cross(z, w))
    # d3 - d2 = j_w r_w / r_b: a wheel turns about -a_i, relative to the body
    H = add(symmetric_times(P.J, w), scale(symmetric_times(P.D, subtract(w, z)), P.d3 - P.d2))

    M_vv, D_x, D_y = _mass_vv(P, a, P.d1)
    k2 = P.d2 * P.inv_rb
    # - m_r l (R [e]x)_xy - E^T R D2 / r_b
    M_vw = (
        (-P.ml * R[0][1] - k2 * D_y[0], P.ml * R[0][0] - k2 * D_y[1], -k2 * D_y[2]),
        (-P.ml * R[1][1] + k2 * D_x[0], P.ml * R[1][0] + k2 * D_x[1], k2 * D_x[2]),
    )
    M_ww = advanced(P.J, P.D, P.d3)

    # force on v: - m_r l R (w x (w x e)) - E^T R D1 (z x w) / r_b
    c = scale((w[0] * w[2], w[1] * w[2], -w[0] * w[0] - w[1] * w[1]), P.ml)
    k1 = P.d1 * P.inv_rb
    # and the weight along the floor, - (m_b + m_r) g_xy, where g points up and is (0, 0, g) on a level floor
    f_v = (
        -dot(R[0], c) - k1 * dot(R[1], D_zxw) - P.weight[0],
        k1 * dot(R[0], D_zxw) - dot(R[1], c) - P.weight[1],
    )
    # force on w: gravity m_r l (R^T g) x e, less w x H - D2 (z x w)
    g = P.gravity
    w_x_H = cross(w, H)
    f_w = (
        P.ml * (R[0][1] * g[0] + R[1][1] * g[1] + R[2][1] * g[2]) - w_x_H[0] + P.d2 * D_zxw[0],
        -P.ml * (R[0][0] * g[0] + R[1][0] * g[1] + R[2][0] * g[2]) - w_x_H[1] + P.d2 * D_zxw[1],
        -w_x_H[2] + P.d2 * D_zxw[2],
    )
    return Terms(M_vv, M_vw, M_ww, f_v, f_w)


def terms_pivoting(P, a, v, w):
    """Return the `SpinTerms` of the exact formulation with a ball that pivots.

    To T comes 1/2 j_b sigma^2, and z = R^T Omega has sigma in it; the rest is the exact formulation's.
    """
    R = a.R
    z = _rotate_back_rate(R, ball_rate(P.inv_rb, v), v)
    D_z = symmetric_times(P.D, R[2])
    factor = P.d1 * P.inv_rb
    return SpinTerms(
        terms_exact(P, a, v, w),
        P.j_b + P.d1 * dot(R[2], D_z),
        (factor * dot(R[1], D_z), -factor * dot(R[0], D_z)),
        scale(D_z, -P.d2),
        -P.d1 * dot(D_z, cross(z, w)),
    )


def _rotate_back_rate(R, Omega, v):
    """Return z = R^T Omega, without the products with Omega_z = 0 where the ball does not pivot."""
    if len(v) == 3:
        return rotate_back(R, Omega)
    return tuple(R[0][i] * Omega[0] + R[1][i] * Omega[1] for i in range(3))


def terms_thesis(P, a, v, rates):
    """Return the `Terms` of the thesis's Appendix II as printed (Lagrange's equation for II.28).

    The body turns with Omega_body = Phi_dot (II.24), which enters (II.16) as if it were given in the world;
    the body's centre of mass moves as it really does (II.23).
    """
    R = a.R
    st, ct, sp, cp = a.sin_theta, a.cos_theta, a.sin_phi, a.cos_phi
    t_dot, p_dot = rates[0], rates[1]
    w = body_rates(a, rates)  # the true rate, with which R turns
    zeta = rotate_back(R, subtract(ball_rate(P.inv_rb, v), scale(rates, P.k)))  # Omega_wheels = A zeta
    y = scale(symmetric_times(P.D, zeta), P.d1)
    wheel_momentum_rate = rotate(R, subtract(cross(w, y), scale(symmetric_times(P.D, cross(w, zeta)), P.d1)))

    M_vv, D_x, D_y = _mass_vv(P, a, P.d1)
    D_E = (rotate(R, D_y), scale(rotate(R, D_x), -1.0))  # E^T R D R^T, by rows
    factor = P.k * P.d1 * P.inv_rb
    # (R e)_xy = (sin phi, -sin theta cos phi): how lean moves the centre of mass
    M_vw = (
        subtract((0.0, P.ml * cp, 0.0), scale(D_E[0], factor)),
        subtract((-P.ml * ct * cp, P.ml * st * sp, 0.0), scale(D_E[1], factor)),
    )
    D_x_world, D_y_world = rotate(R, D_x), rotate(R, D_y)
    D_z_world = rotate(R, symmetric_times(P.D, R[2]))
    k2 = P.k * P.k * P.d1
    spin = (
        k2 * D_x_world[0],
        k2 * D_y_world[1],
        k2 * D_z_world[2],
        k2 * D_x_world[1],
        k2 * D_x_world[2],
        k2 * D_y_world[2],
    )
    translation = (P.ml2 * cp * cp, P.ml2, 0.0, 0.0, 0.0, 0.0)
    M_ww = add(add(P.J, spin), translation)

    lean_x = -sp * p_dot * p_dot
    lean_y = st * cp * (t_dot * t_dot + p_dot * p_dot) + 2.0 * ct * sp * t_dot * p_dot
    ground = ground_force(P, wheel_momentum_rate)
    f_v = (-P.ml * lean_x - ground[0], -P.ml * lean_y - ground[1])
    # dT/dPhi of the wheels' energy: R turns about the columns b_j of B
    b_theta = (cp * a.cos_psi, -cp * a.sin_psi, sp)
    b_phi = (a.sin_psi, a.cos_psi, 0.0)
    turning = cross(y, zeta)
    f_w = (
        P.ml * P.gravity[2] * st * cp + 2.0 * P.ml2 * cp * sp * p_dot * t_dot + dot(b_theta, turning),
        P.ml * P.gravity[2] * ct * sp - P.ml2 * cp * sp * t_dot * t_dot + dot(b_phi, turning),
        turning[2],
    )
    return Terms(M_vv, M_vw, M_ww, f_v, add(f_w, scale(wheel_momentum_rate, P.k)))


@traced
def terms(selected, P, a, v, w):
    """Return the `Terms` of the selected formulation."""
    if isinstance(selected, Thesis):
        return terms_thesis(P, a, v, w)
    return terms_pivoting(P, a, v, w) if isinstance(selected, Pivoting) else terms_exact(P, a, v, w)


def _relative_rate(selected, P, a, v, w):
    """Return the 3-vector whose product with A is the wheel speeds: z - w, or R^T (Omega - k Phi_dot)."""
    if isinstance(selected, Thesis):
        return rotate_back(a.R, subtract(ball_rate(P.inv_rb, v), scale(w, P.k)))
    return subtract(_rotate_back_rate(a.R, ball_rate(P.inv_rb, v), v), w)


@traced
def wheel_force(selected, P, a, T):
    """Return W^T tau as (force on v, force on w), for T = A^T tau in the body's frame."""
    T_world = rotate(a.R, T)
    force = ground_force(P, T_world)
    if isinstance(selected, Thesis):
        return force, scale(T_world, -P.k)
    return (*force, T_world[2]) if isinstance(selected, Pivoting) else force, scale(T, -1.0)


@traced
def rates_of_angles(selected, a, w):
    """Return Phi_dot from the formulation's body rates."""
    return w if isinstance(selected, Thesis) else angle_rates(a, w)


@traced
def rates_from_angles(selected, a, rates):
    """Return the formulation's body rates from Phi_dot."""
    return rates if isinstance(selected, Thesis) else body_rates(a, rates)


@traced
def wheel_speeds(selected, P, a, v, w):
    """Return the formulation's wheel speeds W nu, one for each wheel [rad/s]."""
    relative = _relative_rate(selected, P, a, v, w)
    return tuple(dot(wheel.axle, relative) for wheel in P.wheels)


@traced
def ball_torque(P, torques):
    """Return A^T tau: the wheels' torque on the ball, in the body's frame."""
    return total(scale(wheel.axle, torque) for wheel, torque in zip(P.wheels, torques, strict=True))


# --- from generalised forces to accelerations: M nu_dot = f by blocks, and by the spin where the ball pivots ---

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
    w = solve_symmetric(S, rest)
    f_x, f_y = force_v[0] - dot(X, w), force_v[1] - dot(Y, w)
    return (i_xx * f_x + i_xy * f_y, i_xy * f_x + i_yy * f_y), w


def solve_symmetric(S, right):
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
