"""Prediction errors: one step ahead (thesis 4.1, 4.2), and over horizons from one sample to half a second.

    y_hat(k+1) = g(y(k), u(k))     (4.2)          eps(k) = y(k) - y_hat(k)     (4.3)

A step's row holds eps(k+1) and what was known at k. `ballbot.validation.residuals` analyses the residuals.

One step alone is bound by the noise of the sensors and says little about the model; half a second is governed by the
model. The error against the horizon between the two shows which of them an error comes from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.comparison import HorizonErrors
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import Floats, wheel_speed_names
from ballbot.validation.models import (
    ErrorPair,
    ModelPair,
    drawn_noise,
    forecast,
    rows_after,
    window_starts,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """One-step residuals of both models, and the states that the steps started from."""

    residuals: Floats  #: (steps, 10) of the first model
    residuals_second: Floats  #: (steps, 10) of the second
    measured: Floats  #: (steps, 10) the states that were predicted
    torques: Floats  #: (steps, n)
    heading: Floats  #: (steps,) psi [rad] that each step started from
    wheel_speeds: Floats | None  #: (steps, n) [rad/s] by the encoders; None if a log lacks them
    segments: tuple[int, ...]  #: lengths of the runs of steps that follow each other without a gap
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
    def start_covariance(self) -> Floats:
        """Covariance (10, 10) of the noise of one measured state, estimated from the residuals.

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
        wheel_speeds=_columns(log, wheel_speed_names(count), starts),
        segments=tuple(len(part) - 1 for part in parts),
        sample_time=log.sample_time,
    )


def _columns(log: Log, names: Sequence[str], rows: NDArray[np.int64]) -> Floats | None:
    if not all(name in log and np.isfinite(log[name]).all() for name in names):
        return None
    return np.column_stack([log[name][rows] for name in names])


#: how far ahead [s]
HORIZONS = (0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)

#: starts are this far apart [s]: enough of them, and not so near that they repeat each other
_SPACING = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class HorizonComparison:
    """Errors of both models at each horizon, and the scales to compare them with."""

    errors: HorizonErrors  #: of the first model and the second, state by state
    #: (h, 10), RMSE that the noise of start and measurement alone would cause
    noise_floor: Floats
    spread: Floats  #: (10,), standard deviation of what was measured


def compare_horizons(
    models: ModelPair,
    log: Log,
    parts: Sequence[range],
    *,
    start_covariance: Floats,
    seed: int = 0,
) -> HorizonComparison:
    """Forecast from starts 0.1 s apart and compare at each horizon that fits the stretches of rows that count.

    `start_covariance` (10, 10) is that of a measured state's noise, for the noise floor.
    """
    step = log.sample_time
    fitting = max(len(part) for part in parts) - 1
    ahead = np.unique(np.clip(np.round(np.array(HORIZONS) / step).astype(int), 1, fitting))
    samples = int(ahead[-1])
    starts = window_starts(parts, samples=samples, every=max(1, round(_SPACING / step)))
    states = forecast(models.both, log, starts, samples)
    measured = log.states[rows_after(starts, samples)]

    noise = drawn_noise(start_covariance, (2, len(starts)), seed=seed)
    shifted = forecast([models.first.model], log, starts, samples, initial=log.states[starts] + noise[0])[0]
    floor = (shifted + noise[1][:, None] - states[0])[:, ahead - 1]
    horizons = ahead * step
    return HorizonComparison(
        errors=HorizonErrors(
            horizons=horizons,
            differences=(states - measured)[:, :, ahead - 1],
            overlap=int(-(-horizons[-1] // _SPACING)),
        ),
        noise_floor=np.sqrt(np.mean(floor**2, axis=0)),
        spread=np.std(np.concatenate([log.states[part.start : part.stop] for part in parts]), axis=0),
    )


def join_horizons(parts: Sequence[HorizonComparison]) -> HorizonComparison:
    """Return the errors over the starts of all `parts` of the first one's horizons; the spread is that one's."""
    first = parts[0].errors
    alike = [part for part in parts if np.array_equal(part.errors.horizons, first.horizons)]
    weights = [part.errors.starts for part in alike]
    noise = [part.noise_floor for part in alike]
    differences = np.concatenate([part.errors.differences for part in alike], axis=1)
    return HorizonComparison(
        errors=replace(first, differences=differences),
        # the root of the mean square over all starts
        noise_floor=np.sqrt(np.average(np.array(noise) ** 2, axis=0, weights=weights)),
        spread=parts[0].spread,
    )
