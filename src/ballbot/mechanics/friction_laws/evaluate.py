"""A law by itself: its friction at a speed, its state after a while, its answer to a history of speeds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError
from ballbot.mechanics.compiled import compiled
from ballbot.mechanics.friction_laws.interface import FrictionLaw, friction_of, settle


def friction_at(
    law: FrictionLaw, speed: float, *, state: NDArray[np.float64] | None = None, applied: float = 0.0
) -> float:
    """Return the friction [N m] at a speed [rad/s]; it acts against positive speeds where it is positive.

    Parameters
    ----------
    state : ndarray (m,), optional
        The law's internal state; after a long rest by default.
    applied : float
        The torque [N m] on the inertia. A law that sticks balances it up to its limit.
    """
    state = law.initial_state(1.0) if state is None else np.asarray(state, dtype=float)
    return float(_friction_at(law.numbers(), state, float(speed), float(applied)))


def advance(
    law: FrictionLaw, state: NDArray[np.float64], *, speed: float, step: float
) -> NDArray[np.float64]:
    """Return the law's state (m,) after `step` [s] at constant speed [rad/s], exactly."""
    return _advance(law.numbers(), np.asarray(state, dtype=float), float(speed), float(step))


def follow(
    law: FrictionLaw, speeds: ArrayLike, *, sample_time: float, applied: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """Return the friction [N m] along a history of speeds, from a long rest.

    Parameters
    ----------
    speeds : array_like (N,)
        [rad/s]; between two samples the law takes their mean, which is of order two.
    sample_time : float
        [s]
    applied : array_like, () or (N,)
        Torque on the inertia [N m], read where the law sticks.

    Returns
    -------
    ndarray (N,)

    Raises
    ------
    InputError
        Where the speeds are not a row of numbers or the sample time is not above zero.
    """
    history = np.ascontiguousarray(speeds, dtype=float)
    if history.ndim != 1 or not np.isfinite(history).all():
        raise InputError(
            f"The speeds have the shape {history.shape}; they must be one row of finite numbers."
        )
    if not 0.0 < sample_time < np.inf:
        raise InputError(f"The sample time is {sample_time:g} s; it must be above zero.")
    torques = np.ascontiguousarray(np.broadcast_to(np.asarray(applied, dtype=float), history.shape))
    return _follow(law.numbers(), law.initial_state(sample_time), history, torques, float(sample_time))


@compiled
def _friction_at(law, state, speed, applied):
    return friction_of(law, state, speed, applied)


@compiled
def _advance(law, state, speed, h):
    end = state.copy()
    settle(law, end, speed, speed, h)
    return end


@compiled
def _follow(law, state, speeds, applied, h):
    out = np.empty(len(speeds))
    for k in range(len(speeds)):
        if k > 0:
            settle(law, state, speeds[k - 1], speeds[k], h)
        out[k] = friction_of(law, state, speeds[k], applied[k])
    return out
