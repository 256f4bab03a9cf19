"""One-step prediction: the next state from this one, and what remains (thesis 4.1, 4.2).

    y_hat(k+1) = g(y(k), u(k))     (4.2)          eps(k) = y(k) - y_hat(k)     (4.3)

A step's row holds eps(k+1) and what was known at k. `ballbot.validation.residuals` says what the residuals tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import wheel_angle_names, wheel_speed_names
from ballbot.validation.contenders import ModelPair
from ballbot.validation.forecast import forecast
from ballbot.validation.state_errors import ErrorPair
from ballbot.validation.windows import window_starts


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """One-step residuals of both models, and what each step started from."""

    residuals: NDArray[np.float64]  #: (steps, 10) of the first model
    residuals_second: NDArray[np.float64]  #: (steps, 10) of the second
    measured: NDArray[np.float64]  #: (steps, 10) the states that were predicted
    torques: NDArray[np.float64]  #: (steps, n)
    heading: NDArray[np.float64]  #: (steps,) psi [rad] that each step started from
    wheel_angles: NDArray[np.float64] | None  #: (steps, n) [rad] by the encoders; None where a log lacks them
    wheel_speeds: NDArray[np.float64] | None  #: (steps, n) [rad/s] by the encoders
    segments: tuple[int, ...]  #: lengths of the runs of steps that follow each other without a gap
    logs: tuple[int, ...]  #: how many steps are of each log
    sample_time: float  #: [s]

    @property
    def labels(self) -> tuple[str, ...]:
        """e_x .. e_psi_dot, u1 .. un: the rows and columns of the correlation matrix."""
        torques = (f"u{i}" for i in range(1, self.torques.shape[1] + 1))
        return (*(f"e_{name}" for name in STATE_NAMES), *torques)

    @property
    def errors(self) -> ErrorPair:
        """All steps as one run."""
        measured = self.measured
        return ErrorPair.of_runs([measured], [measured - self.residuals], [measured - self.residuals_second])

    @property
    def start_covariance(self) -> NDArray[np.float64]:
        """Covariance (10, 10) of the noise of one measured state, as far as the residuals tell.

        A residual holds the noise of two states, the one started from and the one compared with, so half of the
        residuals' covariance is what one of them can have at most.
        """
        return 0.5 * np.cov(self.residuals, rowvar=False)


def predict(models: ModelPair, log: Log, parts: Sequence[range]) -> Prediction:
    """Predict every row within `parts` from the row before it."""
    starts = window_starts(parts, samples=1, every=1)
    predicted = forecast(models.both, log, starts, 1)[:, :, 0]
    measured = log.states[starts + 1]
    count = log.torques.shape[1]
    return Prediction(
        residuals=measured - predicted[0],
        residuals_second=measured - predicted[1],
        measured=measured,
        torques=log.torques[starts],
        heading=log["psi"][starts],
        wheel_angles=_columns(log, wheel_angle_names(count), starts),
        wheel_speeds=_columns(log, wheel_speed_names(count), starts),
        segments=tuple(len(part) - 1 for part in parts),
        logs=(len(starts),),
        sample_time=log.sample_time,
    )


def join_predictions(predictions: Sequence[Prediction]) -> Prediction:
    """Return the steps of all `predictions` as one."""

    def together(arrays: Sequence[NDArray[np.float64] | None]) -> NDArray[np.float64] | None:
        known = [array for array in arrays if array is not None]
        return np.concatenate(known) if len(known) == len(arrays) else None

    return Prediction(
        residuals=np.concatenate([part.residuals for part in predictions]),
        residuals_second=np.concatenate([part.residuals_second for part in predictions]),
        measured=np.concatenate([part.measured for part in predictions]),
        torques=np.concatenate([part.torques for part in predictions]),
        heading=np.concatenate([part.heading for part in predictions]),
        wheel_angles=together([part.wheel_angles for part in predictions]),
        wheel_speeds=together([part.wheel_speeds for part in predictions]),
        segments=tuple(length for part in predictions for length in part.segments),
        logs=tuple(length for part in predictions for length in part.logs),
        sample_time=predictions[0].sample_time,
    )


def _columns(log: Log, names: Sequence[str], rows: NDArray[np.int64]) -> NDArray[np.float64] | None:
    if not all(name in log and np.isfinite(log[name]).all() for name in names):
        return None
    return np.column_stack([log[name][rows] for name in names])
