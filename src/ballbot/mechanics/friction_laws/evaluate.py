"""A law by itself: its friction at a speed, its state after a while, its answer to a history of speeds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array, real_number
from ballbot.errors import InputError
from ballbot.mechanics.compiled import compiled
from ballbot.mechanics.friction_laws.interface import FrictionLaw, friction_of, settle


def friction_at(
    law: FrictionLaw, speed: float, *, state: ArrayLike | None = None, applied: float = 0.0
) -> float:
    """Return the friction [N m] at a speed [rad/s]; it acts against positive speeds where it is positive.

    Parameters
    ----------
    state : ndarray (m,), optional
        The law's internal state; after a long rest by default.
    applied : float
        The torque [N m] on the inertia. A law that sticks balances it up to its limit.

    Raises
    ------
    InputError
        If the state is not the law's, or a number is not finite.
    """
    state = law.initial_state(1.0) if state is None else _state_of(law, state)
    at, on = real_number(speed, "The speed"), real_number(applied, "The applied torque")
    return float(_friction_at(law.numbers(), state, at, on))


def advance(law: FrictionLaw, state: ArrayLike, *, speed: float, step: float) -> NDArray[np.float64]:
    """Return the law's state (m,) after `step` [s] at constant speed [rad/s], exactly.

    Raises
    ------
    InputError
        If the state (m,) is not the law's, a number is not finite, or the step is negative.
    """
    at, h = real_number(speed, "The speed"), real_number(step, "The step")
    if h < 0.0:
        raise InputError(f"The step is {h:g} s; it must not be negative.")
    return _advance(law.numbers(), _state_of(law, state), at, h)


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
        If the speeds are not a row of finite numbers, or the sample time is not above zero.
    """
    history = real_array(speeds, ("samples",), "The row of speeds")
    h = positive_number(sample_time, "The sample time")
    if np.ndim(applied) == 0:
        torques = np.full(len(history), real_number(applied, "The applied torque"))
    else:
        torques = real_array(applied, history.shape, "The row of applied torques")
    return _follow(law.numbers(), law.initial_state(h), history, torques, h)


def _state_of(law: FrictionLaw, state: ArrayLike) -> NDArray[np.float64]:
    return real_array(state, law.initial_state(1.0).shape, "The friction law's state")


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
