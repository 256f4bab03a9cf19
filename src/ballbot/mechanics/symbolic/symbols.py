"""The thesis's symbols (Appendix II's list) and the one place that gives them a robot's numbers."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from ballbot.robot import Robot


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
