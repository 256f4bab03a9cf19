"""The classical friction law (thesis 3.3 and 3.8) and rolling friction (3.7).

    tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sgn(w)        F = -N C_rr v/|v|

Both are set-valued at rest: there the friction is whatever holds, up to c + s and N C_rr. The compiled
functions take the sign from outside, because who integrates must know when it may change.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.elementary import binary_logarithm, power_of_two
from ballbot.robot import Friction


def wheel_friction(speed: ArrayLike, friction: Friction) -> NDArray[np.float64]:
    """Return the friction torque of each wheel, zero at zero speed.

    Parameters
    ----------
    speed : array_like (..., n)
        Wheel speeds [rad/s].
    friction : Friction

    Returns
    -------
    ndarray (..., n)
        tau(w) [N m]; it acts against the speed. NumPy's form, and the reference of the compiled one.
    """
    w = np.asarray(speed, dtype=float)
    b, c, s = (np.asarray(value) for value in (friction.viscous, friction.coulomb, friction.stribeck))
    decay = np.exp(-(np.abs(w / friction.stribeck_speed) ** friction.stribeck_exponent))
    return b * w + (c + s * decay) * np.sign(w)


_LOG2_OF_LOG2_E = 0.5287663729448977  # e^-p = 2^-(p log2 e)
_LARGEST_EXPONENT = (
    9.5  # 2^-2^9.5 is 1e-218: nothing is left of s, and 2^9.5 is a power that two may still be raised to
)


@inlined
def dry_friction(wheel, speed):
    """Return c + s exp(-|w/v_s|^delta): the size of the friction that has the speed's sign."""
    return with_decay(wheel, power_of_two(decay_exponent(wheel, speed)))


@inlined
def decay_exponent(wheel, speed):
    """Return e with exp(-|w/v_s|^delta) = 2^-2^e, kept where both powers can be raised."""
    exponent = wheel.delta * binary_logarithm(abs(speed) * wheel.inv_vs) + _LOG2_OF_LOG2_E
    return min(max(exponent, -1000.0), _LARGEST_EXPONENT)


@inlined
def with_decay(wheel, power):
    """Return c + s 2^-power."""
    return wheel.c + wheel.s * power_of_two(-power)


@inlined
def sign(value):
    """Return -1, 0 or 1."""
    return (1.0 if value > 0.0 else 0.0) - (1.0 if value < 0.0 else 0.0)


def stribeck_curve(
    speed: ArrayLike,
    *,
    viscous: float,
    coulomb: float,
    stribeck: float,
    stribeck_speed: float,
    stribeck_exponent: float,
) -> NDArray[np.float64]:
    """Return b w + (c + s exp(-|w/v_s|^delta)) sgn(w), 0 at rest.

    Parameters
    ----------
    speed : array_like (...)
        w [rad/s].
    viscous : float
        b [N m s/rad].
    coulomb, stribeck : float
        c and s [N m].
    stribeck_speed : float
        v_s [rad/s].
    stribeck_exponent : float
        delta [-].
    """
    w = np.asarray(speed, dtype=float)
    decay = np.exp(-(np.abs(w / stribeck_speed) ** stribeck_exponent))
    return viscous * w + (coulomb + stribeck * decay) * np.sign(w)
