"""The classical law, the default: static, Coulomb, viscous and Stribeck friction (thesis 3.3 and 3.8).

    tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sgn(w)

Set-valued at rest: it holds up to exactly c + s. A step is RK4 of known sign; where the speed reaches zero within
it, the moment is found, and from there the inertia rests exactly or leaves the other way. That is the minimiser of
the convex step (docs/mechanics.md) with the step ended where the sign changes, so that order four holds through
stops (for v_s's power delta below four, the start from rest leaves order 1 + delta, because the law itself is no
smoother there).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.friction import dry_friction, sign, stribeck_curve
from ballbot.mechanics.friction_laws.interface import available, check_values, register, slide, time_to_stop


class ClassicalNumbers(NamedTuple):
    """The classical law in compiled code."""

    b: float
    c: float
    s: float
    inv_vs: float
    delta: float


@dataclass(frozen=True, kw_only=True)
class Classical:
    """Static, Coulomb, viscous and Stribeck friction of one driveline.

    Raises
    ------
    InputError
        Where a value is negative or not finite, or the Stribeck speed or exponent is zero.
    """

    viscous: float  #: b [N m s/rad]
    coulomb: float  #: c [N m]
    stribeck: float = 0.0  #: s [N m], break-away above Coulomb
    stribeck_speed: float = 1.0  #: v_s [rad/s]
    stribeck_exponent: float = 2.0  #: delta [-]

    def __post_init__(self) -> None:
        check_values(
            self,
            positive=("stribeck_speed", "stribeck_exponent"),
            not_negative=("viscous", "coulomb", "stribeck"),
        )

    def numbers(self) -> ClassicalNumbers:
        """Return what compiled code reads."""
        return ClassicalNumbers(
            b=self.viscous,
            c=self.coulomb,
            s=self.stribeck,
            inv_vs=1.0 / self.stribeck_speed,
            delta=self.stribeck_exponent,
        )

    def initial_state(self, step: float) -> NDArray[np.float64]:  # noqa: ARG002 (the interface's)
        """Return the empty state."""
        return np.empty(0)

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return tau(w) [N m] at speeds (...), 0 at rest."""
        return stribeck_curve(
            speed,
            viscous=self.viscous,
            coulomb=self.coulomb,
            stribeck=self.stribeck,
            stribeck_speed=self.stribeck_speed,
            stribeck_exponent=self.stribeck_exponent,
        )

    def explicit_slope(self) -> float:
        """Return a bound [N m s/rad] of the slope, but for an infinitely steep start where delta is below 1."""
        return self.viscous + self.stribeck * max(self.stribeck_exponent, 1.0) / self.stribeck_speed


@inlined
def _holds(law, inertia, torque):
    """Return whether the law balances the torque at rest."""
    return abs(available(inertia, torque, 0.0)) <= law.c + law.s


@inlined
def _friction(law, state, speed, applied):
    if speed == 0.0:
        limit = law.c + law.s
        return min(max(applied, -limit), limit)
    return law.b * speed + sign(speed) * dry_friction(law, speed)


@inlined
def _settle(law, state, before, after, h):
    return None


@inlined
def _move(law, inertia, torque, state, speed, h):
    if speed == 0.0 and _holds(law, inertia, torque):
        return 0.0, 0.0
    direction = sign(torque) if speed == 0.0 else sign(speed)
    end, travel = slide(law, inertia, torque, speed, direction, h)
    if direction * end > 0.0 or speed == 0.0:
        return end, travel
    stop = time_to_stop(law, inertia, torque, speed, direction, h)
    _, travel = slide(law, inertia, torque, speed, direction, stop)
    if _holds(law, inertia, torque):
        return 0.0, travel
    end, back = slide(law, inertia, torque, 0.0, sign(torque), h - stop)
    return end, travel + back


register(ClassicalNumbers, friction=_friction, settling=_settle, moving=_move)
