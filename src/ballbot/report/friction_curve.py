"""A wheel's friction over its speed, with the band in which the standard errors leave it.

    tau(w) = b w + (c + s E) sgn(w),      E = exp(-r),      r = |w/v_s|^delta

The band is the delta method's: variance g' C g with g the gradient of tau by (b, c, s, v_s, delta) and C their
covariance; parameters that have no standard error count as known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.result import Identification
from ballbot.mechanics.friction import wheel_friction


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionCurve:
    """One wheel's friction torque at some speeds."""

    speed: NDArray[np.float64]  #: (k,) [rad/s]
    torque: NDArray[np.float64]  #: (k,) [N m]
    standard_error: NDArray[np.float64]  #: (k,) [N m]


def friction_curve(found: Identification, wheel: int, speed: NDArray[np.float64]) -> FrictionCurve:
    """Return the friction of wheel `wheel` (from 0) at speeds (k,) [rad/s] other than zero."""
    friction = found.robot.friction
    n = found.robot.wheel_count
    gradient = np.zeros((len(speed), len(found.labels)))
    sign, decay = np.sign(speed), np.abs(speed / friction.stribeck_speed) ** friction.stribeck_exponent
    E, s = np.exp(-decay), friction.stribeck[wheel]
    gradient[:, wheel] = speed
    gradient[:, n + wheel] = sign
    gradient[:, 2 * n + wheel] = E * sign
    gradient[:, 3 * n] = s * E * decay * friction.stribeck_exponent / friction.stribeck_speed * sign
    gradient[:, 3 * n + 1] = -s * E * decay * np.log(np.abs(speed) / friction.stribeck_speed) * sign
    C = parameter_covariance(found)
    variance = np.einsum("ki,ij,kj->k", gradient, C, gradient)
    torque = wheel_friction(np.repeat(speed[:, None], n, axis=1), friction)[:, wheel]
    return FrictionCurve(speed=speed, torque=torque, standard_error=np.sqrt(np.maximum(variance, 0.0)))


def parameter_covariance(found: Identification) -> NDArray[np.float64]:
    """Return the covariance (p, p) in the order of `found.labels`; zero where there is no standard error."""
    errors = np.nan_to_num(standard_errors(found))
    return np.nan_to_num(found.correlation) * np.outer(errors, errors)


def standard_errors(found: Identification) -> NDArray[np.float64]:
    """Return the standard errors (p,) in the order of `found.labels`."""
    return np.concatenate([np.atleast_1d(value) for value in found.standard_errors.values()])
