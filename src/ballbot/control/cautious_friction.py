"""Friction that is safe to compensate: no more than what is certain of it.

Compensation beyond the friction that is there feeds the motion energy. Identification gives a covariance; at a
confidence level with the normal quantile z, wheel i's curve is at least

    tau(w) - z sigma(w),      sigma^2 = g^T P g,   g = d tau / d (b, c, s, v_s, delta)

and the wheel's b, c and s are scaled by the least ratio of that to tau over the speeds, so that the curve keeps its
shape. b, c and s by themselves are known far worse than the curve: they trade against each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from ballbot.errors import InputError
from ballbot.robot import Friction, Robot

#: speeds of a wheel over which the curve is looked at [rad/s]; below the first it is the break-away torque's
_SPEEDS = np.geomspace(0.02, 8.0, 60)
#: step of the central differences, over each parameter (over 1 where it is zero)
_STEP = 1e-5


def cautious_friction(friction: Friction, covariance: ArrayLike, *, confidence: float = 0.95) -> Friction:
    """Return the friction scaled down to what it exceeds with that confidence.

    Parameters
    ----------
    friction : Friction
        As identified, n wheels.
    covariance : array_like (3 n + 3, 3 n + 3)
        Of b, c, s of each wheel, v_s, delta and C_rr in this order, SI units, as `ballbot.identify` orders its
        parameters; a row and column of NaN is of a parameter without standard error and counts as certain.
    confidence : float
        One-sided, for each wheel's curve and for the rolling friction.

    Returns
    -------
    Friction
        b, c, s of each wheel times a number from 0 to 1, and so C_rr; v_s and delta as they were.

    Raises
    ------
    InputError
        Where the covariance's shape is wrong, or the confidence is not from 0.5 to 1.
    """
    n = len(friction.coulomb)
    P = np.nan_to_num(np.asarray(covariance, dtype=np.float64))
    if P.shape != (3 * n + 3, 3 * n + 3):
        raise InputError(
            f"The covariance of the friction has the shape {P.shape}; {n} wheels have {3 * n + 3} parameters."
        )
    if not 0.5 <= confidence < 1.0:
        raise InputError(f"The confidence is {confidence:g}; it must be at least 0.5 and below 1.")
    z = float(norm.ppf(confidence))
    shares = np.array([_share(_curve_parameters(friction, i), P[np.ix_(places, places)], z)
                       for i, places in enumerate(_places(n))])  # fmt: skip
    rolling_error = float(np.sqrt(P[-1, -1]))
    return replace(
        friction,
        viscous=tuple((shares * friction.viscous).tolist()),
        coulomb=tuple((shares * friction.coulomb).tolist()),
        stribeck=tuple((shares * friction.stribeck).tolist()),
        rolling=max(friction.rolling - z * rolling_error, 0.0),
    )


def stated_covariance(robot: Robot) -> NDArray[np.float64] | None:
    """Return the covariance (3 n + 3, 3 n + 3) by the standard deviations in a robot's file, None where it has none.

    A file tells no correlations, so that b, c and s count as independent: with those, less would be given away.
    """
    n = robot.wheel_count
    spans = {
        "viscous": n,
        "coulomb": n,
        "stribeck": n,
        "stribeck_speed": 1,
        "stribeck_exponent": 1,
        "rolling": 1,
    }
    stated = robot.standard_deviations
    if not any(f"friction.{name}" in stated for name in spans):
        return None
    deviations = [
        np.broadcast_to(np.asarray(stated.get(f"friction.{name}", 0.0), dtype=np.float64), count)
        for name, count in spans.items()
    ]
    return np.diag(np.concatenate(deviations) ** 2)


def _places(n: int) -> list[list[int]]:
    """Return where b, c, s, v_s and delta of each wheel's curve stand among the parameters."""
    return [[i, n + i, 2 * n + i, 3 * n, 3 * n + 1] for i in range(n)]


def _curve_parameters(friction: Friction, wheel: int) -> NDArray[np.float64]:
    own = [friction.viscous[wheel], friction.coulomb[wheel], friction.stribeck[wheel]]
    return np.array([*own, friction.stribeck_speed, friction.stribeck_exponent])


def _share(values: NDArray[np.float64], P: NDArray[np.float64], z: float) -> float:
    """Return the least ratio of a curve's lower bound to itself over the speeds, from 0 to 1."""
    curve = _curve(values)
    if not curve.min() > 0.0:
        return 1.0  # nothing is compensated where nothing was found
    steps = _STEP * np.where(values == 0.0, 1.0, np.abs(values))
    slopes = [(_curve(values + step) - _curve(values - step)) / (2.0 * step.max()) for step in np.diag(steps)]
    g = np.array(slopes)
    sigma = np.sqrt(np.maximum(np.einsum("ik,ij,jk->k", g, P, g), 0.0))
    return float(np.clip(1.0 - z * sigma / curve, 0.0, 1.0).min())


def _curve(values: NDArray[np.float64]) -> NDArray[np.float64]:
    b, c, s, v_s, delta = values
    return b * _SPEEDS + c + s * np.exp(-((_SPEEDS / v_s) ** delta))
