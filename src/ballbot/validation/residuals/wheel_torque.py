"""The residuals as wheel torques: what the wheels would have had to push more for the model to be right.

In the heading frame and upright, a torque more of du makes the rates h M^-1 W^T du higher after a sample of h. With S
the covariance of the rates' residuals e, least squares weighted by what each rate is known to gives

    du = (J^T S^-1 J)^-1 J^T S^-1 e,      J = h M^-1 W^T

Friction missed, a gearbox's play, or rollers that pass show there, wheel by wheel. What is measured at a sample is in
its residual with its noise, so whoever looks for a dependence on the wheels' speed takes it some rows earlier.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.model import Model
from ballbot.validation.prediction import Prediction

_PAIRS = ((0, 1), (2, 3))
#: a covariance's smallest directions are lifted to this share of its largest, so that it has an inverse
_LIFT = 1e-10


def wheel_torque_residuals(prediction: Prediction, model: Model) -> NDArray[np.float64]:
    """Return the residual torques (steps, n) [N m]."""
    rates = prediction.residuals[:, 5:].copy()
    c, s = np.cos(prediction.heading), np.sin(prediction.heading)
    for first, second in _PAIRS:
        forward, left = rates[:, first].copy(), rates[:, second].copy()
        rates[:, first], rates[:, second] = c * forward + s * left, c * left - s * forward
    upright = np.zeros(5)
    J = prediction.sample_time * np.linalg.solve(model.mass_matrix(upright), model.wheel_jacobian(upright).T)
    scale = np.sqrt(np.mean(rates**2, axis=0)) + np.finfo(float).tiny
    S = np.cov(rates / scale, rowvar=False) + _LIFT * np.eye(len(scale))
    weighted = np.linalg.solve(S, J / scale[:, None])
    gain = np.linalg.solve(weighted.T @ (J / scale[:, None]), weighted.T)
    return (rates / scale) @ gain.T
