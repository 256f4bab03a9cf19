"""The thesis's symbols (Appendix II's list), and the corrections that lead from its equations to the exact ones.

Each correction stands beside the equation that it corrects. A robot's numbers are given to the symbols here and
nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from ballbot.errors import InputError
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


_NO_CORRECTIONS = Corrections(
    body_rates=False,
    inertia_about_center_of_mass=False,
    locked_wheels_once=False,
    reflected_rotors=False,
    counter_torque=False,
    nonholonomic_wheels=False,
)
_ALL_CORRECTIONS = Corrections(
    body_rates=True,
    inertia_about_center_of_mass=True,
    locked_wheels_once=True,
    reflected_rotors=True,
    counter_torque=True,
    nonholonomic_wheels=True,
)


def corrections_of(formulation: Formulation) -> Corrections:
    """Return what the named formulation corrects: everything ("exact") or nothing ("thesis").

    Raises
    ------
    InputError
        If the name is neither of the two.
    """
    named: dict[str, Corrections] = {"exact": _ALL_CORRECTIONS, "thesis": _NO_CORRECTIONS}
    if formulation not in named:
        raise InputError(
            f"There is no formulation {formulation!r}; the formulations are 'exact' and 'thesis'"
        )
    return named[formulation]


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """The six entries of a symmetric inertia matrix."""

    xx: sp.Symbol
    xy: sp.Symbol
    xz: sp.Symbol
    yy: sp.Symbol
    yz: sp.Symbol
    zz: sp.Symbol

    def matrix(self) -> sp.Matrix:
        """Return the matrix (3, 3)."""
        rows = [[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]]
        return sp.Matrix(rows)


@dataclass(frozen=True, kw_only=True)
class Symbols:
    """Generalised coordinates, input and parameters of a robot with n wheels, as SymPy symbols."""

    q: tuple[sp.Symbol, ...]  #: (II.1) x y theta phi psi
    q_dot: tuple[sp.Symbol, ...]  #: their rates
    u: tuple[sp.Symbol, ...]  #: torque of each wheel
    r_b: sp.Symbol
    m_b: sp.Symbol
    j_b: sp.Symbol
    l: sp.Symbol  # noqa: E741 (the thesis's letter for the height of the body's centre of mass)
    m_r: sp.Symbol
    J_given: Inertia  #: (II.22) the body's, as the robot file gives it
    J_com: Inertia  #: the body's, about its centre of mass
    r_w: sp.Symbol
    j_w: sp.Symbol
    alpha: sp.Symbol
    beta: tuple[sp.Symbol, ...]
    n: sp.Symbol  #: gear ratio
    j_m: sp.Symbol
    j_g: sp.Symbol
    g: sp.Symbol
    b: tuple[sp.Symbol, ...]  #: viscous friction of each wheel


def symbols(wheel_count: int) -> Symbols:
    """Return the symbols for a robot with that many wheels."""
    return Symbols(
        q=tuple(_real(name) for name in ("x", "y", "theta", "phi", "psi")),
        q_dot=tuple(_real(f"{name}_dot") for name in ("x", "y", "theta", "phi", "psi")),
        u=_numbered("u", wheel_count),
        r_b=_positive("r_b"),
        m_b=_positive("m_b"),
        j_b=_positive("j_b"),
        l=_positive("l"),
        m_r=_positive("m_r"),
        J_given=_inertia("j_r"),
        J_com=_inertia("j_c"),
        r_w=_positive("r_w"),
        j_w=_positive("j_w"),
        alpha=_positive("alpha"),
        beta=_numbered("beta", wheel_count),
        n=_positive("n"),
        j_m=_positive("j_m"),
        j_g=_positive("j_g"),
        g=_positive("g"),
        b=_numbered("b", wheel_count),
    )


def parameter_numbers(s: Symbols, robot: Robot) -> dict[sp.Symbol, float]:
    """Return the robot's number for every parameter's symbol, SI units and radians."""
    scalars = {
        s.r_b: robot.ball.radius,
        s.m_b: robot.ball.mass,
        s.j_b: robot.ball.inertia,
        s.l: robot.body.center_of_mass,
        s.m_r: robot.body.mass,
        s.r_w: robot.wheels.radius,
        s.j_w: robot.wheels.inertia,
        s.alpha: robot.wheels.tilt,
        s.n: robot.drive.gear_ratio,
        s.j_m: robot.drive.motor_inertia,
        s.j_g: robot.drive.gear_inertia,
        s.g: robot.gravity,
    }
    azimuths = dict(zip(s.beta, robot.wheels.azimuths, strict=True))
    viscous = dict(zip(s.b, robot.friction.viscous, strict=True))
    given = _inertia_numbers(s.J_given, robot.body.inertia_matrix().tolist())
    com = _inertia_numbers(s.J_com, robot.body.inertia_about_center_of_mass().tolist())
    return scalars | azimuths | viscous | given | com


def parameter_symbols(s: Symbols) -> list[sp.Symbol]:
    """Return every parameter's symbol, in a fixed order."""
    scalars = [s.r_b, s.m_b, s.j_b, s.l, s.m_r, s.r_w, s.j_w, s.alpha, s.n, s.j_m, s.j_g, s.g]
    return [*scalars, *s.beta, *s.b, *_entries(s.J_given), *_entries(s.J_com)]


def _inertia_numbers(J: Inertia, numbers: list[list[float]]) -> dict[sp.Symbol, float]:
    upper = [numbers[i][j] for i in range(3) for j in range(i, 3)]
    return dict(zip(_entries(J), upper, strict=True))


def _entries(J: Inertia) -> tuple[sp.Symbol, ...]:
    return J.xx, J.xy, J.xz, J.yy, J.yz, J.zz


def _inertia(name: str) -> Inertia:
    return Inertia(
        xx=_real(name + "xx"),
        xy=_real(name + "xy"),
        xz=_real(name + "xz"),
        yy=_real(name + "yy"),
        yz=_real(name + "yz"),
        zz=_real(name + "zz"),
    )


def _numbered(name: str, count: int) -> tuple[sp.Symbol, ...]:
    return tuple(_real(f"{name}_{i + 1}") for i in range(count))


def _real(name: str) -> sp.Symbol:
    return sp.Symbol(name, real=True)


def _positive(name: str) -> sp.Symbol:
    return sp.Symbol(name, positive=True)
