"""The classical law of one driveline: static, Coulomb, viscous and Stribeck friction (thesis 3.3 and 3.8).

    tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sgn(w)

Terms by direction and by load may be added, as a robot's friction has them (`ballbot.mechanics.friction`). Set-valued
at rest: it holds up to exactly c + s.

`move` turns an inertia, J w_dot = T(u, w) - tau, where the drive's speed limit is a torque-speed curve, |T| up to
T_stall (1 -+ w/w_0); without a limit it is far away. A step is RK4 of known sign; where the speed reaches zero within
it, which under a held torque it does at most once, the moment is found to rounding, and from there the inertia rests
exactly or leaves the other way. That is the minimiser of the convex step (docs/mechanics.md) with the step ended where
the sign changes, so that order four holds through stops (for v_s's power delta below four, the start from rest leaves
order 1 + delta, because the law itself is no smoother there).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.friction import (
    NO_TERMS,
    WheelTerms,
    breakaway,
    directed_friction,
    friction_shift,
    sign,
    stribeck_decay,
    under_load,
)


class ClassicalNumbers(NamedTuple):
    """The classical law in compiled code."""

    b: float
    c: float
    s: float
    inv_vs: float
    delta: float
    terms: WheelTerms


@dataclass(frozen=True, kw_only=True)
class Classical:
    """Static, Coulomb, viscous and Stribeck friction of one driveline, within what a robot's can be."""

    viscous: float  #: b [N m s/rad]
    coulomb: float  #: c [N m]
    stribeck: float = 0.0  #: s [N m], break-away above Coulomb
    stribeck_speed: float = 1.0  #: v_s [rad/s]
    stribeck_exponent: float = 2.0  #: delta [-]
    terms: WheelTerms = NO_TERMS  #: by direction of turning and by the driving torque

    def numbers(self) -> ClassicalNumbers:
        """Return the law's numbers for compiled code."""
        shape = 1.0 / self.stribeck_speed, self.stribeck_exponent
        return ClassicalNumbers(self.viscous, self.coulomb, self.stribeck, *shape, self.terms)

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return tau(w) [N m] at speeds (...) without load, 0 at rest."""
        w = np.asarray(speed, dtype=float)
        E = stribeck_decay(w / self.stribeck_speed, self.stribeck_exponent)
        shift = self.terms.coulomb_asymmetry + self.terms.stribeck_asymmetry * E
        return self.viscous * w + (self.coulomb + self.stribeck * E) * np.sign(w) + shift * np.abs(np.sign(w))

    def explicit_slope(self) -> float:
        """Return a bound [N m s/rad] of the slope, but for an infinitely steep start if delta is below 1."""
        fading = self.stribeck + abs(self.terms.stribeck_asymmetry)
        return self.viscous + fading * max(self.stribeck_exponent, 1.0) / self.stribeck_speed


# --- compiled ---

#: stands for "no limit"; finite, so that it stays a number when multiplied by zero
UNLIMITED = 1e200


class Inertia(NamedTuple):
    """A driven inertia, in compiled code."""

    inv_J: float  #: 1/J [1/(kg m^2)]
    stall: float  #: torque available at rest [N m]
    inv_no_load: float  #: 1/w_0 [s/rad]


@inlined
def available(inertia, torque, speed):
    """Return the torque [N m] that the supply lets through at that speed."""
    lost = inertia.stall * (speed * inertia.inv_no_load)
    return min(max(torque, -inertia.stall - lost), inertia.stall - lost)


@inlined
def move(law, inertia, torque, speed, h) -> tuple[float, float]:
    """Advance an inertia under a law's numbers by h [s] with the torque held; return its speed and the angle turned."""
    loaded = under_load(law, torque)
    holds = abs(available(inertia, torque, 0.0) - friction_shift(loaded, 0.0)) <= breakaway(loaded)
    if speed == 0.0 and holds:
        return 0.0, 0.0
    direction = sign(torque) if speed == 0.0 else sign(speed)
    end, travel = _slide(loaded, inertia, torque, speed, direction, h)
    if direction * end > 0.0 or speed == 0.0:
        return end, travel
    stop = _time_to_stop(loaded, inertia, torque, speed, direction, h)
    _, travel = _slide(loaded, inertia, torque, speed, direction, stop)
    if holds:
        return 0.0, travel
    end, back = _slide(loaded, inertia, torque, 0.0, sign(torque), h - stop)
    return end, travel + back


@inlined
def _acceleration(law, inertia, torque, speed, direction):
    friction = law.b * speed + direction * directed_friction(law, speed, direction)
    return inertia.inv_J * (available(inertia, torque, speed) - friction)


@inlined
def _slide(law, inertia, torque, speed, direction, h) -> tuple[float, float]:
    """Return speed and angle travelled after h [s] of sliding with friction against `direction` (1 or -1), by RK4."""
    half = 0.5 * h
    a1 = _acceleration(law, inertia, torque, speed, direction)
    w2 = speed + half * a1
    a2 = _acceleration(law, inertia, torque, w2, direction)
    w3 = speed + half * a2
    a3 = _acceleration(law, inertia, torque, w3, direction)
    w4 = speed + h * a3
    a4 = _acceleration(law, inertia, torque, w4, direction)
    travel = h / 6.0 * (speed + 2.0 * (w2 + w3) + w4)
    return speed + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4), travel


_MOST_TRIALS = 60
_EPS = 2.220446049250313e-16


@inlined
def _time_to_stop(law, inertia, torque, speed, direction, h):
    """Return when, within h [s], the speed in `direction` has fallen to zero, which it does by then.

    Newton's method, or half of the bracket where it would leave that.
    """
    low, high, time = 0.0, h, 0.5 * h
    for _ in range(_MOST_TRIALS):
        end, _ = _slide(law, inertia, torque, speed, direction, time)
        if direction * end > 0.0:
            low = time
        else:
            high = time
        after = time - end / _acceleration(law, inertia, torque, end, direction)
        if not low <= after <= high:
            after = 0.5 * (low + high)
        settled = abs(after - time) <= _EPS * high
        time = after
        if settled:
            break
    return time
