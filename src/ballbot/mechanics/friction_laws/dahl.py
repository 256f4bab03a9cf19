"""Dahl's law: friction is a function of travel, with hysteresis and without rate.

    dF/dx = sigma (1 - (F/c) sgn(w))^i          tau = F + b w

P. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968. The state is z = F / sigma. Between
two reversals the travel gives the force in closed form: with y = 1 - (F/c) sgn(w), y = y_0 e^(-kappa) for i = 1 and
otherwise y^(1-i) = y_0^(1-i) + (i - 1) kappa, with kappa = sigma |x| / c. Dahl has no b; it is there because a
driveline has. There is no static friction above c, so nothing sticks and slips.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.elementary import exponential, logarithm
from ballbot.mechanics.friction import sign
from ballbot.mechanics.friction_laws.interface import (
    Bristles,
    available,
    check_values,
    linear_motion,
    register,
)

_LEAST = 1e-9  # y that counts as arrived at c in a step of a moving inertia


class DahlNumbers(NamedTuple):
    """Dahl's law in compiled code."""

    b: float
    c: float
    sigma: float
    shape: float


@dataclass(frozen=True, kw_only=True)
class Dahl:
    """Friction that grows with travel towards Coulomb's. Its state is F / sigma [rad].

    Raises
    ------
    InputError
        If a value is negative or not finite, or Coulomb friction, stiffness or shape is zero.
    """

    coulomb: float  #: c [N m]
    stiffness: float  #: sigma [N m/rad], dF/dx at F = 0
    shape: float = 1.0  #: i [-]: below 1 for brittle materials, 1 or more for ductile ones
    viscous: float = 0.0  #: b [N m s/rad]

    def __post_init__(self) -> None:
        check_values(self, positive=("coulomb", "stiffness", "shape"), not_negative=("viscous",))

    def numbers(self) -> DahlNumbers:
        """Return the law's numbers for compiled code."""
        return DahlNumbers(b=self.viscous, c=self.coulomb, sigma=self.stiffness, shape=self.shape)

    def initial_state(self, step: float) -> NDArray[np.float64]:  # noqa: ARG002 (the interface's)
        """Return the state without force, (1,)."""
        return np.zeros(1)

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return c sgn(w) + b w [N m] at speeds (...), 0 at rest."""
        w = np.asarray(speed, dtype=float)
        return self.coulomb * np.sign(w) + self.viscous * w

    def explicit_slope(self) -> float:
        """Return 0: the step is exponential."""
        return 0.0


@inlined
def _remaining(law, z, direction):
    """Return y = 1 - (F/c) sgn(w), kept from rounding below zero."""
    return max(1.0 - direction * law.sigma * z / law.c, 0.0)


@inlined
def _after_travel(law, y, distance):
    """Return y after turning further by `distance` [rad] in the same direction."""
    kappa = law.sigma * distance / law.c
    more = law.shape - 1.0
    if abs(more) < 1e-12:
        return y * exponential(-kappa)
    # y (1 + (i - 1) kappa y^(i-1))^(-1/(i-1)); below i = 1 the force arrives at c after a finite travel
    if y == 0.0:
        return 0.0
    growth = 1.0 + more * kappa * exponential(more * logarithm(y))
    return y * exponential(-logarithm(growth) / more) if growth > 0.0 else 0.0


@inlined
def _motion(law, inertia, torque, z, w, at_z, at_w, h) -> tuple[float, float, float]:
    """Move from (z, w) with everything frozen at (at_z, at_w): z_dot = y^(i-1) (w - (sigma |w|/c) z)."""
    y = max(_remaining(law, at_z, sign(at_w)), _LEAST)
    rho = exponential((law.shape - 1.0) * logarithm(y))
    T, r = available(inertia, torque, at_w), law.sigma * abs(at_w) / law.c
    return linear_motion(Bristles(law.sigma, 0.0, law.b, r, rho), T, inertia.inv_J, z, w, h)


@inlined
def _friction(law, state, speed, applied):
    return law.sigma * state[0] + law.b * speed


@inlined
def _settle(law, state, before, after, h):
    speed = 0.5 * (before + after)
    direction = sign(speed)
    if direction != 0.0:
        y = _after_travel(law, _remaining(law, state[0], direction), abs(speed) * h)
        state[0] = direction * law.c / law.sigma * (1.0 - y)


@inlined
def _move(law, inertia, torque, state, speed, h):
    z = state[0]
    z_middle, w_middle, _ = _motion(law, inertia, torque, z, speed, z, speed, 0.5 * h)
    state[0], end, travel = _motion(law, inertia, torque, z, speed, z_middle, w_middle, h)
    return end, travel


register(DahlNumbers, friction=_friction, settling=_settle, moving=_move)
