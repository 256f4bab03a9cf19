"""One-step prediction: the next state from this one, and what its residuals have in common (thesis 4.1, 4.2).

    y_hat(k+1) = g(y(k), u(k))     (4.2)          eps(k) = y(k) - y_hat(k)     (4.3)

The correlation matrix is that of the ten residuals eps(k+1) and the torques u(k) that led there (Figure 4.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log import STATE_NAMES, Log
from ballbot.validation.forecast import ModelPair, forecast
from ballbot.validation.state_errors import ErrorPair, StateErrors
from ballbot.validation.windows import window_starts


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """One-step residuals of the model with friction and without, and the torques of each step."""

    residuals: NDArray[np.float64]  #: (steps, 10) with friction
    residuals_without: NDArray[np.float64]  #: (steps, 10) without friction
    torques: NDArray[np.float64]  #: (steps, n)

    @property
    def labels(self) -> tuple[str, ...]:
        """e_x .. e_psi_dot, u1 .. un: the rows and columns of `correlation`."""
        torques = (f"u{i}" for i in range(1, self.torques.shape[1] + 1))
        return (*(f"e_{name}" for name in STATE_NAMES), *torques)

    @property
    def correlation(self) -> NDArray[np.float64]:
        """Correlation of residuals and torques (10 + n, 10 + n); 13 by 13 for three wheels."""
        return correlation_of(np.hstack([self.residuals, self.torques]))

    @property
    def errors(self) -> ErrorPair:
        """All steps as one run."""
        return ErrorPair(
            with_friction=StateErrors.of_runs([self.residuals]),
            without_friction=StateErrors.of_runs([self.residuals_without]),
        )

    @property
    def start_covariance(self) -> NDArray[np.float64]:
        """Covariance (10, 10) of the noise of one measured state, as far as the residuals tell.

        A residual holds the noise of two states, the one started from and the one compared with, so half of the
        residuals' covariance is what one of them can have at most.
        """
        return 0.5 * np.cov(self.residuals, rowvar=False)


def correlation_of(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the correlation matrix of the columns; a constant column has none with others, and one with itself."""
    deviation = columns - columns.mean(axis=0)
    size = np.linalg.norm(deviation, axis=0)
    scaled = deviation / np.where(size > 0.0, size, 1.0)
    correlation = scaled.T @ scaled
    np.fill_diagonal(correlation, 1.0)
    return correlation


def predict(models: ModelPair, log: Log, parts: Sequence[range]) -> Prediction:
    """Predict every row within `parts` from the row before it."""
    starts = window_starts(parts, samples=1, every=1)
    predicted = forecast(models.both, log, starts, 1)[:, :, 0]
    measured = log.states[starts + 1]
    return Prediction(
        residuals=measured - predicted[0],
        residuals_without=measured - predicted[1],
        torques=log.torques[starts],
    )


def join_predictions(predictions: Sequence[Prediction]) -> Prediction:
    """Return the residuals of all `predictions` as one."""
    return Prediction(
        residuals=np.concatenate([part.residuals for part in predictions]),
        residuals_without=np.concatenate([part.residuals_without for part in predictions]),
        torques=np.concatenate([part.torques for part in predictions]),
    )
