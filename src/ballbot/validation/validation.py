"""The three validations of the thesis's chapter 4 on a log and their findings: closed loop, open loop and prediction.

A finding says which model predicts a state better, with an interval, and gives the reason if neither does.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity, note
from ballbot.fitting.comparison import verdicts
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks import checked_logs
from ballbot.log.checks.kinematics import check_disturbance
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.progress import Progress, part_of
from ballbot.robot import Robot
from ballbot.validation.closed_loop import (
    ClosedLoop,
    RecoveredGain,
    closed_loop,
    delay_of,
    join_closed_loops,
    recover_gain,
)
from ballbot.validation.models import ErrorPair, Interval, ModelPair, check_wheels, stretches
from ballbot.validation.open_loop import OpenLoop, join_open_loops, open_loop
from ballbot.validation.prediction import (
    HorizonComparison,
    Prediction,
    compare_horizons,
    join_horizons,
    join_predictions,
    predict,
)
from ballbot.validation.residuals import ResidualAnalysis, analyse_residuals, residual_findings
from ballbot.validation.statistics import find_updates
from ballbot.validation.wheel_effects import Dither, find_dither


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
    dither: Dither | None  #: None if the log lacks wheel speeds
    duration: float  #: of the stretches compared [s]
    sample_time: float  #: of the log [s]
    log_findings: tuple[Finding, ...] = ()  #: of the checks of the log


def validate(
    robot: Robot,
    log: Log,
    *,
    accept: Collection[str] = (),
    controller: Feedback | None = None,
    holdout: Sequence[Interval] | None = None,
    formulation: Formulation = "exact",
    restart_every: float = 4.0,
    longest: float = 2.0,
    run: Run = DEFAULT_RUN,
) -> Validation:
    """Validate a robot's model, with its friction and without, against a log in three ways; see `validate_pair`.

    Parameters
    ----------
    robot : Robot
        With the friction to validate; the second model is the same robot without friction.
    log : Log
        Checked first.
    accept : collection of str
        Codes of errors found in the log to go on in spite of; see `ballbot.findings.CODES`.
    controller : Feedback, optional
    holdout : sequence of (start, end), optional
    formulation : {"exact", "thesis"}
        Of the model.
    restart_every : float
    longest : float
    run : Run, optional
        As for `validate_pair`.

    Raises
    ------
    InputError
        If the robot has no friction, the checks of the log find an error whose code is not accepted, and as
        `validate_pair` does.
    """
    models = ModelPair.by_friction(Model(robot, formulation=formulation))
    checked = checked_logs(robot, log, accept=accept)
    validation = validate_pair(
        models,
        log,
        controller=controller,
        holdout=holdout,
        restart_every=restart_every,
        longest=longest,
        run=run,
    )
    return replace(validation, log_findings=checked.findings)


def validate_pair(
    models: ModelPair,
    log: Log,
    *,
    controller: Feedback | None = None,
    holdout: Sequence[Interval] | None = None,
    restart_every: float = 4.0,
    longest: float = 2.0,
    run: Run = DEFAULT_RUN,
) -> Validation:
    """Validate any two models against a log in three ways: closed loop, open loop and prediction.

    The log is not checked here; see `ballbot.log.checks.checked_logs`.

    Parameters
    ----------
    models : ModelPair
        Robots, formulations or frictions that differ.
    log : Log
        With torques and states; ref_x, ref_y, ref_psi for the closed loop.
    controller : Feedback, optional
        The one that recorded the log. Without it, the gain of u = K S(psi) (r - x) is recovered from the log, and
        where that fails there is no closed-loop validation.
    holdout : sequence of (start, end), optional
        Times [s] of the log that the models were not fitted to; only these count. Without it, the whole log does.
    restart_every : float
        Time from restart to restart in closed loop [s].
    longest : float
        Longest open-loop run [s].
    run : Run, optional
        Its seed is that of the noise drawn for the noise floors; its progress is reported before each stage.

    Raises
    ------
    InputError
        If the log lacks a column, is not of this robot, or was recorded by another controller than the one given.
    """
    for name, value in (("restart_every", restart_every), ("longest", longest)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} is {value:g} s; it must be a positive time in seconds.")
    log.require(*STATE_NAMES)
    # a heading kept within one turn would jump
    log = log.with_columns({"psi": np.unwrap(log["psi"])})
    check_wheels(models.first.model, log)
    parts = stretches(log, holdout)
    _report(run, 0)
    prediction = predict(models, log, parts)
    covariance = prediction.start_covariance
    disturbed = next((found.text for found in check_disturbance(log, models.first.model.robot)), None)
    _report(run, 1)
    recovered, closed, refusal = (
        (None, None, disturbed) if disturbed else _closed_loop(models, log, parts, controller, restart_every)
    )
    _report(run, 2)
    opened = (
        None
        if disturbed
        else open_loop(models, log, parts, start_covariance=covariance, longest=longest, seed=run.seed)
    )
    _report(run, 3)
    horizon = compare_horizons(models, log, parts, start_covariance=covariance, seed=run.seed)
    _report(run, 4)
    return Validation(
        models=models,
        open_loop=opened,
        no_open_loop=disturbed,
        closed_loop=closed,
        no_closed_loop=refusal,
        prediction=prediction,
        residuals=analyse_residuals(prediction, models.first.model, find_updates(log)),
        horizon=horizon,
        recovered=recovered,
        dither=find_dither(models.first.model, log),
        duration=sum(len(part) for part in parts) * log.sample_time,
        sample_time=log.sample_time,
    )


_STAGES = ("one step ahead", "closed loop", "open loop", "horizons", "residuals")


def _report(run: Run, done: int) -> None:
    run.progress(Progress(stage=_STAGES[done], done=done, total=len(_STAGES)))


def validate_logs(
    models: ModelPair,
    logs: Mapping[str, Log],
    *,
    controller: Feedback | None = None,
    run: Run = DEFAULT_RUN,
) -> dict[str, Validation]:
    """Return the validation on each log, by the logs' names; an error names its log.

    Parameters
    ----------
    models, controller, run
        As for `validate_pair`.
    logs : mapping of str to Log

    Raises
    ------
    InputError
        As `validate_pair`.
    """
    parts: dict[str, Validation] = {}
    for number, (name, log) in enumerate(logs.items()):
        stage = f"validating {name}"
        of_log = part_of(run.progress, number / len(logs), (number + 1) / len(logs), stage=stage)
        try:
            parts[name] = validate_pair(models, log, controller=controller, run=replace(run, progress=of_log))
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
    return parts


def join_validations(parts: Sequence[Validation]) -> Validation:
    """Return the validations of several logs as one, over the runs of all.

    Examples, the recovered gain, the dither and the update rates are those of the first log that has them.
    """
    if len(parts) == 1:
        return parts[0]
    opened = [part.open_loop for part in parts if part.open_loop is not None]
    closed = [part.closed_loop for part in parts if part.closed_loop is not None]
    prediction = join_predictions([part.prediction for part in parts])
    first = parts[0]
    return replace(
        first,
        open_loop=join_open_loops(opened) if opened else None,
        no_open_loop=None if opened else first.no_open_loop,
        closed_loop=join_closed_loops(closed) if closed else None,
        no_closed_loop=None if closed else first.no_closed_loop,
        prediction=prediction,
        residuals=analyse_residuals(prediction, first.models.first.model, first.residuals.updates),
        horizon=join_horizons([part.horizon for part in parts]),
        recovered=next((part.recovered for part in parts if part.recovered), None),
        dither=next((part.dither for part in parts if part.dither), None),
        duration=sum(part.duration for part in parts),
        log_findings=by_severity(finding for part in parts for finding in part.log_findings),
    )


def _closed_loop(
    models: ModelPair, log: Log, parts: Sequence[range], controller: Feedback | None, restart_every: float
) -> tuple[RecoveredGain | None, ClosedLoop | None, str | None]:
    """Return the recovered gain, the closed-loop validation, and the reason if it is missing."""
    if controller is not None:
        delay = delay_of(controller, log)
        return (
            None,
            closed_loop(models, log, parts, controller, delay=delay, restart_every=restart_every),
            None,
        )
    try:
        recovered = recover_gain(log)
    except InputError as error:
        return None, None, str(error)
    own = Controller(
        models.first.model.robot,
        recovered.gain,
        sample_time=log.sample_time,
        torque_limit=recovered.torque_limit,
    )
    closed = closed_loop(models, log, parts, own, delay=recovered.delay, restart_every=restart_every)
    return recovered, closed, None


#: a state's error is put down to the noise of its start from this share on
_NOISE_SHARE = 0.7
#: dither counts as fast from this share of the motion of turning on
_DITHER_SHARE = 0.5
#: reversals this many times as frequent as the motion's own are chatter
_CHATTER = 5.0
#: a model that falls at less than this times another's rate falls more slowly
_SLOWER = 0.95


def findings(validation: Validation) -> tuple[Finding, ...]:
    """Return the findings, the verdict first."""
    found = [note("open-loop", _open_loop_verdict(validation)), *weak_states(validation)]
    if validation.closed_loop is not None:
        found.append(note("closed-loop", _closed_loop_verdict(validation)))
    elif validation.no_closed_loop is not None:
        found.append(note("closed-loop", f"No closed-loop validation: {validation.no_closed_loop}"))
    found.append(note("horizon", _horizon_verdict(validation)))
    found.extend(residual_findings(validation.residuals))
    return tuple(found)


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
        return f"{errors.runs} runs are too few to show which model is better"
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


def describe_dither(validation: Validation) -> str | None:
    """Return the finding about the rollers' dither in the wheels' speeds, or None if the log has no wheel speeds."""
    dither = validation.dither
    if dither is None:
        return None
    v_s = validation.models.first.model.robot.friction.stribeck_speed
    fast, heading, reversals, slow_reversals = (
        float(values.mean())
        for values in (dither.dither, dither.heading, dither.reversals, dither.reversals_of_motion)
    )
    return (
        f"Above {dither.corner:.1f} Hz, faster than the robot can balance, the wheel speeds shake by "
        f"{fast:.3f} rad/s RMS ({dither.encoder:.3f} of it is encoder quantisation). Turning about the "
        f"vertical asks for {heading:.3f} rad/s, and the Stribeck speed is {v_s:.2f} rad/s. The wheels "
        f"reverse {reversals:.2f} times a second, {slow_reversals:.2f} times without the shaking."
    )


def _reason(validation: Validation, index: int) -> str:
    """Return the reason that the data show for a state that the first model does not predict better."""
    loop = validation.open_loop
    assert loop is not None
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
    dither = validation.dither if first.robot.friction != second.robot.friction else None
    if dither is not None and _chatters(dither):
        return f"Reason: the wheels chatter. {describe_dither(validation)}"
    if dither is not None and STATE_NAMES[index] in ("psi", "psi_dot") and _dithers(dither):
        return f"Reason: the rollers dither the wheels. {describe_dither(validation)}"
    if loop.errors.verdicts()[index] == "undecided":
        return f"Reason: the {loop.errors.runs} runs vary too much to decide."
    return (
        f"No reason was found in the data: the noise of the start causes {100 * share:.0f} "
        "% of the error, so the model itself lacks something for this state."
    )


def _dithers(dither: Dither) -> bool:
    real = np.sqrt(np.maximum(dither.dither**2 - dither.encoder**2, 0.0))
    return bool(np.mean(real) > _DITHER_SHARE * np.mean(dither.heading))


def _chatters(dither: Dither) -> bool:
    return bool(np.mean(dither.reversals) > _CHATTER * np.mean(dither.reversals_of_motion))


def _open_loop_verdict(validation: Validation) -> str:
    loop = validation.open_loop
    if loop is None:
        return f"No open-loop validation: {validation.no_open_loop}"
    length = float(loop.errors.first.samples.mean()) * validation.sample_time
    return (
        f"Open loop, {loop.errors.runs} runs of {length:.2g} s on average ({100 * loop.past_recovery:.0f} % of them "
        f"ended by a lean past recovery, {np.degrees(loop.recoverable_lean):.0f} degrees): "
        f"{better_in(loop.errors, validation.models)}."
    )


def _closed_loop_verdict(validation: Validation) -> str:
    closed = validation.closed_loop
    assert closed is not None
    restarted = closed.restarted
    runs = f"restarted every {closed.restart_every:.2g} s ({restarted.runs} runs)"
    verdict = f"Closed loop, {runs}: {better_in(restarted, validation.models)}."
    behind = [name for name, ratio in zip(STATE_NAMES, closed.whole.ratio, strict=True) if ratio <= 1.0]
    if behind:
        verdict += (
            " Over the whole log without a restart, models and robot get out of phase in "
            f"the limit cycle, and the error of the model {validation.models.first.name} "
            f"is not the smaller one in {', '.join(behind)}."
        )
    return verdict


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
