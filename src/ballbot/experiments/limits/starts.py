"""Starts from which a robot may have to save itself. Directions are angles on the floor from x towards y."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.model import Model


def leaning(direction: ArrayLike, lean: ArrayLike, rate: ArrayLike = 0.0) -> NDArray[np.float64]:
    """Return states (..., 10) that lean towards a direction and move on towards it, the ball at rest.

    Parameters
    ----------
    direction : array_like (...)
        On the floor [rad].
    lean : array_like (...)
        phi cos(direction) - theta sin(direction) [rad].
    rate : array_like (...)
        Its rate [rad/s].
    """
    direction, lean, rate = np.broadcast_arrays(direction, lean, rate)
    states = np.zeros((*lean.shape, 10))
    for place, size in ((2, lean), (7, rate)):
        states[..., place] = -size * np.sin(direction)
        states[..., place + 1] = size * np.cos(direction)
    return states


def pushed(model: Model, direction: ArrayLike, impulse: ArrayLike, height: ArrayLike) -> NDArray[np.float64]:
    """Return states (..., 10) just after a blow on a body that stood upright at rest.

    The blow J [N s] at the height h above the ball's centre is the generalised impulse p = (J, h e_z x J) on the
    ball's place and the body's turning, and M(0) q_dot = p. It is over before friction or the motors do anything.

    Parameters
    ----------
    model : Model
    direction : array_like (...)
        Of the blow, on the floor [rad].
    impulse : array_like (...)
        J [N s].
    height : array_like (...)
        h [m].
    """
    direction, impulse, height = np.broadcast_arrays(direction, impulse, height)
    J_x, J_y = impulse * np.cos(direction), impulse * np.sin(direction)
    p = np.stack([J_x, J_y, -height * J_y, height * J_x, np.zeros_like(J_x)], axis=-1)
    states = np.zeros((*impulse.shape, 10))
    states[..., 5:] = p @ np.linalg.inv(model.mass_matrix(np.zeros(5)))
    return states
