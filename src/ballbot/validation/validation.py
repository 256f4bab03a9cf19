"""The three validations of the thesis's chapter 4 on a log: closed loop, open loop and prediction.

A model that predicts all ten states of the next row to `FINEST` simulated the log itself, because no robot follows its
model so far. Such a log shows nothing about the other model either, and neither does a log that does not move.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.control.source import ControllerLike, as_controller
from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity, warning
from ballbot.fitting.run import DEFAULT_RUN, Run, Threads
from ballbot.log import STATE_NAMES, Log, LogsLike
from ballbot.log.checks import checked_logs
from ballbot.log.checks.kinematics import check_disturbance
from ballbot.log.columns import Floats, torque_names
from ballbot.log.fingerprints import logs_among
from ballbot.mechanics.model import Model
from ballbot.progress import Progress
from ballbot.robot import RobotLike, as_robot
from ballbot.validation.closed_loop import (
    ClosedLoop,
    RecoveredGain,
    closed_loop,
    delay_of,
    recover_gain,
)
from ballbot.validation.models import FINEST, ErrorPair, Interval, ModelPair, check_wheels, joined, stretches
from ballbot.validation.open_loop import open_loop
from ballbot.validation.prediction import compare_horizons, join_horizons, predict
from ballbot.validation.residuals import analyse_residuals
from ballbot.validation.result import Validation


def validate(
    robot: RobotLike,
    logs: LogsLike,
    *,
    accept: Collection[str] = (),
    controller: ControllerLike | None = None,
    run: Run = DEFAULT_RUN,
) -> Validation:
    """Validate a robot's model, with its friction and without, against logs in three ways; see `validate_pair`.

    The logs are checked first, and the validations of several are joined (`join_validations`). `accept` has codes of
    errors found in the logs to go on in spite of (`ballbot.findings.CODES`); `controller` may be "nominal", "precise"
    or a file. InputError if the robot has no friction, the checks find an error whose code is not accepted, and as
    `validate_pair` does.
    """
    robot = as_robot(robot)
    models = ModelPair.by_friction(Model(robot))
    driver = None if controller is None else as_controller(controller, robot)
    checked = checked_logs(robot, logs, accept=accept)
    parts = validate_logs(models, checked.logs, controller=driver, run=run)
    found = (*fitted_findings(models, checked.logs), *checked.findings)
    return replace(join_validations(list(parts.values())), log_findings=found)


def fitted_findings(models: ModelPair, logs: Mapping[str, Log]) -> tuple[Finding, ...]:
    """Return a warning of each log that one of the models was identified from."""
    rows = {row for one in (models.first, models.second) for row in one.model.robot.identified_from}
    return tuple(
        warning(
            "fitted-log",
            f"{name or 'The log'} is one that the model was identified from: its errors show how well the model fits, "
            "not how well it predicts. Validate on another log.",
        )
        for name in logs_among(logs, rows)
    )


def validate_pair(
    models: ModelPair,
    log: Log,
    *,
    controller: Feedback | None = None,
    holdout: Sequence[Interval] | None = None,
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
    run : Run, optional
        Its seed is that of the noise drawn for the noise floors and for the runs over whole logs; its progress is
        reported before each stage.

    Raises
    ------
    InputError
        If the log lacks a column, is not of this robot, or was recorded by another controller than the one given.
    """
    references = [name for name in ("ref_x", "ref_y", "ref_psi") if name in log]
    log = log.complete(*STATE_NAMES, *torque_names(models.first.model.robot.wheel_count), *references)
    check_wheels(models.first.model, log)
    parts = stretches(log, holdout)
    _report(run, 0)
    prediction = predict(models, log, parts)
    covariance = prediction.start_covariance
    _report(run, 1)
    horizon = compare_horizons(models, log, parts, start_covariance=covariance, seed=run.seed)
    nothing_shown = no_evidence(models, log, parts, prediction.errors)
    disturbed = next((found.text for found in check_disturbance(log, models.first.model.robot)), None)
    refused = nothing_shown or disturbed
    _report(run, 2)
    recovered, closed, refusal = (
        (None, None, refused)
        if refused
        else _closed_loop(models, log, parts, controller, covariance, run.seed)
    )
    _report(run, 3)
    opened = None if refused else open_loop(models, log, parts, start_covariance=covariance, seed=run.seed)
    _report(run, 4)
    validation = Validation(
        models=models,
        open_loop=opened,
        no_open_loop=refused,
        closed_loop=closed,
        no_closed_loop=refusal,
        prediction=prediction,
        residuals=analyse_residuals(prediction, models.first.model),
        horizon=horizon,
        recovered=recovered,
        duration=sum(len(part) for part in parts) * log.sample_time,
        sample_time=log.sample_time,
        no_evidence=nothing_shown,
    )
    _report(run, 5)
    return validation


_STAGES = ("one step ahead", "horizons", "closed loop", "open loop", "residuals")


def _report(run: Run, done: int) -> None:
    run.progress(Progress(stage=_STAGES[min(done, len(_STAGES) - 1)], done=done, total=len(_STAGES)))


def validate_logs(
    models: ModelPair,
    logs: Mapping[str, Log],
    *,
    controller: Feedback | None = None,
    holdouts: Mapping[str, Sequence[Interval]] | None = None,
    run: Run = DEFAULT_RUN,
) -> dict[str, Validation]:
    """Return the validation on each log, side by side, by the logs' names; as `validate_pair`, an error naming its log.

    `holdouts` says what counts of each log.
    """
    stages = count(1)

    def report(now: Progress) -> None:
        stage = "validating" if len(logs) > 1 else now.stage
        run.progress(Progress(stage=stage, done=next(stages), total=len(logs) * (1 + len(_STAGES))))

    def validated(holdouts: Mapping[str, Sequence[Interval]], name: str) -> Validation:
        try:
            part = validate_pair(
                models,
                logs[name],
                controller=controller,
                holdout=holdouts.get(name),
                run=replace(run, progress=report),
            )
        except InputError as error:
            raise (InputError(f"{name}: {error}") if name else error) from None
        named = len(logs) > 1 and part.no_evidence
        return replace(part, no_evidence=f"{name}: {part.no_evidence}") if named else part

    return dict(zip(logs, Threads()(validated, holdouts or {}, list(logs)), strict=True))


def join_validations(parts: Sequence[Validation]) -> Validation:
    """Return the validations of several logs as one, over the runs of all that can show which model is better.

    Examples and the recovered gain are those of the first log that has them. The logs that cannot are left out, and
    `Validation.left_out` says why; if there are no others, none is.
    """
    if len(parts) == 1:
        return parts[0]
    shown = [part for part in parts if part.no_evidence is None]
    reasons = tuple(part.no_evidence for part in parts if part.no_evidence)
    if not shown:
        sentence = " ".join(dict.fromkeys(reasons))
        return replace(parts[0], no_evidence=sentence, no_open_loop=sentence, no_closed_loop=sentence)
    if reasons:
        return replace(join_validations(shown), left_out=reasons)
    opened = [part.open_loop for part in parts if part.open_loop is not None]
    closed = [part.closed_loop for part in parts if part.closed_loop is not None]
    prediction = joined([part.prediction for part in parts])
    first = parts[0]
    return replace(
        first,
        open_loop=joined(opened) if opened else None,
        no_open_loop=None if opened else first.no_open_loop,
        closed_loop=joined(closed) if closed else None,
        no_closed_loop=None if closed else first.no_closed_loop,
        prediction=prediction,
        residuals=analyse_residuals(prediction, first.models.first.model),
        horizon=join_horizons([part.horizon for part in parts]),
        recovered=next((part.recovered for part in parts if part.recovered), None),
        duration=sum(part.duration for part in parts),
        log_findings=by_severity(finding for part in parts for finding in part.log_findings),
    )


def _closed_loop(
    models: ModelPair,
    log: Log,
    parts: Sequence[range],
    controller: Feedback | None,
    covariance: Floats,
    seed: int,
) -> tuple[RecoveredGain | None, ClosedLoop | None, str | None]:
    """Return the recovered gain, the closed-loop validation, and the reason if it is missing."""
    recovered = None
    if controller is None:
        try:
            recovered = recover_gain(log)
        except InputError as error:
            return None, None, str(error)
        controller = Controller(
            models.first.model.robot,
            recovered.gain,
            sample_time=log.sample_time,
            torque_limit=recovered.torque_limit,
        )
    delay = delay_of(controller, log) if recovered is None else recovered.delay
    closed = closed_loop(models, log, parts, controller, covariance=covariance, delay=delay, seed=seed)
    return recovered, closed, None


def no_evidence(models: ModelPair, log: Log, parts: Sequence[range], one_step: ErrorPair) -> str | None:
    """Return why a log cannot show which model is better, if a model predicts each row to rounding."""
    size = np.maximum(1.0, np.abs(log.states).max(axis=0))
    exact = [bool(np.all(one.rmse <= FINEST * size)) for one in (one_step.first, one_step.second)]
    if not any(exact):
        return None
    states = np.concatenate([log.states[part.start : part.stop] for part in parts])
    if np.all(np.ptp(states, axis=0) <= FINEST * size):
        return "The log does not move, so it cannot show which model is better. Use a log in which the robot moves."
    if all(exact):
        return (
            "Both models predict this log to rounding, so it cannot show which is better. Use a "
            "log in which the robot moves more."
        )
    own = models.names[exact.index(True)]
    return (
        f"This log was simulated by the model {own} itself, which predicts it to rounding, so it cannot "
        "show which model is better. Use a log of the robot, or of the twin (`ballbot record`)."
    )
