"""`ballbot check-log`: what a log holds and what is wrong with it; of a foreign file, how it becomes a log."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path

from rich.table import Table
from rich.text import Text

from ballbot.cli.findings import finding_line
from ballbot.cli.log_proposal import propose_mapping
from ballbot.cli.output import standard_output, table
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.log.checks import check
from ballbot.log.formats import is_foreign
from ballbot.log.kinematic_check import WheelAgreement, wheel_agreement
from ballbot.log.summary import ColumnSummary, summarize
from ballbot.report.json_text import as_json
from ballbot.result_folder import ResultFolder, result_folder
from ballbot.robot import Robot

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
        "columns": [asdict(column) for column in summaries],
        "findings": [asdict(finding) for finding in findings],
        "wheels": asdict(wheels) if wheels else None,
    }
