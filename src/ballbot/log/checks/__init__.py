"""Checks of a log: its faults, their likely causes, and the uses that it permits.

table            the sentence and the limits of each statistic
values           what columns show: gaps, spikes, jumps, limits, dead, frozen, slow or copied columns, falls
rates            positions, angles and gyro against rates: units, signs, swapped columns, the unit of time
stuck_encoders   encoders that hold their angle while their wheels turn
kinematics       wheel columns against the states
lean             lean axes against the ball's acceleration
physics          the lean axes, then delay, order, sign and scale of the torques; several logs against each other

`check` gives the findings of one log, `check_logs` those of several logs of a robot, and `checked_logs` the input of
an analysis: logs whose checks ran once, before any computation, and whose errors, if any, the user accepted. Findings
that follow from another one are left out.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ballbot.findings import Finding, as_argument, by_severity, check_codes, stop_on_errors
from ballbot.log.checks.kinematics import check_disturbance, check_sampling, check_wheels
from ballbot.log.checks.rates import check_gyro, check_rates
from ballbot.log.checks.stuck_encoders import check_stuck_encoders
from ballbot.log.checks.table import judged
from ballbot.log.checks.values import (
    check_constant,
    check_held,
    check_jitter,
    check_lean,
    check_log_copies,
    check_missing_values,
    check_names,
    check_rows,
    check_stuck,
)
from ballbot.log.collection import LogsLike, as_logs
from ballbot.log.columns import MAX_WHEELS, STATE_NAMES, missing_words, torque_names, wheel_speed_names
from ballbot.log.fingerprints import refuse_copies
from ballbot.log.log import Log
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.plausibility import robot_findings

if TYPE_CHECKING:
    from ballbot.log.checks.physics import PhysicsOfLog

#: findings that a fault causes in other checks: its codes, theirs, and whether only on the fault's columns
_FOLLOWS = (
    (("stuck", "dead-motor", "copied"), ("torque-",), True),
    # a robot with a motor that fails leans for long, and runs away
    (("dead-motor", "torque-order", "torque-scale", "torque-sign"), ("lean-offset",), False),
    (("lean-axes",), ("sign", "swapped"), True),
    (("degrees",), ("lean-scale",), True),
    # a scaled velocity of the ball, which both checks use
    (("lean-scale",), ("wheels",), False),
    # the ball's axes are wrong, or its path comes from wrong wheels
    (("ball-axes", "heading-sign", "encoders"), ("lean-", "torque-", "physics"), False),
)


def _causes(findings: Sequence[Finding]) -> list[Finding]:
    """Return findings without those that follow from others."""
    kept = list(findings)
    for causes, followers, beside in _FOLLOWS:
        columns = [{*finding.where.columns} for finding in kept if finding.code in causes]
        kept = [
            finding
            for finding in kept
            if not finding.code.startswith(followers)
            or all(beside and own.isdisjoint(finding.where.columns) for own in columns)
        ]
    return kept


def check(log: Log, *, robot: Robot | None = None) -> tuple[Finding, ...]:
    """Return the findings of all checks of a log, errors first; see `check_logs`.

    >>> t = 0.005 * np.arange(400)
    >>> log = Log({"t": t, "theta": 0.05 * np.sin(3.0 * t), "theta_dot": -0.15 * np.cos(3.0 * t)})
    >>> [finding.code for finding in check(log) if finding.severity == "error"]
    ['sign']
    """
    return check_logs({"": log}, robot=robot)


def _log_findings(log: Log, robot: Robot | None, of_physics: Sequence[Finding]) -> tuple[Finding, ...]:
    of_wheels = [{f"u{i}", f"wheel{i}", f"wheel{i}_dot"} for i in range(1, MAX_WHEELS + 1)]
    numbers = [number for number, names in enumerate(of_wheels, start=1) if names & set(log.names)]
    wheel_count = robot.wheel_count if robot else max(numbers, default=3)
    of_columns = (
        check_jitter, check_missing_values, check_rates, check_gyro, check_lean, check_constant, check_log_copies,
        check_stuck, check_held, check_names,
    )  # fmt: skip
    findings = [*log.changes, *check_rows(log, robot), *(item for find in of_columns for item in find(log))]
    findings += [*check_uses(log, wheel_count=wheel_count), *judged("rows", [], 2.0 - len(log))]
    # in another unit of time no motion can be checked
    if not any(item.code == "time-scale" for item in findings):
        findings += [*check_stuck_encoders(log, wheel_count=wheel_count), *of_physics]
        findings += [*check_sampling(log, robot), *check_wheels(log, robot)] if robot else []
    findings = _causes(findings)
    # an error would explain a disturbance, and this check takes the longest
    if robot and not any(item.severity == "error" for item in findings):
        findings += check_disturbance(log, robot)
    return by_severity(findings)


def check_logs(logs: Mapping[str, Log], *, robot: Robot | None) -> tuple[Finding, ...]:
    """Return the findings of a robot's logs by the names of messages, errors first, each with the log that it is about.

    Without a robot only the checks that need none are made.
    """
    examined: dict[str, PhysicsOfLog] = {}
    findings, of_all = list[Finding](), list[Finding]()
    if robot is not None:
        # importing the equations of motion takes time
        from ballbot.log.checks.physics import different_robots, examine

        examined = {name: examine(log, robot) for name, log in logs.items()}
        of_all = different_robots(examined)
    for name, log in logs.items():
        of_log = _log_findings(log, robot, examined[name].findings if robot else ())
        findings += [replace(item, where=replace(item.where, file=name)) for item in of_log]
    return by_severity([*findings, *of_all])


#: uses of a log
BALANCING = "identification and validation of the balancing robot"
DRIVELINES = "identification of drivelines"


def missing_columns(log: Log, *, wheel_count: int) -> dict[str, list[str]]:
    """Return, for each use of a log, the columns that it lacks; an empty list if it permits the use."""
    torques, speeds = torque_names(wheel_count), wheel_speed_names(wheel_count)
    needed = {
        BALANCING: ("t", *torques, *STATE_NAMES),
        "closed-loop validation": ("t", *torques, *STATE_NAMES, "ref_x", "ref_y", "ref_psi"),
        DRIVELINES: ("t", *torques, *speeds),
        "the on-board state": ("t", *speeds, "gyro_x", "gyro_y", "gyro_z", "theta", "phi", "psi"),
    }
    return {use: [name for name in names if name not in log] for use, names in needed.items()}


def check_uses(log: Log, *, wheel_count: int) -> list[Finding]:
    """Return a note for each use that the log lacks columns for."""
    return [
        item
        for use, missing in missing_columns(log, wheel_count=wheel_count).items()
        for item in judged("use", missing, len(missing), use=use, columns=missing_words(missing, log.names))
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedLogs:
    """Logs that were checked and whose errors, if any, the user accepted; see `checked_logs`."""

    logs: Mapping[str, Log]  #: by the names that messages use
    findings: tuple[Finding, ...]  #: of all logs, errors first


def findings_of(robot: Robot | None, logs: Mapping[str, Log]) -> tuple[Finding, ...]:
    """Return the findings on logs, by name, and on their robot; errors first.

    InputError if two logs are of the same run.
    """
    refuse_copies(logs)
    of_robot = () if robot is None else robot_findings(robot, file=f"robot {robot.name}")
    return by_severity([*of_robot, *check_logs(logs, robot=robot)])


def checked_logs(
    robot: RobotLike | None, logs: LogsLike | CheckedLogs, *, accept: Collection[str] = ()
) -> CheckedLogs:
    """Check logs, unless they are checked, and stop on an error whose code (`ballbot.findings.CODES`) is not accepted.

    Without a robot, only the checks without one run. See `ballbot.log.as_logs` for the names of logs in messages.
    InputError also if two logs are of the same run, or a code is unknown.
    """
    codes = check_codes(accept)
    if isinstance(logs, CheckedLogs):
        return logs
    named = as_logs(logs)
    findings = findings_of(None if robot is None else as_robot(robot), named)
    stop_on_errors(findings, accept=codes, going_on=as_argument)
    return CheckedLogs(logs=named, findings=findings)


def bench_findings(robot: Robot, logs: Mapping[str, Log]) -> tuple[Finding, ...]:
    """Return the findings of a robot and of its logs, by their names, on a bench, on which it does not balance."""
    # these codes concern a balancing robot
    of_logs = (item for item in check_logs(logs, robot=None) if item.code not in ("use", "saturation"))
    return by_severity([*robot_findings(robot, file=f"robot {robot.name}"), *of_logs])


__all__ = ["CheckedLogs", "bench_findings", "check", "check_logs", "checked_logs"]
