"""`ballbot check-log`: what a log holds and what is wrong with it; for a foreign file, how it becomes a log."""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path

from rich.table import Table
from rich.text import Text

from ballbot.cli.findings import finding_line
from ballbot.cli.output import standard_output, table
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.log.checks import check
from ballbot.log.checks.kinematics import WheelAgreement, wheel_agreement
from ballbot.log.formats import is_foreign
from ballbot.log.log import ColumnSummary, summarize
from ballbot.log.mapping_file import parse_mapping
from ballbot.log.mapping_inference.proposal import Proposal, propose
from ballbot.log.mapping_inference.report import findings_of, mapping_text
from ballbot.log.pose import with_odometry
from ballbot.printable import shell_line
from ballbot.result_folder import ResultFolder, result_folder
from ballbot.results import as_json
from ballbot.robot import Robot


def propose_mapping(
    file: Path, robot: Robot, *, source: str, folder: ResultFolder | None
) -> tuple[Finding, ...]:
    """Show the mapping proposed for a foreign file; with a folder, write it, the log it makes and results.json."""
    console = standard_output()
    with console.status("reading the encoder times"):
        proposal = propose(file, robot)
    findings, text = findings_of(proposal), mapping_text(proposal, robot, file=file)
    console.print(Text(f"{file}: not in Ballbot's format; this mapping is proposed"), soft_wrap=True)
    console.print(_role_table(proposal, framed=console.is_terminal))
    if proposal.lean_test:
        console.print(_placement_table(proposal, framed=console.is_terminal))
    for finding in findings:
        console.print(Text(f"{finding.severity}: {finding.text}"), soft_wrap=True)
    if folder is None:
        console.print(Text("\n" + text), soft_wrap=True)
        return findings
    out = folder.path
    log = Log.read(file, mapping=parse_mapping(text, source=str(out / "mapping.toml")))
    complete = with_odometry(log, robot) if proposal.roles.attitude else log
    with folder.replaced() as new:
        write_text(new / "mapping.toml", text)
        complete.write(new / "log.csv")
        write_text(new / "results.json", as_json(_proposal_results(file, proposal, complete, findings)))
    for name in ("mapping.toml", "log.csv"):
        console.print(str(out / name), markup=False, soft_wrap=True)
    if proposal.commands:
        command = "identify" if proposal.roles.attitude else "identify-driveline"
        tokens = [
            "ballbot",
            command,
            source,
            str(file),
            "--mapping",
            str(out / "mapping.toml"),
            "--out",
            "found",
        ]
        console.print(f"Next: {shell_line(tokens)}", markup=False, soft_wrap=True)
    return findings


def _role_table(proposal: Proposal, *, framed: bool) -> Table:
    roles, lean, wheel, duty = proposal.roles, proposal.lean, proposal.wheel, proposal.duty
    rows = [
        ("time", roles.time or "-", "s", ""),
        (
            "roll, pitch, yaw",
            ", ".join(roles.attitude) or "-",
            lean.unit if lean else "-",
            lean.reason if lean else "",
        ),
        ("wheel angles", ", ".join(roles.angles), wheel.unit, wheel.reason),
        (
            "commands",
            ", ".join(roles.commands) or "-",
            duty.unit if duty else "-",
            duty.reason if duty else "",
        ),
    ]
    return table("Columns", ("what", "of the file", "unit", "because"), rows, framed=framed)


def _placement_table(proposal: Proposal, *, framed: bool) -> Table:
    placements = proposal.lean_test.placements if proposal.lean_test else ()
    least = min((one.misfit for one in placements), default=1.0)
    rows = [
        (
            one.description,
            f"{math.degrees(one.phase):.1f}",
            f"{one.gain:.2f}",
            f"{100.0 * one.unexplained:.1f}",
            f"{100.0 * one.together:.1f}",
            f"{one.misfit / least:.1f}",
        )
        for one in placements
    ]
    headings = (
        "wheel order",
        "phase [deg]",
        "gain",
        "lean unexplained [%]",
        "wheels together [%]",
        "misfit",
    )
    return table("Wheel orders, by the response of the lean", headings, rows, framed=framed)


def _proposal_results(
    file: Path, proposal: Proposal, log: Log, findings: tuple[Finding, ...]
) -> dict[str, object]:
    tested, heading, commands = proposal.lean_test, proposal.heading, proposal.commands
    return {
        "file": str(file),
        "roles": proposal.roles,
        "wheel_unit": proposal.wheel,
        "lean_unit": proposal.lean,
        "duty": proposal.duty,
        "speed_noise": {"before": proposal.timing.before, "after": proposal.timing.after},
        "handedness": None if tested is None else "mirrored" if tested.placements[0].mirrored else "direct",
        "phase_deg": None if tested is None else math.degrees(tested.placements[0].phase),
        "phase_error_deg": None
        if tested is None or tested.phase_error is None
        else math.degrees(tested.phase_error),
        "placements": [] if tested is None else tested.placements,
        "margin": None if tested is None else tested.margin,
        "sensor_delay": None if tested is None else tested.lag,
        "command_delay": None if commands is None else commands.delay,
        "disturbance": None if tested is None else tested.disturbance,
        "heading": heading,
        "commands": commands,
        "frame": proposal.frame,
        "keep": proposal.keep,
        "rows": len(log),
        "columns": list(log.names),
        "findings": findings,
    }


_WRITTEN = ("results.json",)
_PROPOSED = ("results.json", "mapping.toml", "log.csv")  # of a foreign file


def check_log(
    file: Path, /, *, robot: str | None = None, mapping: Path | None = None, out: Path | None = None
) -> None:
    """Show a log's columns and what is wrong with it. The exit code is 2 if there is an error.

    For a file that is not in Ballbot's format, propose a mapping and test it against the robot's kinematics.

    Example: `ballbot check-log run1.csv --robot alten`

    Example: `ballbot check-log main_control_1.txt --robot rob311 --out checked` writes mapping.toml and log.csv

    Parameters
    ----------
    file
        The log: CSV or Parquet with Ballbot's column names, or any table of text.
    robot
        A preset's name or a robot file: checks the wheels' order, signs and gains against its kinematics.
    mapping
        A TOML file that describes the columns and units of a foreign log. If not given, one is proposed.
    out
        A folder for results.json and, for a foreign file, the mapping and the converted log.
    """
    described = Robot.load(robot) if robot else None
    files = [path for path in (file, mapping, Path(robot) if robot else None) if path]
    proposes = described is not None and mapping is None and is_foreign(file)
    names = _PROPOSED if proposes else _WRITTEN
    held = result_folder(out, command="check-log", names=names, inputs=files) if out else nullcontext()
    with held as folder:
        if robot and described and proposes:
            propose_mapping(file, described, source=robot, folder=folder)
        else:
            _check(file, described, mapping, folder)


def _check(file: Path, described: Robot | None, mapping: Path | None, folder: ResultFolder | None) -> None:
    """Show a log and what is wrong with it; raise InputError if that is an error."""
    log = Log.read(file, mapping=mapping)
    summaries, findings = summarize(log), check(log, robot=described)
    wheels = wheel_agreement(log, described) if described else None
    _show(file, log, summaries, findings, wheels)
    if folder:
        with folder.replaced() as new:
            write_text(new / "results.json", as_json(_results(file, log, summaries, findings, wheels)))
    errors = [finding for finding in findings if finding.severity == "error"]
    if errors:
        more = f" ({len(errors) - 1} more, shown above)" if len(errors) > 1 else ""
        raise InputError(f"{file}: {errors[0].text}{more}")


def _show(
    file: Path,
    log: Log,
    summaries: tuple[ColumnSummary, ...],
    findings: tuple[Finding, ...],
    wheels: WheelAgreement | None,
) -> None:
    console = standard_output()
    rate = f", {1.0 / log.sample_time:.4g} Hz" if len(log) > 1 else ""
    console.print(Text(f"{file}: {len(log)} rows, {log.t[-1] - log.t[0]:.6g} s{rate}"))
    console.print(_column_table(summaries, framed=console.is_terminal))
    if wheels:
        console.print(_wheel_table(wheels, framed=console.is_terminal))
    for finding in findings:
        console.print(finding_line(finding), soft_wrap=True)
    if not findings:
        console.print("No problems were found.")


def _column_table(summaries: tuple[ColumnSummary, ...], *, framed: bool) -> Table:
    rows = [
        (
            column.name,
            column.unit or "?",
            *("-" if limit is None else f"{limit:.4g}" for limit in (column.least, column.greatest)),
            f"{column.change_rate:.4g}",
            str(column.missing),
        )
        for column in summaries
    ]
    headings = ("column", "unit", "from", "to", "changes per second", "missing")
    return table("Columns", headings, rows, framed=framed)


def _wheel_table(wheels: WheelAgreement, *, framed: bool) -> Table:
    found = zip(wheels.order, wheels.signs, wheels.gains, wheels.correlations, strict=True)
    rows = [
        (str(i), str(place), f"{sign:+d}", f"{gain:.4f}", f"{correlation:.4f}")
        for i, (place, sign, gain, correlation) in enumerate(found, start=1)
    ]
    headings = ("robot's wheel", "log's wheel", "sign", "gain", "correlation")
    return table("Wheels, compared with the robot's kinematics", headings, rows, framed=framed)


def _results(
    file: Path,
    log: Log,
    summaries: tuple[ColumnSummary, ...],
    findings: tuple[Finding, ...],
    wheels: WheelAgreement | None,
) -> dict[str, object]:
    return {
        "file": str(file),
        "rows": len(log),
        "start": float(log.t[0]),
        "end": float(log.t[-1]),
        "sample_time": log.sample_time if len(log) > 1 else None,
        "columns": summaries,
        "findings": findings,
        "wheels": wheels,
    }
