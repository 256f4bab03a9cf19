"""Logs that were checked: what an analysis takes, so that the checks of a log run once and before any work."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from ballbot.findings import (
    Finding,
    as_argument,
    by_severity,
    check_codes,
    in_check_log,
    stop_on_errors,
)
from ballbot.log.checks import check, check_logs
from ballbot.log.log import Log
from ballbot.robot import Robot
from ballbot.robot.plausibility import named_robot_findings

#: what concerns a robot that balances: columns that it needs, and a law that holds below the torque limit
_OF_BALANCING = ("use", "saturation")


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedLogs:
    """Logs whose checks are done and whose errors, if any, the user accepted; made by `checked_logs`."""

    logs: Mapping[str, Log]  #: by the names that messages use
    findings: tuple[Finding, ...]  #: of all logs, errors first

    @classmethod
    def simulated(cls, log: Log) -> CheckedLogs:
        """Return a log that Ballbot itself has just simulated, which needs no checks."""
        return cls(logs={"": log}, findings=())

    def with_logs(self, logs: Mapping[str, Log]) -> CheckedLogs:
        """Return the findings with logs that were made from the checked ones, as without some of their rows."""
        return replace(self, logs=logs)


def checked_logs(
    robot: Robot | None,
    logs: Log | Sequence[Log] | Mapping[str, Log] | CheckedLogs,
    *,
    accept: Collection[str] = (),
    going_on: Callable[[Sequence[str]], str] = as_argument,
    more: Callable[[Finding], str] = in_check_log,
) -> CheckedLogs:
    """Check logs, unless they are checked, and stop on an error that is not accepted.

    Parameters
    ----------
    robot : Robot, optional
        Whose logs they are. Without it, only what needs no robot is checked.
    logs : Log, sequence or mapping of Log, or CheckedLogs
        A mapping's keys are the names in messages; the logs of a sequence are called log 1, log 2, ...
    accept : collection of str
        Codes of errors to go on in spite of; see `ballbot.findings.CODES`.
    going_on, more : callable
        See `ballbot.findings.stop_on_errors`.

    Raises
    ------
    InputError
        If the robot or a log has an error whose code is not accepted, or a code is unknown.
    """
    codes = check_codes(accept)
    if isinstance(logs, CheckedLogs):
        return logs
    named = _named(logs)
    findings = _with_robot(robot, named) if robot else _without_robot(named)
    stop_on_errors(findings, accept=codes, going_on=going_on, more=more)
    return CheckedLogs(logs=named, findings=findings)


def bench_findings(robot: Robot, logs: Mapping[str, Log]) -> tuple[Finding, ...]:
    """Return what is wrong with a robot and with logs of it on a bench, where it does not balance.

    Parameters
    ----------
    robot : Robot
    logs : mapping of str to Log
        By the names that messages use.
    """
    of_logs = (one for one in _without_robot(logs) if one.code not in _OF_BALANCING)
    return by_severity([*named_robot_findings(robot), *of_logs])


def _named(logs: Log | Sequence[Log] | Mapping[str, Log]) -> Mapping[str, Log]:
    if isinstance(logs, Log):
        return {"": logs}
    if isinstance(logs, Mapping):
        return logs
    if len(logs) == 1:
        return {"": logs[0]}
    return {f"log {number}": log for number, log in enumerate(logs, start=1)}


def _with_robot(robot: Robot, named: Mapping[str, Log]) -> tuple[Finding, ...]:
    return by_severity([*named_robot_findings(robot), *check_logs(named, robot=robot)])


def _without_robot(named: Mapping[str, Log]) -> tuple[Finding, ...]:
    return by_severity(
        replace(finding, where=replace(finding.where, file=name))
        for name, log in named.items()
        for finding in check(log)
    )
