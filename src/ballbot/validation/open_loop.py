"""Open-loop validation: both models under the measured torques, from many starts, until the lean is past recovery.

The robot is unstable, so that every forecast ends in a fall; the question is how long it stays near the measurement.
Each run is cut where the first of the two models leans further than any torque could recover, so that both are compared
over the same samples (thesis 4.2). The noise floor is the error that noise of the measured initial state causes in a
perfect model: no model's error can be expected below it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, note
from ballbot.log import STATE_NAMES
from ballbot.summary import counted
from ballbot.validation.models import (
    Case,
    Comparison,
    ErrorPair,
    Trajectories,
    by_state,
    forecast,
    recoverable_lean,
    rows_after,
    window_starts,
)

#: longest run [s]; shorter if no interval without a gap is that long
_LONGEST = 2.0
#: interval between starts [s]: the lean ends most runs within a second, so that they seldom overlap
_SPACING = 1.0


#: share of the error from which the noise of the initial state is named as its cause
_NOISE_SHARE = 0.7
#: ratio of the unstable poles below which a model falls more slowly than the other
_SLOWER = 0.95


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenLoop(Comparison):
    """Errors of open-loop runs from many starts, and an example run."""

    errors: ErrorPair
    noise_squares: Floats  #: (runs, 10) sums of the squared errors by the noise of the start alone
    ended: Bools  #: (runs,) whether the lean ended the run
    recoverable_lean: float  #: [rad]
    sample_time: float  #: [s]
    example: Trajectories  #: the run whose errors are the median ones

    @property
    def noise_floor(self) -> Floats:
        """RMSE (10,) by the noise of the measured initial state alone."""
        return np.sqrt(self.noise_squares.sum(axis=0) / self.errors.samples.sum())

    @property
    def past_recovery(self) -> float:
        """Share of the runs that ended by the lean."""
        return float(self.ended.mean())

    def verdict(self) -> str:
        length = float(self.errors.samples.mean()) * self.sample_time
        return (
            f"Open loop, {counted(self.errors.runs, 'run')} of {length:.2g} s on average "
            f"({100 * self.past_recovery:.0f} % of them ended by a lean past recovery, "
            f"{np.degrees(self.recoverable_lean):.0f} degrees): {self.errors.claim(self.models)}."
        )

    def remarks(self) -> tuple[Finding, ...]:
        """Return a finding with the reason for each state that the first model does not predict significantly better.

        With too few runs for an interval of the ratio of errors there are none.
        """
        lower, upper = self.errors.ratio_interval
        first, second = self.models.names
        claims = {"worse": "worse than", "undecided": "not significantly better than"}
        return tuple(
            note(
                "weak-state",
                f"{STATE_NAMES[i]}: the model {first} is {claims[verdict]} the one {second} in open loop (ratio "
                f"{self.errors.ratio[i]:.2f}, 95 % interval {lower[i]:.2f} to {upper[i]:.2f}). {self._reason(i)}",
            )
            for i, verdict in enumerate(self.errors.verdicts())
            if verdict != "better" and np.isfinite(lower[i])
        )

    def _reason(self, index: int) -> str:
        """Return the reason, as far as the data show it, why the first model does not predict a state better."""
        if self.errors.unresolved[index]:
            return "Reason: the errors of both models are below what any sensor of a robot resolves."
        share = self.noise_floor[index] / self.errors.rmse[0, index]
        verdict = self.errors.verdicts()[index]
        # at rest nothing turns the ball
        rigid = [replace(model, pivoting=None) for model in self.models.both]
        own, other = (float(model.linearize().poles()[0].real) for model in rigid)
        caused = f"the noise of the measured start alone causes {100 * share:.0f} % of the error"
        if share > _NOISE_SHARE and verdict == "worse" and other < _SLOWER * own:
            return (
                f"Reason: {caused}, and the other model falls more slowly ({other:.1f} against {own:.1f} rad/s), so it "
                "amplifies this noise less, whichever model is right."
            )
        if share > _NOISE_SHARE:
            return f"Reason: {caused}, so this state cannot show which model is better."
        if verdict == "undecided":
            return f"Reason: the {self.errors.runs} runs vary too much to decide."
        return (
            f"No reason was found in the data: {caused}, so the model itself lacks something for this state."
        )

    def shown(self) -> Iterator[tuple[str, ErrorPair | Trajectories | None]]:
        caption = (
            f"Open-loop errors over {counted(self.errors.runs, 'run')}, each from the measured state under the "
            "measured torques until the first of the two models leans past recovery. A shaded line: the model "
            f"{self.models.first.name} is not shown to be better."
        )
        yield caption, self.errors
        yield "The open-loop run with the median error.", self.example

    def results(self) -> dict[str, object]:
        return {
            **self.errors.results(self.models),
            "noise_floor_rmse": by_state(self.noise_floor),
            "past_recovery": self.past_recovery,
            "recoverable_lean": self.recoverable_lean,
        }


def open_loop(case: Case) -> OpenLoop:
    """Compare both models with the log in open loop, from starts a second apart within the rows that count.

    InputError if no run of ten samples fits.
    """
    models, log, parts = case.models, case.log, case.parts
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
    # the samples, at least one, until either model leans past recovery
    fallen = np.logical_not(np.all(_largest_lean(states) < limit, axis=0))
    lengths = np.where(fallen.any(axis=1), np.maximum(fallen.argmax(axis=1), 1), samples).tolist()

    def cut(runs: Floats) -> list[Floats]:
        return [run[:n] for run, n in zip(runs, lengths, strict=True)]

    errors = ErrorPair.of_runs(cut(measured), *map(cut, states), overlap=-(-int(np.median(lengths)) // every))
    shifted = log.states[starts] + case.drawn_noise(len(starts))
    noisy = forecast([models.first.model], log, starts, samples, initial=shifted)[0]
    # the run with the median error of the first model, summed over normalised states
    by_run = errors.by_run[:, 0]
    scale = np.where(by_run.mean(axis=0) > 0.0, by_run.mean(axis=0), 1.0)
    middle = int(np.argsort((by_run / scale).sum(axis=1), kind="stable")[len(by_run) // 2])
    return OpenLoop(
        models=models,
        errors=errors,
        noise_squares=np.array([np.sum(run**2, axis=0) for run in cut(noisy - states[0])]),
        ended=np.array(lengths) < samples,
        recoverable_lean=limit,
        sample_time=log.sample_time,
        example=Trajectories.beside(log, int(starts[middle]), states[:, middle, : lengths[middle]]),
    )


def _largest_lean(states: Floats) -> Floats:
    return np.abs(states[..., 2:4]).max(axis=-1)
