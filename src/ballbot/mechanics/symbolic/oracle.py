"""The derived equations of one robot, evaluated in numbers: what compiled code is tested against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import mpmath
import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.parameters import Formulation
from ballbot.mechanics.symbolic.corrections import Corrections, corrections_of
from ballbot.mechanics.symbolic.derivation import Derivation, derive
from ballbot.mechanics.symbolic.symbols import parameter_numbers, parameter_symbols, symbols
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class _Functions:
    """A derivation's expressions as functions of (q, q_dot, u, parameters)."""

    dynamics: Callable  #: -> M, bias, Q
    energies: Callable  #: -> T, V
    wheel_speed: Callable


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """A robot's equations of motion M(q) q_ddot + bias(q, q_dot) = Q(q, q_dot, u), one state at a time.

    q = (x, y, theta, phi, psi) [m, rad], q_dot its rates, u (n,) the wheel torques [N m]. Smooth part only:
    rigid bodies and viscous friction b, without the set-valued friction. No q_ddot at phi = +-pi/2.
    """

    robot: Robot
    corrections: Corrections

    def mass_matrix(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return M (5, 5)."""
        return self._dynamics(q, np.zeros(5), np.zeros(self.robot.wheel_count))[0]

    def bias(self, q: ArrayLike, q_dot: ArrayLike) -> NDArray[np.float64]:
        """Return the Coriolis, centrifugal and gravity terms (5,) on the left of Lagrange's equation."""
        return self._dynamics(q, q_dot, np.zeros(self.robot.wheel_count))[1]

    def generalized_force(self, q: ArrayLike, q_dot: ArrayLike, u: ArrayLike) -> NDArray[np.float64]:
        """Return Q (5,) [N, N m] of the torques less viscous friction."""
        return self._dynamics(q, q_dot, u)[2]

    def acceleration(self, q: ArrayLike, q_dot: ArrayLike, u: ArrayLike) -> NDArray[np.float64]:
        """Return q_ddot (5,) in float64."""
        M, bias, Q = self._dynamics(q, q_dot, u)
        return np.asarray(np.linalg.solve(M, Q - bias), dtype=np.float64)

    def precise_acceleration(
        self, q: ArrayLike, q_dot: ArrayLike, u: ArrayLike, *, digits: int = 40
    ) -> NDArray[np.float64]:
        """Return q_ddot (5,), computed with that many decimal digits and rounded once, at the end."""
        dynamics = _precise_dynamics(self.robot.wheel_count, self.corrections)
        with mpmath.workdps(digits):
            numbers = [[mpmath.mpf(float(v)) for v in np.asarray(a, float)] for a in (q, q_dot, u)]
            M, bias, Q = dynamics(*numbers, [mpmath.mpf(v) for v in _numbers(self.robot)])
            return np.array([float(v) for v in mpmath.lu_solve(M, Q - bias)])

    def wheel_speed(self, q: ArrayLike, q_dot: ArrayLike) -> NDArray[np.float64]:
        """Return the speed (n,) [rad/s] that torque and friction act on.

        "exact": what an encoder sees, relative to the body; "thesis": (II.16), absolute.
        """
        speed = self._functions.wheel_speed(*self._arguments(q, q_dot))
        return np.asarray(speed, dtype=float).ravel()

    def kinetic_energy(self, q: ArrayLike, q_dot: ArrayLike) -> float:
        """Return T [J]."""
        return float(self._functions.energies(*self._arguments(q, q_dot))[0])

    def potential_energy(self, q: ArrayLike) -> float:
        """Return V [J], zero with the body's centre of mass as high as the ball's centre."""
        return float(self._functions.energies(*self._arguments(q, np.zeros(5)))[1])

    def energy(self, q: ArrayLike, q_dot: ArrayLike) -> float:
        """Return T + V [J]."""
        return self.kinetic_energy(q, q_dot) + self.potential_energy(q)

    @property
    def _functions(self) -> _Functions:
        return _functions(self.robot.wheel_count, self.corrections)

    def _arguments(self, q: ArrayLike, q_dot: ArrayLike) -> tuple[ArrayLike, ArrayLike, NDArray, list[float]]:
        return q, q_dot, np.zeros(self.robot.wheel_count), _numbers(self.robot)

    def _dynamics(
        self, q: ArrayLike, q_dot: ArrayLike, u: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        M, bias, Q = self._functions.dynamics(q, q_dot, u, _numbers(self.robot))
        return np.asarray(M, dtype=float), np.asarray(bias, float).ravel(), np.asarray(Q, float).ravel()


def equations(robot: Robot, formulation: Formulation | Corrections = "exact") -> Equations:
    """Return the robot's equations of motion as derived by SymPy.

    The first use for a number of wheels and a formulation derives them (some two seconds) and is remembered,
    whatever the robot's parameters.

    Parameters
    ----------
    robot
        With three or four wheels, at any azimuth and tilt.
    formulation
        "exact", "thesis", or any mixture of the corrections between the two.
    """
    corrections = formulation if isinstance(formulation, Corrections) else corrections_of(formulation)
    return Equations(robot=robot, corrections=corrections)


@lru_cache(maxsize=32)
def _derivation(wheel_count: int, corrections: Corrections) -> Derivation:
    return derive(wheel_count, corrections)


@lru_cache(maxsize=32)
def _functions(wheel_count: int, corrections: Corrections) -> _Functions:
    d = _derivation(wheel_count, corrections)
    arguments = _lambda_arguments(d)
    return _Functions(
        dynamics=sp.lambdify(arguments, (d.mass_matrix, d.bias, d.generalized_force), "numpy", cse=True),
        energies=sp.lambdify(arguments, (d.kinetic_energy, d.potential_energy), "numpy", cse=True),
        wheel_speed=sp.lambdify(arguments, d.wheel_speed, "numpy", cse=True),
    )


@lru_cache(maxsize=4)
def _precise_dynamics(wheel_count: int, corrections: Corrections) -> Callable:
    d = _derivation(wheel_count, corrections)
    outputs = (d.mass_matrix, d.bias, d.generalized_force)
    return sp.lambdify(_lambda_arguments(d), outputs, "mpmath", cse=True)


def _lambda_arguments(d: Derivation) -> list[list[sp.Symbol]]:
    s = d.symbols
    return [list(s.q), list(s.q_dot), list(s.u), parameter_symbols(s)]


def _numbers(robot: Robot) -> list[float]:
    s = symbols(robot.wheel_count)
    numbers = parameter_numbers(s, robot)
    return [numbers[symbol] for symbol in parameter_symbols(s)]
