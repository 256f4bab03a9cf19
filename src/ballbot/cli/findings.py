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
    robot: Robot | None,  # whose logs they are
    # paths and logs: the files, and the log in each
    paths: Iterable[Path],
    logs: Iterable[Log],
    *,
    accept: Sequence[str] | None,  # what `--accept` gave
    mappings: Collection[Path | None] = (),  # the mapping files of the logs
    # whether to print the findings; if not, the command calls `show_findings` when it has printed its result
    show: bool = True,
) -> tuple[Finding, ...]:
    """Check the logs of a command, print accepted errors and warnings, and return all findings.

    InputError if a log has an error whose code is not accepted, or a code is unknown.
    """
    from ballbot.log.checks import findings_of
    from ballbot.log.mapping import dead_band_findings

    check_codes(accept or ())
    named = {str(path): log for path, log in zip(paths, logs, strict=True)}
    findings = [*findings_of(robot, named), *(dead_band_findings(dict.fromkeys(mappings)) if robot else ())]
    return stop_or_show(findings, accept=accept, others="`ballbot check-log`", show=show)


def checked_robot(
    source: str, changes: Sequence[str] | None, *, accept: Sequence[str] | None
) -> tuple[Robot, tuple[Finding, ...]]:
    """Return a robot and what the check of its numbers against one another finds; see `changed_robot`.

    Prints accepted errors and warnings. InputError if there is another error, or a code is unknown.
    """
    robot = changed_robot(source, changes)
    findings = robot_findings(robot, file=f"robot {robot.name}")
    return robot, stop_or_show(findings, accept=accept, others="`ballbot check`")


def in_file(path: Path, findings: Iterable[Finding]) -> list[Finding]:
    """Return findings with a file as their place."""
    return [replace(one, where=replace(one.where, file=str(path))) for one in findings]


def stop_or_show(
    findings: Iterable[Finding], *, accept: Sequence[str] | None, others: str = "", show: bool = True
) -> tuple[Finding, ...]:
    """Stop on an error that is not accepted; else print accepted errors and warnings, if asked for.

    Without a command that shows the other errors (`others`), they are printed here. Returns the findings, errors first.

    InputError on such an error, or if a code is unknown.
    """
    accepted, findings = check_codes(accept or ()), by_severity(findings)
    errors = [one for one in findings if one.severity == "error" and one.code not in accepted]
    if not others:
        show_findings(errors[1:], accept=accepted)
    stop_on_errors(errors, others=others or "above")
    if show:
        show_findings(findings)
    return findings


def show_findings(
    findings: Collection[Finding],
    *,
    # codes of errors that the user has accepted; all of them if it is not given
    accept: Collection[str] | None = None,
) -> None:
    """Print errors and warnings, a line each; notes stand in the report."""
    for finding in findings:
        if finding.severity != "note":
            notice(finding_line(finding, accepted=accept is None or finding.code in accept))
