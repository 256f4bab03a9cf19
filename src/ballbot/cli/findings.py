"""How commands print findings, stop on errors, and let `--accept CODE` continue."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ballbot.cli.output import notice_output
from ballbot.findings import Finding, by_severity, check_codes, stop_on_errors
from ballbot.report.console import finding_line
from ballbot.robot import Robot
from ballbot.robot.plausibility import named_robot_findings

if TYPE_CHECKING:
    from ballbot.log import Log

#: the option of every command that checks its input
Accept = Annotated[
    list[str] | None,
    Parameter(
        name="--accept",
        negative="",
        help="Continue despite an error with this code, such as torque-sign. May be given more than once. "
        "The error names its code.",
    ),
]


def check_input(
    robot: Robot | None,
    logs: Mapping[Path, Log],
    *,
    accept: Sequence[str] | None,
    mappings: Collection[Path | None] = (),
    show: bool = True,
) -> tuple[Finding, ...]:
    """Check the logs of a command, print accepted errors and warnings, and return all findings.

    Parameters
    ----------
    robot : Robot, optional
        Whose logs they are.
    logs : mapping of Path to Log
        By their files.
    accept : sequence of str, optional
        What `--accept` gave.
    mappings : collection of Path or None, optional
        The mapping files of the logs.
    show : bool
        Whether to print the findings; if not, the command calls `show_findings` when it has printed its result.

    Raises
    ------
    InputError
        If a log has an error whose code is not accepted, or a code is unknown.
    """
    from ballbot.log.checks import findings_of
    from ballbot.log.mapping import dead_band_findings

    check_codes(accept or ())
    findings = findings_of(robot, {str(path): log for path, log in logs.items()})
    if robot is not None:
        findings = by_severity([*findings, *dead_band_findings(dict.fromkeys(mappings))])
    stop_or_show(findings, accept=accept, others="`ballbot check-log`", show=show)
    return findings


def check_robot(robot: Robot, *, accept: Sequence[str] | None) -> tuple[Finding, ...]:
    """Check a robot's numbers against one another, print accepted errors and warnings, and return all findings.

    Raises
    ------
    InputError
        If there is an error whose code is not accepted, or a code is unknown.
    """
    findings = named_robot_findings(robot)
    stop_or_show(findings, accept=accept, others="`ballbot check`")
    return findings


def stop_or_show(
    findings: Sequence[Finding], *, accept: Sequence[str] | None, others: str = "", show: bool = True
) -> None:
    """Stop on an error that is not accepted; else print accepted errors and warnings, if asked for.

    Without a command that shows the other errors (`others`), they are printed here.

    Raises
    ------
    InputError
        On such an error, or if a code is unknown.
    """
    accepted = check_codes(accept or ())
    errors = [one for one in findings if one.severity == "error" and one.code not in accepted]
    if not others:
        show_findings(errors[1:], accept=accepted)
    stop_on_errors(errors, others=others or "above")
    if show:
        show_findings(findings)


def show_findings(findings: Collection[Finding], *, accept: Collection[str] | None = None) -> None:
    """Print errors and warnings, a line each; notes stand in the report.

    Parameters
    ----------
    findings : collection of Finding
    accept : collection of str, optional
        Codes of errors that the user has accepted; all of them if it is not given.
    """
    console = notice_output()
    for finding in findings:
        if finding.severity != "note":
            accepted = accept is None or finding.code in accept
            console.print(finding_line(finding, accepted=accepted), soft_wrap=True)
