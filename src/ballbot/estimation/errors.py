"""How far an estimated state is from the true one, in the numbers that tell estimators apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

_MINUTE = 60.0


@dataclass(frozen=True, kw_only=True)
class StateErrors:
    """Root mean squares over a run, both components together where there are two."""

    lean: float  #: theta and phi [rad]
    rate: float  #: theta_dot, phi_dot and psi_dot [rad/s]
    velocity: float  #: of the ball [m/s]
    heading: float  #: psi [rad]
    position: float  #: [m]
    position_drift: float  #: change of the position's error within a minute [m]; NaN where the run is shorter


def state_errors(
    t: NDArray[np.float64], states: NDArray[np.float64], truth: NDArray[np.float64]
) -> StateErrors:
    """Return the errors of estimated states (N, 10) against the true ones (N, 10), at even times t (N,) [s].

    The drift is taken over all pairs of instants a minute apart, so that neither a good end nor a way that
    returns to where it began can hide it.

    Raises
    ------
    InputError
        Where the shapes do not fit each other.
    """
    if not (states.shape == truth.shape == (len(t), 10) and len(t) > 1):
        raise InputError(
            f"Errors of states need t (N,) and two arrays of states (N, 10), not {t.shape}, {states.shape} "
            f"and {truth.shape}."
        )
    error = states - truth
    rows = round(_MINUTE * (len(t) - 1) / float(t[-1] - t[0]))
    drift = error[rows:, :2] - error[:-rows, :2]
    return StateErrors(
        lean=_size(error[:, 2:4]),
        rate=_size(error[:, 7:10]),
        velocity=_size(error[:, 5:7]),
        heading=_size(error[:, 4:5]),
        position=_size(error[:, :2]),
        position_drift=_size(drift) if len(drift) else float("nan"),
    )


def _size(errors: NDArray[np.float64]) -> float:
    """Return the root mean square length of the rows."""
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
