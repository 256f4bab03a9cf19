"""The Stribeck curve in NumPy: the steady friction of several laws, and the reference of their compiled forms."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


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
