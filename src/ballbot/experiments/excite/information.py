"""What a run would tell: the standard errors that identification would give on its log, before there is one.

A run that is simulated with the parameters believed is cut into windows as identification cuts a log, and linearised
as its last stage does: batched central differences of the windows' predictions, each window's start estimated along
with the parameters. With residuals r_w of deviations sigma, J_w = d r_w / d z weighted by 1/sigma and the starts
eliminated, the information and the expected covariance of scaled parameters z are

    H = sum_w J_w^T J_w                cov z = H^-1

Residuals that hang together within a window, as they do on a robot, make identification's own errors (clustered by
window) larger, on one run much as on another: it is for comparing runs that these are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.run import Threads
from ballbot.identification.initial_states import linearize
from ballbot.identification.parameters import Coordinates
from ballbot.identification.prediction import Cost, Predictor, Problem
from ballbot.identification.stages import windows_for
from ballbot.log import Log

#: a parameter that all others known would not tell to its range's width, by one residual, has no influence
_LEAST_INFORMATION = 1.0
#: relative to the largest: keeps directions of which a run says nothing as very uncertain ones
_RIDGE = 1e-13


@dataclass(frozen=True, kw_only=True, eq=False)
class Question:
    """What is asked of a run."""

    predictor: Predictor  #: its step is the simulation's
    coordinates: Coordinates
    point: NDArray[np.float64]  #: (p,), scaled, what is believed
    deviations: NDArray[np.float64]  #: (10,), of each state's prediction on the robot
    window: float  #: [s]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the parameters sought."""
        free = self.coordinates.free
        return tuple(label for label, one in zip(self.coordinates.labels, free, strict=True) if one)

    def in_units(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return standard errors of the parameters sought in SI units, from scaled ones."""
        return scaled * self.coordinates.slopes(self.point)[self.coordinates.free]


def expected_errors(question: Question, logs: Sequence[Log]) -> NDArray[np.float64]:
    """Return the standard errors to expect of the parameters sought, in shares of their bounds' width.

    Parameters
    ----------
    question : Question
    logs : sequence of Log
        Simulated with what is believed, without noise.

    Returns
    -------
    ndarray (f,)
        Of the free parameters; infinite where the runs say nothing of one.
    """
    H = _information(question, logs)
    H = H[np.ix_(question.coordinates.free, question.coordinates.free)]
    told = H.diagonal() > _LEAST_INFORMATION
    errors = np.full(len(H), np.inf)
    if told.any():
        scale = 1.0 / np.sqrt(H.diagonal()[told])
        R = H[np.ix_(told, told)] * np.outer(scale, scale)
        inverse = np.linalg.inv(R + _RIDGE * np.eye(len(R)))
        errors[told] = scale * np.sqrt(np.maximum(inverse.diagonal(), 1.0))
    return errors


def _information(question: Question, logs: Sequence[Log]) -> NDArray[np.float64]:
    """Return H (p, p) of the scaled parameters."""
    predictor = question.predictor
    windows = windows_for(predictor, question.coordinates.upper, logs, duration=question.window)
    # measurements off by exactly their deviations: identification takes its weights from the residuals
    off = replace(
        windows,
        initial=windows.initial + question.deviations,
        measured=windows.measured + question.deviations,
    )
    problem = Problem(
        predictor=predictor,
        windows=off,
        coordinates=question.coordinates,
        cost=Cost(reference=question.deviations**2),
        spread=Threads(count=1),
    )
    return linearize(problem, question.point, windows.initial).equations.normal.matrix
