"""Open-loop validation: both models under the measured torques, from many starts, until the lean is past recovery.

The robot is unstable, so that every forecast ends in a fall; what counts is how long it stays near what was
measured. The run of each start is cut where the first of the two models leans further than any torque could
recover, so that both are compared over the same samples (thesis 4.2). Beside the errors stands what the noise of the
measured start alone would cause in a perfect model: no model's error can be expected below that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import Bools, Floats
from ballbot.validation.models import (
    ErrorPair,
    ModelPair,
    StateErrors,
    Trajectories,
    drawn_noise,
    forecast,
    recoverable_lean,
    rows_after,
    window_starts,
)

#: longest run [s]; where no stretch is that long, the longest that fits
_LONGEST = 2.0
#: between starts [s]: the lean ends most runs within a second, so that they seldom overlap
_SPACING = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenLoop:
    """Errors of open-loop runs from many starts, and one of the runs to look at."""

    errors: ErrorPair
    noise: StateErrors  #: what the noise of the measured start alone would cause
    ended: Bools  #: (runs,) by the lean
    recoverable_lean: float  #: [rad]
    example: Trajectories  #: the run whose errors are the median ones

    @property
    def noise_floor(self) -> Floats:
        """RMSE (10,) that the noise of the measured start alone would cause."""
        return self.noise.rmse

    @property
    def past_recovery(self) -> float:
        """Share of the runs that ended by the lean."""
        return float(self.ended.mean())


def open_loop(
    models: ModelPair,
    log: Log,
    parts: Sequence[range],
    *,
    start_covariance: Floats,
    seed: int = 0,
) -> OpenLoop:
    """Compare both models with the log in open loop, from starts a second apart within the rows that count.

    `start_covariance` (10, 10) is that of a measured state's noise, for `OpenLoop.noise_floor`. InputError if no run of
    ten samples fits.
    """
    samples = min(round(_LONGEST / log.sample_time), max(len(part) for part in parts) - 1)
    every = max(1, round(_SPACING / log.sample_time))
    starts = window_starts(parts, samples=samples, every=every)
    limit = min(recoverable_lean(model) for model in models.both)
    starts = starts[_largest_lean(log.states[starts]) < limit]
    if samples < 10 or len(starts) == 0:
        raise InputError(
            "The log has no interval of ten samples with a lean from which the robot can recover."
        )
    states = forecast(models.both, log, starts, samples)
    measured = log.states[rows_after(starts, samples)]
    lengths = np.array([_samples_upright(runs, limit) for runs in states.swapaxes(0, 1)])
    errors = ErrorPair.of_runs(
        [run[:n] for run, n in zip(measured, lengths, strict=True)],
        *([run[:n] for run, n in zip(of_model, lengths, strict=True)] for of_model in states),
        overlap=-(-int(np.median(lengths)) // every),
    )
    shifted = log.states[starts] + drawn_noise(start_covariance, (len(starts),), seed=seed)
    noisy = forecast([models.first.model], log, starts, samples, initial=shifted)[0]
    noise = StateErrors.of_runs([(a - b)[:n] for a, b, n in zip(noisy, states[0], lengths, strict=True)])
    middle = _median_run(errors)
    return OpenLoop(
        errors=errors,
        noise=noise,
        ended=lengths < samples,
        recoverable_lean=limit,
        example=Trajectories.beside(log, int(starts[middle]), states[:, middle, : lengths[middle]]),
    )


def _largest_lean(states: Floats) -> Floats:
    return np.abs(states[..., 2:4]).max(axis=-1)


def _samples_upright(runs: Floats, limit: float) -> int:
    """Return for how many samples, one at least, every one of `runs` (models, samples, 10) leans less than `limit`."""
    fallen = np.flatnonzero(np.any(~(_largest_lean(runs) < limit), axis=0))
    return max(1, int(fallen[0])) if fallen.size else runs.shape[1]


def _median_run(errors: ErrorPair) -> int:
    """Return the run whose errors of the first model, each over its mean, sum to the median of the runs."""
    by_run = errors.first.by_run
    scale = np.where(by_run.mean(axis=0) > 0.0, by_run.mean(axis=0), 1.0)
    return int(np.argsort((by_run / scale).sum(axis=1), kind="stable")[len(by_run) // 2])
