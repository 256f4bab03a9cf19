"""The classical friction law (thesis 3.3 and 3.8) and rolling friction (3.7).

    tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sgn(w)        F = -N C_rr v/|v|

Both are set-valued at rest: there the friction is whatever holds, up to c + s and N C_rr. The compiled
functions take the sign from outside, because who integrates must know when it may change.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.compiled import inlined
from ballbot.mechanics.elementary import exponential, logarithm
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


@inlined
def dry_friction(wheel, speed):
    """Return c + s exp(-|w/v_s|^delta): the size of the friction that has the speed's sign."""
    decay = exponential(-exponential(wheel.delta * logarithm(abs(speed) * wheel.inv_vs)))
    return wheel.c + wheel.s * decay


@inlined
def sign(value):
    """Return -1, 0 or 1."""
    return (1.0 if value > 0.0 else 0.0) - (1.0 if value < 0.0 else 0.0)
