"""The thesis's symbols (Appendix II's list), and the corrections that lead from its equations to the exact ones.

Each correction stands beside the equation that it corrects. A robot's numbers are given to the symbols here and
nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType

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


def corrections_of(formulation: Formulation) -> Corrections:
    """Return what the named formulation corrects: everything ("exact") or nothing ("thesis").

    Raises
    ------
    InputError
        If the name is neither of the two.
    """
    named: dict[str, bool] = {"exact": True, "thesis": False}
    if formulation not in named:
        raise InputError(
            f"There is no formulation {formulation!r}; the formulations are 'exact' and 'thesis'"
        )
    return Corrections(**dict.fromkeys([one.name for one in fields(Corrections)], named[formulation]))


#: the parameters that are one number, SI units and radians
_SCALARS: Mapping[str, Callable[[Robot], float]] = MappingProxyType(
    {
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
)
#: rows and columns of a symmetric matrix's upper half
_UPPER = tuple((i, j) for i in range(3) for j in range(i, 3))


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
    J_given: sp.Matrix  #: (II.22) the body's, as the robot file gives it
    J_com: sp.Matrix  #: the body's, about its centre of mass
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
    coordinates = ("x", "y", "theta", "phi", "psi")
    return Symbols(
        q=tuple(map(_real, coordinates)),
        q_dot=tuple(_real(f"{name}_dot") for name in coordinates),
        u=_numbered("u", wheel_count),
        J_given=_inertia("j_r"),
        J_com=_inertia("j_c"),
        beta=_numbered("beta", wheel_count),
        b=_numbered("b", wheel_count),
        **{name: sp.Symbol(name, positive=True) for name in _SCALARS},
    )


def parameter_symbols(s: Symbols) -> list[sp.Symbol]:
    """Return every parameter's symbol, in the order of `parameter_numbers`."""
    inertias = [J[place] for J in (s.J_given, s.J_com) for place in _UPPER]
    return [*(getattr(s, name) for name in _SCALARS), *s.beta, *s.b, *inertias]


def parameter_numbers(robot: Robot) -> list[float]:
    """Return the robot's number for every parameter's symbol, SI units and radians."""
    body = robot.body
    inertias = [
        float(J[place])
        for J in (body.inertia_matrix(), body.inertia_about_center_of_mass())
        for place in _UPPER
    ]
    scalars = (number_of(robot) for number_of in _SCALARS.values())
    return [*scalars, *robot.wheels.azimuths, *robot.friction.viscous, *inertias]


def _inertia(name: str) -> sp.Matrix:
    return sp.Matrix(3, 3, lambda i, j: _real(name + "".join("xyz"[k] for k in sorted((int(i), int(j))))))


def _numbered(name: str, count: int) -> tuple[sp.Symbol, ...]:
    return tuple(_real(f"{name}_{i + 1}") for i in range(count))


def _real(name: str) -> sp.Symbol:
    return sp.Symbol(name, real=True)
