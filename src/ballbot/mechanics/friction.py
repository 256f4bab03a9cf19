"""The friction law of a robot's wheels (thesis 3.3 and 3.8); the formula stands here only.

    tau(w) = b w + (c + mu |u| + s E) sgn(w) + d + e E,    E = exp(-|w/v_s|^delta)

c + d and s + e act on a wheel that turns forward, c - d and s - e on one that turns backward; mu |u| is the friction of
a drive's teeth under the motor's torque u. d, e and mu are zero for most robots. At rest the friction is set-valued: it
balances the load, from -(c - d + s - e + mu |u|) to c + d + s + e + mu |u|. The rolling friction of the ball is in
`ballbot.mechanics.floor`.

A dry friction that differs with direction is a symmetric one, c + mu |u| + s E, about the torque d + e E. So the convex
step's asymmetric box is a symmetric box, with that torque taken from the motor's: the minimiser is the same.

This is the classical law. A robot may have another g(|w|, |u|) in place of c + mu |u| + s E, and no e
(`ballbot.robot.friction_law`); the functions here ask the law that the friction names, or that the wheel's numbers are
of (`OwnWheel`), and no other place knows which it is.

NumPy's form is the reference of the compiled one. The compiled functions take the sign from outside, because
the integrator must know when it may change.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ballbot.arrays import Floats
from ballbot.mechanics.engine.elementary import binary_logarithm, power_of_two
from ballbot.mechanics.engine.tracing import greatest, least, traced, where
from ballbot.robot import Friction


def stribeck_curve(
    coulomb: float | Floats, stribeck: float | Floats, ratio: Floats, exponent: float
) -> Floats:
    """Return c + s exp(-|w/v_s|^delta) for the ratio w/v_s (...); c + s at rest. Numba compiles it as it stands."""
    return coulomb + stribeck * np.exp(-(np.abs(ratio) ** exponent))


def dry_friction_size(speed: ArrayLike, friction: Friction, *, torque: ArrayLike | None = None) -> Floats:
    """Return the size (..., n) [N m] of each wheel's dry friction in the direction it turns; at rest the mean of both.

    The arguments are those of `wheel_friction`.
    """
    w = np.asarray(speed, dtype=float)
    if friction.own_law:
        load = np.abs(np.zeros(w.shape) if torque is None else np.broadcast_to(torque, w.shape))
        return friction.dry_size(np.abs(w), load) + np.sign(w) * friction_terms(friction)[:, 0]
    d, e, mu = friction_terms(friction).T
    c = np.asarray(friction.coulomb) + np.sign(w) * d + mu * np.abs(0.0 if torque is None else torque)
    s = np.asarray(friction.stribeck) + np.sign(w) * e
    return stribeck_curve(c, s, w / friction.stribeck_speed, friction.stribeck_exponent)


class WheelTerms(NamedTuple):
    """The terms that most robots lack, of one wheel; numbers of compiled code too."""

    coulomb_asymmetry: float = 0.0  #: d [N m]
    stribeck_asymmetry: float = 0.0  #: e [N m]
    load: float = 0.0  #: mu [-]


NO_TERMS = WheelTerms()


def friction_terms(friction: Friction) -> Floats:
    """Return a friction's optional terms (n, 3), a row of `WheelTerms` for each wheel."""
    zeros = (0.0,) * len(friction.coulomb)
    return np.column_stack([getattr(friction, name) or zeros for name in WheelTerms._fields])


def wheel_friction(speed: ArrayLike, friction: Friction, *, torque: ArrayLike | None = None) -> Floats:
    """Return the friction torque tau(w) (..., n) [N m] of each wheel at w (..., n) [rad/s], zero at zero speed.

    It acts against the speed where it is positive. The load term follows the motors' torques at the wheel (..., n) [N
    m]; without them it counts as zero.
    """
    w = np.asarray(speed, dtype=float)
    return np.asarray(friction.viscous) * w + dry_friction_size(w, friction, torque=torque) * np.sign(w)


def steady_friction(speed: ArrayLike, friction: Friction) -> Floats:
    """Return the friction torque (...) [N m] of the one wheel that a friction is of, at speeds (...) [rad/s]."""
    return wheel_friction(np.asarray(speed, dtype=float)[..., None], friction)[..., 0]


# --- compiled: of a `Wheel`, or an `OwnWheel` ---


class Wheel(NamedTuple):
    """One wheel's numbers under the classical law."""

    axle: tuple[float, float, float]  #: its row of A
    b: float
    c: float  #: the motor's load included
    s: float
    terms: WheelTerms
    inv_vs: float  #: 1/v_s [s/rad]
    delta: float


class OwnWheel(NamedTuple):
    """One wheel's numbers under a registered law; subclasses have it as `size`."""

    axle: tuple[float, float, float]
    b: float
    coulomb_asymmetry: float
    factor: float  #: of the law's friction, 1 unless a simulation lets it follow the wheel's force
    numbers: tuple[float, ...]  #: the law's parameters, in its order
    load: float  #: size of the motor's torque [N m]

    size = staticmethod(lambda speed, load: 0.0)

    def dry(self, speed):
        """Return g(|w|, |u|)."""
        return self.factor * self.size(abs(speed), self.load, *self.numbers)


_LOG2_OF_LOG2_E = 0.5287663729448977  # e^-p = 2^-(p log2 e)
#: 2^-2^9.5 is 1e-218: nothing is left of s, and 2^9.5 is a power that two may still be raised to
_LARGEST_EXPONENT = 9.5


@traced
def with_stribeck(constant, stribeck, E):
    """Return c + s E, or d + e E: a part of the friction that stays with the speed and one that decays."""
    return constant + stribeck * E


@traced
def dry_friction(wheel, speed):
    """Return the size of the friction, the mean of both directions: c + s exp(-|w/v_s|^delta)."""
    if isinstance(wheel, OwnWheel):
        return wheel.dry(speed)
    return with_stribeck(wheel.c, wheel.s, decay(abs(speed) * wheel.inv_vs, wheel.delta))


def decay_exponent(wheel, speed):
    """Return e with exp(-|w/v_s|^delta) = 2^-2^e, kept where both powers can be raised."""
    return _decay_exponent(abs(speed) * wheel.inv_vs, wheel.delta)


def _decay_exponent(ratio, delta):
    exponent = delta * binary_logarithm(ratio) + _LOG2_OF_LOG2_E
    return least(greatest(exponent, -1000.0), _LARGEST_EXPONENT)


@traced
def decay(ratio, delta):
    """Return E for |w/v_s|."""
    return power_of_two(-power_of_two(_decay_exponent(ratio, delta)))


def with_decay(wheel, power, direction):
    """Return the size of the friction in a direction (1, -1; 0 for the mean of both), E being 2^-power."""
    E = power_of_two(-power)
    d, e = wheel.terms.coulomb_asymmetry, wheel.terms.stribeck_asymmetry
    return with_stribeck(wheel.c + direction * d, wheel.s + direction * e, E)


@traced
def directed_friction(wheel, speed, direction):
    """Return the size of the dry friction of a wheel that turns in a direction (1, -1; 0 for the mean of both)."""
    if isinstance(wheel, OwnWheel):
        return wheel.dry(speed) + direction * wheel.coulomb_asymmetry
    return with_decay(wheel, power_of_two(decay_exponent(wheel, speed)), direction)


@traced
def friction_shift(wheel, speed):
    """Return d + e E: the torque about which the dry friction is the same in both directions."""
    if isinstance(wheel, OwnWheel):
        return wheel.coulomb_asymmetry
    terms = wheel.terms
    return with_stribeck(
        terms.coulomb_asymmetry, terms.stribeck_asymmetry, decay(abs(speed) * wheel.inv_vs, wheel.delta)
    )


@traced
def under_load(wheel, torque):
    """Return a wheel with c + mu |u| for c, whose motor gives the torque u."""
    if isinstance(wheel, OwnWheel):
        return wheel._replace(load=abs(torque))
    return wheel._replace(c=wheel.c + wheel.terms.load * abs(torque))


@traced
def breakaway(wheel):
    """Return the size of the friction at rest, the mean of both directions: c + s."""
    return wheel.dry(0.0) if isinstance(wheel, OwnWheel) else wheel.c + wheel.s


@traced
def sign(value):
    """Return -1, 0 or 1."""
    return where(value > 0.0, 1.0, 0.0) - where(value < 0.0, 1.0, 0.0)
