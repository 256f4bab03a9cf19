"""How commands print findings, stop on errors, and let `--accept CODE` continue."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ballbot.cli.context import changed_robot
from ballbot.cli.output import notice
from ballbot.findings import Finding, by_severity, check_codes, stop_on_errors
from ballbot.report.blocks import finding_line
from ballbot.robot import Robot
from ballbot.robot.plausibility import robot_findings

if TYPE_CHECKING:
    from ballbot.log import Log


def check_input(
    robot: Robot | None,  # the robot of the logs
    # paths and logs: the files, and the log in each
    paths: Iterable[Path],
    logs: Iterable[Log],
    *,
    accept: Sequence[str] | None,  # the codes of `--accept`
    # whether to print the findings; if not, the command calls `show_findings` when it has printed its result
    show: bool = True,
) -> tuple[Finding, ...]:
    """Check the logs of a command, print accepted errors and warnings, and return all findings.

    Raise InputError if a log has an error whose code is not accepted, or if a code is unknown.
    """
    from ballbot.log.checks import findings_of

    check_codes(accept or ())
    named = {str(path): log for path, log in zip(paths, logs, strict=True)}
    return stop_or_show(findings_of(robot, named), accept=accept, others="`ballbot check-log`", show=show)


def checked_robot(
    source: str, changes: Sequence[str] | None, *, accept: Sequence[str] | None
) -> tuple[Robot, tuple[Finding, ...]]:
    """Return a robot and the findings of the check of its values; see `changed_robot`.

    Print accepted errors and warnings. Raise InputError if there is another error, or if a code is unknown.
    """
    robot = changed_robot(source, changes)
    findings = robot_findings(robot, file=f"robot {robot.name}")
    return robot, stop_or_show(findings, accept=accept, others="`ballbot check`")


def in_files(named: Iterable[tuple[Path, Iterable[Finding]]]) -> list[Finding]:
    """Return findings on files with the file of each as its location."""
    return [
        replace(finding, where=replace(finding.where, file=str(path)))
        for path, findings in named
        for finding in findings
    ]


def stop_or_show(
    findings: Iterable[Finding], *, accept: Sequence[str] | None, others: str = "", show: bool = True
) -> tuple[Finding, ...]:
    """Stop on an error that is not accepted; else print accepted errors and warnings, if `show`.

    `others` is the command that shows the other errors; without it, they are printed here. Return the findings, errors
    first. Raise InputError on such an error, or if a code is unknown.
    """
    accepted, findings = check_codes(accept or ()), by_severity(findings)
    errors = [finding for finding in findings if finding.severity == "error" and finding.code not in accepted]
    if not others:
        show_findings(errors[1:], accept=accepted)
    stop_on_errors(errors, others=others or "above")
    if show:
        show_findings(findings)
    return findings


def show_findings(
    findings: Collection[Finding],
    *,
    # codes of errors that the user has accepted; all of them if not given
    accept: Collection[str] | None = None,
) -> None:
    """Print errors and warnings, a line each; notes are in the report only."""
    for finding in findings:
        if finding.severity != "note":
            notice(finding_line(finding, accepted=accept is None or finding.code in accept))
