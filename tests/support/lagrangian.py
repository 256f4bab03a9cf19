"""The equations of motion, derived by SymPy along the thesis's Appendix II, equation by equation.

Each function is one of the appendix's steps and cites its equations. If a correction of `Corrections` is on, the
step is physically exact instead; its docstring states the change. The derivation is deliberately slow and plain: the
compiled equations are tested against it. `equations` evaluates it in numbers for one robot, whose numbers are given to
the symbols here and nowhere else.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from ballbot.arrays import Floats
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True)
class Corrections:
    """What of Appendix II's physics is corrected; its misprints (II.6), (II.15), (II.30) always are.

    Any mixture can be derived, so that the share of each approximation in a pole or a gain can be computed.
    """

    body_rates: bool
    """(II.24) takes the Euler angles' rates Phi_dot for the body's angular velocity: in the body's frame for
    (II.25), in the world's for (II.16) and (II.33). Corrected: B(Phi) Phi_dot, in the frame that each of them
    wants."""

    inertia_about_center_of_mass: bool
    """(II.22) puts the inertia that the pendulum measured about the ball's centre beside v_body of (II.23),
    which already moves the mass: m_r l^2 counts twice. Corrected: the inertia about the centre of mass."""

    locked_wheels_once: bool
    """(II.27) adds the wheels' whole spin energy, though the body's inertia holds the locked wheels already.
    Corrected: the share of the spin that the locked wheels have, a_i . w, is subtracted."""

    reflected_rotors: bool
    """(II.28) leaves out rotor and gear. Corrected: n^2 (j_m + j_g) on the wheel's speed relative to the
    body; the rotor's cross term with the body's rate, n j_m, is neglected (0.025 to 0.165 % of the
    accelerations that torques give the upright BBR)."""

    counter_torque: bool
    """(II.32) has the force at the wheels' hubs act on the body and not the motors' counter-torque: (r_b +
    r_w)/r_b times too much, and torque times (II.16) is not the motors' power. Corrected: the counter-torque
    u_i a_i is added, and the wheel speed that friction and an encoder see is the one relative to the body."""

    nonholonomic_wheels: bool
    """(II.34) is Lagrange's equation for energies in which the wheels' speeds (II.16) are already put in. These
    are no derivatives of functions of q, for which that would be allowed. Corrected: the difference, which does
    no work (Chaplygin's or Voronets's terms), is subtracted."""


def corrections_of(formulation: Formulation) -> Corrections:
    """Return what the named formulation corrects: everything ("exact") or nothing ("thesis")."""
    return Corrections(**dict.fromkeys([one.name for one in fields(Corrections)], formulation == "exact"))


#: the parameters that are one number, SI units and radians
_SCALARS: dict[str, Callable[[Robot], float]] = {
    "r_b": lambda robot: robot.ball.radius,
    "m_b": lambda robot: robot.ball.mass,
    "j_b": lambda robot: robot.ball.inertia,
    "l": lambda robot: robot.body.center_of_mass,
    "m_r": lambda robot: robot.body.mass,
    "r_w": lambda robot: robot.wheels.radius,
    "j_w": lambda robot: robot.wheels.inertia,
    "alpha": lambda robot: robot.wheels.tilt,
    "n": lambda robot: robot.drive.gear_ratio,
    "j_m": lambda robot: robot.drive.motor_inertia,
    "j_g": lambda robot: robot.drive.gear_inertia,
    "g": lambda robot: robot.gravity,
}
#: rows and columns of a symmetric matrix's upper half
_UPPER = tuple((i, j) for i in range(3) for j in range(i, 3))


def symbols(wheel_count: int) -> SimpleNamespace:
    """Return coordinates, inputs and parameters of a robot with so many wheels, `_SCALARS` among them."""
    coordinates = ("x", "y", "theta", "phi", "psi")

    def real(name: str) -> sp.Symbol:
        return sp.Symbol(name, real=True)

    def of_wheels(name: str) -> tuple[sp.Symbol, ...]:
        return tuple(real(f"{name}_{i + 1}") for i in range(wheel_count))

    def inertia(name: str) -> sp.Matrix:
        return sp.Matrix(3, 3, lambda i, j: real(name + "".join("xyz"[k] for k in sorted((int(i), int(j))))))

    return SimpleNamespace(
        q=tuple(map(real, coordinates)),  # (II.1)
        q_dot=tuple(real(f"{name}_dot") for name in coordinates),
        u=of_wheels("u"),  # torques
        J_given=inertia("j_r"),  # (II.22) the body's, as the robot file gives it
        J_com=inertia("j_c"),  # the body's, about its centre of mass
        beta=of_wheels("beta"),
        b=of_wheels("b"),  # viscous friction
        **{name: sp.Symbol(name, positive=True) for name in _SCALARS},
    )


def parameter_symbols(s: SimpleNamespace) -> list[sp.Symbol]:
    """Return every parameter's symbol, in the order of `parameter_numbers`."""
    inertias = [J[place] for J in (s.J_given, s.J_com) for place in _UPPER]
    return [*(getattr(s, name) for name in _SCALARS), *s.beta, *s.b, *inertias]


def parameter_numbers(robot: Robot) -> list[float]:
    """Return the robot's number for every parameter's symbol, SI units and radians."""
    given, com = robot.body.inertia_matrix(), robot.body.inertia_about_center_of_mass()
    inertias = [float(J[place]) for J in (given, com) for place in _UPPER]
    scalars = (number_of(robot) for number_of in _SCALARS.values())
    return [*scalars, *robot.wheels.azimuths, *robot.friction.viscous, *inertias]


# --- positions and rotations: (II.1) to (II.9) ----------------------------------------------------


def positions(s: SimpleNamespace, R: sp.Matrix) -> tuple[sp.Matrix, sp.Matrix]:
    """Return (II.2) r_1, the ball, and (II.3) r_2, the body's centre of mass."""
    r_1 = sp.Matrix([s.q[0], s.q[1], 0])
    return r_1, r_1 + R * sp.Matrix([0, 0, s.l])


def rotation_x(angle: sp.Expr) -> sp.Matrix:
    """Return (II.5)."""
    c, s = sp.cos(angle), sp.sin(angle)
    return sp.Matrix([[1, 0, 0], [0, c, -s], [0, s, c]])


def rotation_y(angle: sp.Expr) -> sp.Matrix:
    """Return (II.6), mended: as printed, with -sin twice, it is no rotation."""
    c, s = sp.cos(angle), sp.sin(angle)
    return sp.Matrix([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def rotation_z(angle: sp.Expr) -> sp.Matrix:
    """Return (II.7)."""
    c, s = sp.cos(angle), sp.sin(angle)
    return sp.Matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def body_rotation(s: SimpleNamespace) -> sp.Matrix:
    """Return (II.8), (II.9) R_body, which takes body to world."""
    _, _, theta, phi, psi = s.q
    return rotation_x(theta) * rotation_y(phi) * rotation_z(psi)


# --- transformation matrices: (II.10) to (II.15) --------------------------------------------------


def transforms(s: SimpleNamespace) -> SimpleNamespace:
    """Return (II.10) to (II.15): levers crossed with forces, and the same backwards for speeds.

    Shapes and frames are as in `mechanics.geometry`.
    """
    sin, cos = sp.sin(s.alpha), sp.cos(s.alpha)
    contact = [sp.Matrix([sp.cos(beta) * sin, sp.sin(beta) * sin, cos]) for beta in s.beta]
    push = [sp.Matrix([sp.cos(beta + sp.pi / 2), sp.sin(beta + sp.pi / 2), 0]) for beta in s.beta]
    r_pw = [n * s.r_b for n in contact]
    r_cw = [n * (s.r_b + s.r_w) for n in contact]
    back = [-u for u in push]
    r_pg = [sp.Matrix([0, 0, -s.r_b])] * 2
    u_pg = [sp.Matrix([-1, 0, 0]), sp.Matrix([0, -1, 0])]

    T_tbg = _torque_from_forces(r_pg, u_pg)
    # (II.15) mended: the velocity over ground is not divided by r_w
    T_vgb = _speed_from_rotation(r_pg, u_pg).col_join(sp.zeros(1, 3))
    return SimpleNamespace(
        T_tbw=_torque_from_forces(r_pw, push) / s.r_w,
        T_trw=_torque_from_forces(r_cw, back) / s.r_w,
        T_fgb=T_tbg.pinv(),
        T_owb=_speed_from_rotation(r_pw, push) / s.r_w,
        T_owr=_speed_from_rotation(r_cw, back) / s.r_w,
        T_obg=T_vgb.pinv(),  # (II.19) (3, 3) the ball's turning from its velocity over ground, world
        axles=_torque_from_forces(contact, push),  # (3, n) a_i as columns; the appendix has no name for them
    )


def _torque_from_forces(levers: Sequence[sp.Matrix], directions: Sequence[sp.Matrix]) -> sp.Matrix:
    """Return d(sum_i r_i x u_i F_i)/dF (3, n)."""
    F = sp.symbols(f"F:{len(levers)}")
    torque = sp.zeros(3, 1)
    for r, u, force in zip(levers, directions, F, strict=True):
        torque += r.cross(u * force)
    return torque.jacobian(F)


def _speed_from_rotation(levers: Sequence[sp.Matrix], directions: Sequence[sp.Matrix]) -> sp.Matrix:
    """Return d((Omega x r_i) . u_i)/dOmega (n, 3)."""
    Omega = sp.Matrix(sp.symbols("Omega:3"))
    speeds = [_dot(Omega.cross(r), u) for r, u in zip(levers, directions, strict=True)]
    return sp.Matrix(speeds).jacobian(Omega)


# --- velocities: (II.16), (II.18), (II.19), (II.23), (II.24) --------------------------------------


def velocities(
    s: SimpleNamespace, R: sp.Matrix, T: SimpleNamespace, corrections: Corrections
) -> SimpleNamespace:
    """Return the velocities of ball, body and wheels, linear in q_dot; columns (3, 1), or (n, 1) of wheels."""
    r_1, r_2 = positions(s, R)
    v_g = _time_derivative(s, r_1)
    Omega_ball = T.T_obg * v_g
    Omega_body, turned_back = body_angular_velocity(s, R, corrections)
    wheel_spin = T.T_owr * turned_back + T.T_owb * (R.T * Omega_ball)  # (II.16)
    return SimpleNamespace(
        v_g=v_g,  # of the ball's centre, world frame, as what follows
        Omega_ball=Omega_ball,
        v_body=_time_derivative(s, r_2),  # of the centre of mass
        Omega_body=Omega_body,
        turned_back=turned_back,
        wheel_spin=wheel_spin,  # absolute
        # the wheel counts its spin against a_i (it turns against the ball), so the body's share is added
        encoder_speed=wheel_spin + T.axles.T * turned_back,
    )


def body_angular_velocity(
    s: SimpleNamespace, R: sp.Matrix, corrections: Corrections
) -> tuple[sp.Matrix, sp.Matrix]:
    """Return (II.24) Omega_body and R^-1 Omega_body.

    As printed, Omega_body = Phi_dot. Corrected: each Euler angle turns about an axis that the later rotations
    carry along, so that in the body's frame w = B(Phi) Phi_dot, and Omega_body = R w.
    """
    _, _, theta_dot, phi_dot, psi_dot = s.q_dot
    Phi_dot = sp.Matrix([theta_dot, phi_dot, psi_dot])
    if not corrections.body_rates:
        return Phi_dot, R.T * Phi_dot
    _, _, _, phi, psi = s.q
    to_body = rotation_z(psi).T
    w = to_body * (rotation_y(phi).T * sp.Matrix([theta_dot, 0, 0]) + sp.Matrix([0, phi_dot, 0]))
    w += sp.Matrix([0, 0, psi_dot])
    return R * w, w


def _time_derivative(s: SimpleNamespace, vector: sp.Matrix) -> sp.Matrix:
    return vector.jacobian(s.q) * sp.Matrix(s.q_dot)


def _dot(a: sp.Matrix, b: sp.Matrix) -> sp.Expr:
    return sp.Add(*(sp.Mul(a[i], b[i]) for i in range(len(a))))


# --- energies: (II.17) to (II.28) -----------------------------------------------------------------


def kinetic_energy_ball(s: SimpleNamespace, motion: SimpleNamespace) -> sp.Expr:
    """Return (II.20) T_ball; its inertia (II.17) is the same about every axis."""
    return s.m_b * _dot(motion.v_g, motion.v_g) / 2 + s.j_b * _dot(motion.Omega_ball, motion.Omega_ball) / 2


def kinetic_energy_body(
    s: SimpleNamespace, motion: SimpleNamespace, T: SimpleNamespace, corrections: Corrections
) -> sp.Expr:
    """Return (II.25) T_body, as a quadratic form, so that products of inertia count too.

    As printed, Omega_body meets the inertia (II.22) without a word on frames. Corrected: both in the body's
    frame; the inertia about the centre of mass, as v_body asks; and without the locked wheels' spin, which
    (II.27) brings.
    """
    w = motion.turned_back if corrections.body_rates else motion.Omega_body
    J = s.J_com if corrections.inertia_about_center_of_mass else s.J_given
    energy = s.m_r * _dot(motion.v_body, motion.v_body) / 2 + _dot(w, J * w) / 2
    if corrections.locked_wheels_once:
        locked_spin = T.axles.T * motion.turned_back
        energy -= s.j_w * _dot(locked_spin, locked_spin) / 2
    return energy


def kinetic_energy_wheels(s: SimpleNamespace, motion: SimpleNamespace, corrections: Corrections) -> sp.Expr:
    """Return (II.27) T_wheels; corrected: with rotor and gear, n times as fast relative to the body."""
    energy = s.j_w * _dot(motion.wheel_spin, motion.wheel_spin) / 2
    if corrections.reflected_rotors:
        rotor_speed = motion.encoder_speed * s.n
        energy += (s.j_m + s.j_g) * _dot(rotor_speed, rotor_speed) / 2
    return energy


def potential_energy(s: SimpleNamespace, R: sp.Matrix) -> sp.Expr:
    """Return (II.21) V_ball + (II.26) V_body; zero with the body's centre of mass as high as the ball's."""
    r_1, r_2 = positions(s, R)
    up = sp.Matrix([0, 0, 1])
    return s.m_b * s.g * _dot(r_1, up) + s.m_r * s.g * _dot(r_2, up)


# --- forces and Lagrange's equation: (II.29) to (II.34) -------------------------------------------


def generalized_force(
    s: SimpleNamespace,
    R: sp.Matrix,
    T: SimpleNamespace,
    motion: SimpleNamespace,
    torque: sp.Matrix,
    corrections: Corrections,
) -> sp.Matrix:
    """Return (II.33) Q (5, 1) of torques (n, 1) between motors and wheels.

    (II.30) prints dr_1/dq for Phi_12q; what it must be is how the body's rotation moves with q,
    dOmega_body/dq_dot, which is the derivative of Phi_12 where Omega_body is as (II.24) prints it.
    """
    r_1, _ = positions(s, R)
    r_1q = r_1.extract([0, 1], [0]).jacobian(s.q).T  # (II.29); the ground pushes along x and y
    Phi_12q = motion.Omega_body.jacobian(s.q_dot).T
    F_g = T.T_fgb * R * T.T_tbw * torque  # (II.31)
    on_body = T.T_trw + T.axles if corrections.counter_torque else T.T_trw
    T_b = R * on_body * torque  # (II.32)
    return r_1q * F_g + Phi_12q * T_b


def lagrange(s: SimpleNamespace, L: sp.Expr) -> tuple[sp.Matrix, sp.Matrix]:
    """Return M (5, 5) and bias (5, 1) of (II.34): d/dt(dL/dq_dot) - dL/dq = M q_ddot + bias."""
    momentum = sp.Matrix([sp.diff(L, rate) for rate in s.q_dot])
    force = sp.Matrix([sp.diff(L, coordinate) for coordinate in s.q])
    return momentum.jacobian(s.q_dot), momentum.jacobian(s.q) * sp.Matrix(s.q_dot) - force


def nonholonomic_terms(s: SimpleNamespace, motion: SimpleNamespace, corrections: Corrections) -> sp.Matrix:
    """Return what (II.34) counts too much (5, 1) because the wheels' angles are no functions of q.

    With relative rates W(q) q_dot and the momenta p that belong to them, Lagrange's equation with the rates put
    in holds p . (d/dt (W dq) - delta(W q_dot)), zero only if W dq is the differential of a function. Body and
    ball give none: the one has angles in q, the other is alike in all directions.
    """
    q_dot = sp.Matrix(s.q_dot)
    momenta = s.j_w * motion.wheel_spin
    if corrections.reflected_rotors:
        momenta += s.n**2 * (s.j_m + s.j_g) * motion.encoder_speed
    W = motion.encoder_speed.jacobian(s.q_dot)
    W_dot = sp.zeros(*W.shape)
    for coordinate, rate in zip(s.q, s.q_dot, strict=True):
        W_dot += W.diff(coordinate) * rate
    return (W_dot - (W * q_dot).jacobian(s.q)).T * momenta


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """A robot's equations of motion M(q) q_ddot + bias(q, q_dot) = Q(q, q_dot, u), one state at a time.

    q = (x, y, theta, phi, psi) [m, rad], q_dot its rates, u (n,) the wheel torques [N m]. Smooth part only:
    rigid bodies and viscous friction b, without the set-valued friction. No q_ddot at phi = +-pi/2.
    """

    robot: Robot
    corrections: Corrections

    def dynamics(self, q: ArrayLike, q_dot: ArrayLike, u: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return M (5, 5), the Coriolis, centrifugal and gravity terms (5,) on its side, and Q (5,)."""
        M, bias, Q = self._evaluated(0, q, q_dot, u)
        return np.asarray(M, dtype=float), np.asarray(bias, float).ravel(), np.asarray(Q, float).ravel()

    def acceleration(self, q: ArrayLike, q_dot: ArrayLike, u: ArrayLike) -> Floats:
        """Return q_ddot (5,) in float64."""
        M, bias, Q = self.dynamics(q, q_dot, u)
        return np.linalg.solve(M, Q - bias)

    def energy(self, q: ArrayLike, q_dot: ArrayLike) -> float:
        """Return T + V [J], V zero with the body's centre of mass as high as the ball's centre."""
        return float(self._evaluated(1, q, q_dot, np.zeros(self.robot.wheel_count)))

    def wheel_speed(self, q: ArrayLike, q_dot: ArrayLike) -> Floats:
        """Return the speed (n,) [rad/s] that torque and friction act on.

        "exact": what an encoder sees, relative to the body; "thesis": (II.16), absolute.
        """
        return np.ravel(self._evaluated(2, q, q_dot, np.zeros(self.robot.wheel_count)))

    def _evaluated(self, place: int, q: ArrayLike, q_dot: ArrayLike, u: ArrayLike) -> Any:
        function = _functions(self.robot.wheel_count, self.corrections)[place]
        return function(q, q_dot, u, parameter_numbers(self.robot))


def equations(robot: Robot, formulation: Formulation | Corrections = "exact") -> Equations:
    """Return the equations of a robot of three or four wheels: "exact", "thesis", or any mixture of the corrections."""
    corrections = formulation if isinstance(formulation, Corrections) else corrections_of(formulation)
    return Equations(robot=robot, corrections=corrections)


@lru_cache(maxsize=32)  # some two seconds each, whatever the robot's parameters
def _functions(wheel_count: int, corrections: Corrections) -> tuple[Callable[..., Any], ...]:
    """Derive the equations; return (M, bias, Q), the energy and the wheel speed as functions of q, q_dot, u, numbers.

    The set-valued friction is not in it; viscous friction b is, subtracted from the torque as section 3.4 of the
    thesis does.
    """
    s = symbols(wheel_count)
    R = body_rotation(s)
    T = transforms(s)
    motion = velocities(s, R, T, corrections)
    kinetic = (
        kinetic_energy_ball(s, motion)
        + kinetic_energy_body(s, motion, T, corrections)
        + kinetic_energy_wheels(s, motion, corrections)
    )
    potential = potential_energy(s, R)
    mass_matrix, bias = lagrange(s, kinetic - potential)
    if corrections.nonholonomic_wheels:
        bias -= nonholonomic_terms(s, motion, corrections)
    wheel_speed = motion.encoder_speed if corrections.counter_torque else motion.wheel_spin
    torque = sp.Matrix(s.u) - sp.diag(*s.b) * wheel_speed
    force = generalized_force(s, R, T, motion, torque, corrections)
    arguments = [list(s.q), list(s.q_dot), list(s.u), parameter_symbols(s)]
    wanted = ((mass_matrix, bias, force), kinetic + potential, wheel_speed)
    return tuple(sp.lambdify(arguments, one, "numpy", cse=True) for one in wanted)
