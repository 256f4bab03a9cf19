"""Contact points, rolling directions and axles of the omni-wheels, body frame with its origin at the ball's centre.

Wheel i touches the ball at azimuth beta_i and tilt alpha from the zenith:

    n_i = ( cos beta_i sin alpha,   sin beta_i sin alpha,  cos alpha)   contact direction
    t_i = (-sin beta_i,             cos beta_i,            0        )   rolling direction
    a_i = n_i x t_i = (-cos alpha cos beta_i, -cos alpha sin beta_i, sin alpha)     axle

The axle a_i is the direction about which a *ball* that follows the wheel turns; the wheel turns the other way. A wheel
that drives pushes the ball along t_i.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Angles = Sequence[float] | NDArray[np.float64]


def contact_directions(azimuths: Angles, tilt: float) -> NDArray[np.float64]:
    """Return n_i (n, 3): unit vectors from the ball's centre to each contact point; angles in rad."""
    beta = np.asarray(azimuths)
    height = np.full_like(beta, np.cos(tilt))
    return np.stack([np.cos(beta) * np.sin(tilt), np.sin(beta) * np.sin(tilt), height], axis=-1)


def rolling_directions(azimuths: Angles) -> NDArray[np.float64]:
    """Return t_i (n, 3): unit vectors along which each wheel pushes the ball; angles in rad."""
    beta = np.asarray(azimuths)
    return np.stack([-np.sin(beta), np.cos(beta), np.zeros_like(beta)], axis=-1)


def axles(azimuths: Angles, tilt: float) -> NDArray[np.float64]:
    """Return a_i = n_i x t_i (n, 3): unit vectors along each wheel's axle, up and inward; angles in rad."""
    return np.cross(contact_directions(azimuths, tilt), rolling_directions(azimuths))
