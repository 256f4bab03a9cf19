"""The result of a validation and its findings: which of two models predicts a state better, and why if neither does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ballbot.findings import Finding, note, warning
from ballbot.fitting.comparison import verdicts
from ballbot.log import STATE_NAMES
from ballbot.summary import Summary, counted, plotted, summarized, written_results
from ballbot.validation.closed_loop import ClosedLoop, RecoveredGain
from ballbot.validation.models import ErrorPair, ModelPair
from ballbot.validation.open_loop import OpenLoop
from ballbot.validation.prediction import HorizonComparison, Prediction
from ballbot.validation.residuals import ResidualAnalysis, residual_findings
from ballbot.validation.whole_log import RUNS, WholeLog

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class Validation:
    """How well two models predict a log; by default a robot's model with its friction and without any."""

    models: ModelPair
    open_loop: OpenLoop | None  #: None if the log does not allow it; `no_open_loop` says why
    no_open_loop: str | None
    closed_loop: ClosedLoop | None  #: None if the log does not allow it; `no_closed_loop` says why
    no_closed_loop: str | None
    prediction: Prediction
    residuals: ResidualAnalysis  #: of the first model
    horizon: HorizonComparison
    recovered: RecoveredGain | None  #: the log's own gain, where no controller was given
    duration: float  #: of the stretches compared [s]
    sample_time: float  #: of the log [s]
    log_findings: tuple[Finding, ...] = ()  #: of the checks of the log
    no_evidence: str | None = None  #: why the logs cannot show which model is better, if they cannot
    left_out: tuple[str, ...] = ()  #: why logs that cannot are not among those compared

    def summary(self) -> Summary:
        """Return the verdict on each kind of prediction, and each state's ratio of errors in open loop."""
        first, second = self.models.names
        title, rows = f"Validation of the model {first} on {self.duration:.3g} s", []
        if self.no_evidence is not None:
            return Summary(title=title, rows=(), sentences=(self.no_evidence,))
        if self.open_loop is not None:
            title += f": open-loop error {second} over error {first} (above 1, the model {first} is better)"
            errors = self.open_loop.errors
            lower, upper = errors.ratio_interval()
            for place, (name, verdict) in enumerate(zip(STATE_NAMES, errors.verdicts(), strict=True)):
                interval = f" (95 % interval {lower[place]:.3g} to {upper[place]:.3g}): {verdict}"
                known = np.isfinite(lower[place])
                rows.append((name, f"{errors.ratio[place]:.3g}{interval if known else ' (too few runs)'}"))
        sentences = [] if rows else [_open_loop_verdict(self)]
        if self.closed_loop is not None:
            sentences.append(_closed_loop_verdict(self))
        elif self.no_closed_loop is not None:
            sentences.append(f"No closed-loop validation: {self.no_closed_loop}")
        sentences = (*self.left_out, *sentences, _horizon_verdict(self))
        return Summary(title=title, rows=tuple(rows), sentences=sentences)

    def plot(self) -> Figure:
        """Return a figure of how the errors of both models grow with the horizon of a prediction."""
        return plotted(self)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds of it."""
        return written_results(self)


#: a state's error is put down to the noise of its start from this share on
_NOISE_SHARE = 0.7
#: a model that falls at less than this times another's rate falls more slowly
_SLOWER = 0.95


def findings(validation: Validation) -> tuple[Finding, ...]:
    """Return the findings, the verdict first."""
    residuals = () if validation.no_evidence else residual_findings(validation.residuals)
    return (*model_findings(validation), *residuals)


def model_findings(validation: Validation) -> tuple[Finding, ...]:
    """Return the findings without those on the residuals."""
    if validation.no_evidence is not None:
        return (warning("no-evidence", validation.no_evidence),)
    found = [note("open-loop", _open_loop_verdict(validation)), *weak_states(validation)]
    found += [warning("no-evidence", sentence) for sentence in validation.left_out]
    if validation.closed_loop is not None:
        found.append(note("closed-loop", _closed_loop_verdict(validation)))
    elif validation.no_closed_loop is not None:
        found.append(note("closed-loop", f"No closed-loop validation: {validation.no_closed_loop}"))
    return (*found, note("horizon", _horizon_verdict(validation)))


def weak_states(validation: Validation) -> tuple[Finding, ...]:
    """Return a finding for each state that the first model does not surely predict better in open loop, and why.

    "Surely" is the 95 % bootstrap interval of the ratio of errors lying wholly above one. Without an open loop, or with
    too few runs for an interval, single states get no verdict.
    """
    if validation.open_loop is None:
        return ()
    errors = validation.open_loop.errors
    lower, upper = errors.ratio_interval()
    if not np.isfinite(lower).any():
        return ()
    first, second = validation.models.names
    claims = {
        "worse": f"the model {first} is worse than the one {second} in open loop",
        "undecided": f"the model {first} is not significantly better than the one {second} in open loop",
    }
    sentences = []
    for index, (name, verdict) in enumerate(zip(STATE_NAMES, errors.verdicts(), strict=True)):
        if verdict == "better":
            continue
        numbers = f"ratio {errors.ratio[index]:.2f}, 95 % interval {lower[index]:.2f} to {upper[index]:.2f}"
        sentences.append(f"{name}: {claims[verdict]} ({numbers}). {_reason(validation, index)}")
    return tuple(note("weak-state", sentence) for sentence in sentences)


def better_in(errors: ErrorPair, models: ModelPair) -> str:
    """Return in how many states the first model is better, by the whole interval, and by which factors."""
    first, second = models.names
    if not np.isfinite(errors.ratio_interval()).any():
        few = f"{counted(errors.runs, 'run')} {'is' if errors.runs == 1 else 'are'} too few"
        return f"{few} to show which model is better"
    surely = [place for place, verdict in enumerate(errors.verdicts()) if verdict == "better"]
    worse = [STATE_NAMES[place] for place, verdict in enumerate(errors.verdicts()) if verdict == "worse"]
    if not surely:
        better = f"the model {first} is better than the one {second} in none of the ten states"
    else:
        ratio = errors.ratio[surely]
        names = [STATE_NAMES[surely[int(place(ratio))]] for place in (np.argmin, np.argmax)]
        count = (
            "every one of the ten states"
            if len(surely) == len(STATE_NAMES)
            else f"{len(surely)} of the ten states"
        )
        sizes = f"{ratio.min():.1f} times ({names[0]}) to {ratio.max():.1f} times ({names[1]}) smaller"
        if len(surely) == 1:
            sizes = f"{ratio[0]:.1f} times smaller ({names[0]})"
        better = f"the model {first} is better than the one {second} in {count}, its error {sizes}"
    return better + (f", and worse in {', '.join(worse)}" if worse else "")


def _reason(validation: Validation, index: int) -> str:
    """Return the reason that the data show for a state that the first model does not predict better."""
    loop = validation.open_loop
    assert loop is not None
    if loop.errors.unresolved[index]:
        return "Reason: the errors of both models are below what any sensor of a robot resolves."
    share = loop.noise_floor[index] / loop.errors.first.rmse[index]
    first, second = validation.models.both
    falls = [float(model.linearize().poles()[0].real) for model in (first, second)]
    if share > _NOISE_SHARE and loop.errors.verdicts()[index] == "worse" and falls[1] < _SLOWER * falls[0]:
        return (
            f"Reason: the noise of the measured start alone causes {100 * share:.0f} % of the "
            f"error, and the other model falls more slowly ({falls[1]:.1f} against "
            f"{falls[0]:.1f} rad/s), so it amplifies this noise less, whichever model is right."
        )
    if share > _NOISE_SHARE:
        return (
            f"Reason: the noise of the measured start alone causes {100 * share:.0f} "
            "% of the error, so this state cannot show which model is better."
        )
    if loop.errors.verdicts()[index] == "undecided":
        return f"Reason: the {loop.errors.runs} runs vary too much to decide."
    return (
        f"No reason was found in the data: the noise of the start causes {100 * share:.0f} "
        "% of the error, so the model itself lacks something for this state."
    )


def _open_loop_verdict(validation: Validation) -> str:
    loop = validation.open_loop
    if loop is None:
        return f"No open-loop validation: {validation.no_open_loop}"
    length = float(loop.errors.first.samples.mean()) * validation.sample_time
    runs = counted(loop.errors.runs, "run")
    return (
        f"Open loop, {runs} of {length:.2g} s on average ({100 * loop.past_recovery:.0f} % of them "
        f"ended by a lean past recovery, {np.degrees(loop.recoverable_lean):.0f} degrees): "
        f"{better_in(loop.errors, validation.models)}."
    )


def _closed_loop_verdict(validation: Validation) -> str:
    closed = validation.closed_loop
    assert closed is not None
    restarted = closed.restarted
    runs = f"restarted every {closed.restart_every:.2g} s ({counted(restarted.runs, 'run')})"
    verdict = f"Closed loop, {runs}: {better_in(restarted, validation.models)}."
    return " ".join([verdict, *(whole_log_verdict(one, validation.models) for one in closed.whole)])


def whole_log_verdict(whole: WholeLog, models: ModelPair) -> str:
    """Return in how many states a log's numbers lie within those of each model's runs, and how many runs fell."""
    inside = (whole.places == 0).sum(axis=-1)
    counts = [f"{rms}, {amplitude} and {period}" for rms, amplitude, period in inside.tolist()]
    verdict = (
        f"Over {whole.duration:.3g} s without a restart, RMS, amplitude and period of the log's deviations from the "
        f"reference lie within the 95 % range of {RUNS} runs of the model {models.first.name} in {counts[0]} of the "
        f"ten states, and of the model {models.second.name} in {counts[1]}; the medians of the model "
        f"{models.first.name} are nearer to the log in {whole.nearer[0]} of these 30 numbers."
    )
    fell = [
        f" {count} of the {RUNS} runs of the model {name} end early."
        for count, name in zip(whole.fell, models.names, strict=True)
        if count
    ]
    return "".join([verdict, *fell])


def _horizon_verdict(validation: Validation) -> str:
    horizon, first = validation.horizon.errors, validation.models.first.name
    intervals = horizon.ratio_interval()
    if not np.isfinite(intervals).any():
        return f"{horizon.starts} forecasts are too few to show how the error grows with the horizon."
    better = [verdicts(interval).count("better") for interval in intervals.swapaxes(0, 1)]
    ahead, ratio = 1e3 * horizon.horizons, np.median(horizon.ratio, axis=1)
    most = np.flatnonzero(np.array(better) > len(STATE_NAMES) // 2)
    words = [f"{ahead[0]:.0f} ms ahead the model {first} is better in {better[0]} of the ten states"]
    words[0] += f" (median ratio {ratio[0]:.2f})"
    if most.size and 0 < most[0] < len(ahead) - 1:
        words.append(f"from {ahead[most[0]]:.0f} ms on in most")
    words.append(f"{ahead[-1]:.0f} ms ahead in {better[-1]} (median ratio {ratio[-1]:.1f})")
    return ", ".join(words) + "."
