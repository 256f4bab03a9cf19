"""The classical law, the default: static, Coulomb, viscous and Stribeck friction (thesis 3.3 and 3.8).

    tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sgn(w)

Terms by direction and by load may be added, as a robot's friction has them (`ballbot.mechanics.friction`). Set-valued
at rest: it holds up to exactly c + s. A step is RK4 of known sign; where the speed reaches zero within
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

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.friction import (
    NO_TERMS,
    WheelTerms,
    asymmetry,
    directed_friction,
    dry_friction,
    friction_shift,
    loaded_coulomb,
    sign,
    stribeck_curve,
    stribeck_decay,
)
from ballbot.mechanics.friction_laws.interface import available, check_values, register, slide, time_to_stop


class ClassicalNumbers(NamedTuple):
    """The classical law in compiled code."""

    b: float
    c: float
    s: float
    inv_vs: float
    delta: float


class DirectedNumbers(NamedTuple):
    """The classical law with the terms by direction and by load, in compiled code."""

    b: float
    c: float
    s: float
    inv_vs: float
    delta: float
    terms: WheelTerms


@dataclass(frozen=True, kw_only=True)
class Classical:
    """Static, Coulomb, viscous and Stribeck friction of one driveline.

    Raises
    ------
    InputError
        If a value is negative or not finite, the Stribeck speed or exponent is zero, or an asymmetry is larger than
        what it is the asymmetry of.
    """

    viscous: float  #: b [N m s/rad]
    coulomb: float  #: c [N m]
    stribeck: float = 0.0  #: s [N m], break-away above Coulomb
    stribeck_speed: float = 1.0  #: v_s [rad/s]
    stribeck_exponent: float = 2.0  #: delta [-]
    terms: WheelTerms = NO_TERMS  #: by direction of turning and by the driving torque

    def __post_init__(self) -> None:
        check_values(
            self,
            positive=("stribeck_speed", "stribeck_exponent"),
            not_negative=("viscous", "coulomb", "stribeck"),
        )
        check_values(self.terms, positive=(), not_negative=("load",))
        d, e = self.terms.coulomb_asymmetry, self.terms.stribeck_asymmetry
        if not (abs(d) <= self.coulomb and abs(e) <= self.stribeck):
            raise InputError(
                f"Classical's asymmetries are {d:g} and {e:g}; they must be at most {self.coulomb:g} (coulomb) and "
                f"{self.stribeck:g} (stribeck) in magnitude."
            )

    @property
    def is_plain(self) -> bool:
        """Whether the dry friction is the same in both directions, whatever the torque."""
        return not any(self.terms)

    def numbers(self) -> ClassicalNumbers | DirectedNumbers:
        """Return the law's numbers for compiled code."""
        b, c, s, delta = self.viscous, self.coulomb, self.stribeck, self.stribeck_exponent
        plain = ClassicalNumbers(b=b, c=c, s=s, inv_vs=1.0 / self.stribeck_speed, delta=delta)
        return plain if self.is_plain else DirectedNumbers(*plain, self.terms)

    def initial_state(self, step: float) -> NDArray[np.float64]:  # noqa: ARG002 (the interface's)
        """Return the empty state."""
        return np.empty(0)

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return tau(w) [N m] at speeds (...) without load, 0 at rest."""
        w = np.asarray(speed, dtype=float)
        curve = stribeck_curve(
            w,
            viscous=self.viscous,
            coulomb=self.coulomb,
            stribeck=self.stribeck,
            stribeck_speed=self.stribeck_speed,
            stribeck_exponent=self.stribeck_exponent,
        )
        if self.is_plain:
            return curve
        E = stribeck_decay(w / self.stribeck_speed, self.stribeck_exponent)
        return curve + np.abs(np.sign(w)) * asymmetry(self.terms, E)

    def explicit_slope(self) -> float:
        """Return a bound [N m s/rad] of the slope, but for an infinitely steep start if delta is below 1."""
        fading = self.stribeck + abs(self.terms.stribeck_asymmetry)
        return self.viscous + fading * max(self.stribeck_exponent, 1.0) / self.stribeck_speed


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
def _moved(law, inertia, torque, speed, h, holds):
    if speed == 0.0 and holds:
        return 0.0, 0.0
    direction = sign(torque) if speed == 0.0 else sign(speed)
    end, travel = slide(law, inertia, torque, speed, direction, h)
    if direction * end > 0.0 or speed == 0.0:
        return end, travel
    stop = time_to_stop(law, inertia, torque, speed, direction, h)
    _, travel = slide(law, inertia, torque, speed, direction, stop)
    if holds:
        return 0.0, travel
    end, back = slide(law, inertia, torque, 0.0, sign(torque), h - stop)
    return end, travel + back


@inlined
def _move(law, inertia, torque, state, speed, h):
    return _moved(law, inertia, torque, speed, h, _holds(law, inertia, torque))


@inlined
def _under_load(law, torque):
    c = loaded_coulomb(law.c, law.terms, torque)
    return DirectedNumbers(law.b, c, law.s, law.inv_vs, law.delta, law.terms)


@inlined
def _friction_by_direction(law, state, speed, applied):
    loaded = _under_load(law, applied)
    if speed == 0.0:
        size, shift = loaded.c + loaded.s, friction_shift(loaded, 0.0)
        return min(max(applied, shift - size), shift + size)
    direction = sign(speed)
    return law.b * speed + direction * directed_friction(loaded, speed, direction)


@inlined
def _move_by_direction(law, inertia, torque, state, speed, h):
    loaded = _under_load(law, torque)
    size, shift = loaded.c + loaded.s, friction_shift(loaded, 0.0)
    holds = abs(available(inertia, torque, 0.0) - shift) <= size
    return _moved(loaded, inertia, torque, speed, h, holds)


register(ClassicalNumbers, friction=_friction, settling=_settle, moving=_move)
register(DirectedNumbers, friction=_friction_by_direction, settling=_settle, moving=_move_by_direction)
