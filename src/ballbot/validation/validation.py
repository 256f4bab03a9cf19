"""Validate two models against logs: the validations of the thesis's chapter 4, listed in `ballbot.validation.ways`.

If a model predicts all ten states of the next row to `FINEST`, it simulated the log itself: no robot follows its model
so exactly. Such a log says nothing about either model, and neither does a log that does not move.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from ballbot.control.interface import Feedback
from ballbot.control.source import ControllerLike, as_controller
from ballbot.errors import about
from ballbot.findings import Finding, by_severity, warning
from ballbot.fitting.run import DEFAULT_RUN, Run, Threads
from ballbot.identification.rollers import as_its_friction
from ballbot.log import STATE_NAMES, Log, LogsLike
from ballbot.log.checks import checked_logs
from ballbot.log.checks.kinematics import check_disturbance
from ballbot.log.columns import torque_names
from ballbot.log.fingerprints import logs_among
from ballbot.progress import Progress
from ballbot.robot import RobotLike, as_robot
from ballbot.validation.models import FINEST, Case, Interval, ModelPair, model_of, stretches
from ballbot.validation.result import Validation
from ballbot.validation.ways import VALIDATIONS


def validate(
    robot: RobotLike,
    logs: LogsLike,
    *,
    accept: Collection[str] = (),
    controller: ControllerLike | None = None,
    run: Run = DEFAULT_RUN,
) -> Validation:
    """Validate a robot's model, with its friction and without, against logs in three ways; see `validate_pair`.

    Parameters
    ----------
    robot : Robot, preset or robot file
        With the friction.
    logs : Log or log file, several in a list or a mapping
        They are checked first, and the validations of several are joined (`join_validations`).
    accept : collection of str
        Codes of errors in the logs that are accepted (`ballbot.findings.CODES`).
    controller : Controller, "nominal", "precise" or a file, optional
        The one that drove the robot: with it the closed loop is simulated.
    run : Run, optional
        Seed, threads and progress.

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        If the robot has no friction, the checks find an error whose code is not accepted, and as `validate_pair`.

    Examples
    --------
    A log of a robot on which the model's friction acts, without noise:

    >>> from ballbot import simulate
    >>> from ballbot.twin.scenario import assumed_friction
    >>> robot = as_robot("alten").replace(friction=assumed_friction("alten"))
    >>> log = simulate(robot, "nominal", "circle", duration=12.0)
    >>> sorted(validate(robot, log).comparisons)
    ['horizon', 'prediction']
    """
    robot = as_robot(robot)
    models = ModelPair.by_friction(model_of(robot))
    driver = None if controller is None else as_controller(controller, robot)
    checked = checked_logs(robot, logs, accept=accept)
    parts = validate_logs(models, checked.logs, controller=driver, run=run)
    log_findings = (*fitted_findings(models, checked.logs), *checked.findings)
    return replace(join_validations(list(parts.values())), log_findings=log_findings)


def fitted_findings(models: ModelPair, logs: Mapping[str, Log]) -> tuple[Finding, ...]:
    """Return a warning for each log that one of the models was identified from."""
    rows = {row for model in models.both for row in model.robot.identified_from}
    text = (
        " is one that the model was identified from: its errors show how well the model fits, not how well it "
        "predicts. Validate on another log."
    )
    return tuple(warning("fitted-log", (name or "The log") + text) for name in logs_among(logs, rows))


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
        The controller that recorded the log. Without it, the gain of u = K S(psi) (r - x) is recovered from the log; if
        that fails, there is no closed-loop validation.
    holdout : sequence of (start, end), optional
        Intervals [s] of the log that the models were not fitted to; only these are compared. By default the whole log.
    run : Run, optional
        Its seed determines the noise of the noise floors and of the runs over whole logs; progress is reported before
        each stage.

    Raises
    ------
    InputError
        If the log lacks a column, is of another robot, or was recorded by another controller than the given one.
    """
    references = [name for name in ("ref_x", "ref_y", "ref_psi") if name in log]
    log = log.complete(*STATE_NAMES, *torque_names(models.first.model.robot.wheel_count), *references)
    case = Case(models=models, log=log, parts=stretches(log, holdout), controller=controller, seed=run.seed)
    robot = models.first.model.robot
    of_points = replace(case, log=as_its_friction(log, robot))
    nothing_shown = no_evidence(case)
    disturbed = next((finding.text for finding in check_disturbance(log, robot)), None)
    comparisons, refused = {}, {}
    for done, way in enumerate(VALIDATIONS):
        run.progress(Progress(stage=way.heading.lower(), done=done, total=len(VALIDATIONS)))
        comparison = (way.undisturbed and (nothing_shown or disturbed)) or way.compare(
            case if way.as_logged else of_points
        )
        (refused if isinstance(comparison, str) else comparisons)[way.key] = comparison
    return Validation(
        models=models,
        comparisons=comparisons,
        refused=refused,
        duration=sum(len(part) for part in case.parts) * log.sample_time,
        no_evidence=nothing_shown,
    )


def validate_logs(
    models: ModelPair,
    logs: Mapping[str, Log],
    *,
    controller: Feedback | None = None,
    holdouts: Mapping[str, Sequence[Interval]] | None = None,
    run: Run = DEFAULT_RUN,
) -> dict[str, Validation]:
    """Return the validation on each log by its name, computed in parallel; as `validate_pair`, with the log in errors.

    `holdouts` has the intervals of each log that are compared.
    """
    stages = count(1)

    def report(now: Progress) -> None:
        stage = "validating" if len(logs) > 1 else now.stage
        run.progress(Progress(stage=stage, done=next(stages), total=len(logs) * len(VALIDATIONS)))

    def validated(holdouts: Mapping[str, Sequence[Interval]], name: str) -> Validation:
        own, held = replace(run, progress=report), holdouts.get(name)
        with about(name):
            part = validate_pair(models, logs[name], controller=controller, holdout=held, run=own)
        named = len(logs) > 1 and part.no_evidence
        return replace(part, no_evidence=f"{name}: {part.no_evidence}") if named else part

    return dict(zip(logs, Threads()(validated, holdouts or {}, list(logs)), strict=True))


def join_validations(parts: Sequence[Validation]) -> Validation:
    """Return the validations of several logs as one, over the runs of all logs that can show which model is better.

    Example runs and the recovered gain are those of the first log that has them. Logs that show nothing are left out,
    and `Validation.left_out` has the reasons, unless all of them show nothing.
    """
    if len(parts) == 1:
        return parts[0]
    shown = [part for part in parts if part.no_evidence is None]
    reasons = tuple(part.no_evidence for part in parts if part.no_evidence)
    if not shown:
        return replace(parts[0], no_evidence=" ".join(dict.fromkeys(reasons)))
    if reasons:
        return replace(join_validations(shown), left_out=reasons)
    comparisons = {}
    for way in VALIDATIONS:
        if results := [part.comparisons[way.key] for part in parts if way.key in part.comparisons]:
            comparisons[way.key] = type(results[0]).join(results)
    return replace(
        parts[0],
        comparisons=comparisons,
        refused={key: why for key, why in parts[0].refused.items() if key not in comparisons},
        duration=sum(part.duration for part in parts),
        log_findings=by_severity(finding for part in parts for finding in part.log_findings),
    )


def no_evidence(case: Case) -> str | None:
    """Return why a log cannot show which model is better, if a model predicts each row to rounding."""
    log, (starts, predicted) = case.log, case.steps
    size = np.maximum(1.0, np.abs(log.states).max(axis=0))
    errors = np.sqrt(np.mean((log.states[starts + 1] - predicted) ** 2, axis=1))
    exact = np.all(errors <= FINEST * size, axis=1).tolist()
    if not any(exact):
        return None
    states = np.concatenate([log.states[part.start : part.stop] for part in case.parts])
    if np.all(np.ptp(states, axis=0) <= FINEST * size):
        return "The log does not move, so it cannot show which model is better. Use a log in which the robot moves."
    if all(exact):
        return (
            "Both models predict this log to rounding, so it cannot show which is better. Use a "
            "log in which the robot moves more."
        )
    own = case.models.names[exact.index(True)]
    return (
        f"This log was simulated by the model {own} itself, which predicts it to rounding, so it cannot "
        "show which model is better. Use a log of the robot, or of the twin (`ballbot record`)."
    )
