"""`ballbot check-log`: a log's columns and problems; for a foreign file, a proposed mapping."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

from rich.text import Text

from ballbot.cli.context import CommandResult, input_files, open_result
from ballbot.cli.output import print_parts, standard_output
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.log import Log
from ballbot.log.formats import is_foreign
from ballbot.log.mapping_file import parse_mapping
from ballbot.log.mapping_inference.proposal import Proposal, propose
from ballbot.log.mapping_inference.report import findings_of, mapping_text
from ballbot.log.pose import with_odometry
from ballbot.printable import shell_line
from ballbot.report.log_check import CheckedLog, checked_log_parts, proposal_parts, proposal_results
from ballbot.robot import Robot

_WRITTEN = ("results.json",)
_PROPOSED = ("results.json", "mapping.toml", "log.csv")  # of a foreign file


def check_log(
    file: Path, /, *, robot: str | None = None, mapping: Path | None = None, out: Path | None = None
) -> None:
    """Show the columns of a log and its problems. The exit code is 2 if there is an error.

    For a file that is not in Ballbot's format, propose a mapping and test it against the robot's kinematics.

    Example: `ballbot check-log run1.csv --robot alten`

    Example: `ballbot check-log main_control_1.txt --robot rob311 --out checked` writes mapping.toml and log.csv

    Parameters
    ----------
    file
        The log: CSV or Parquet with Ballbot's column names, or any text file with a table.
    robot
        A preset's name or a robot file: checks the wheels' order, signs and gains against its kinematics.
    mapping
        A TOML file that describes the columns and units of a foreign log. If not given, one is proposed.
    out
        A folder for results.json and, for a foreign file, the mapping and the converted log.
    """
    described = Robot.load(robot) if robot else None
    proposes = described is not None and mapping is None and is_foreign(file)
    names = _PROPOSED if proposes else _WRITTEN
    inputs = input_files(file, mapping, robot)
    held = open_result(out, command="check-log", writes=names, inputs=inputs) if out else nullcontext()
    with held as result:
        if robot and described and proposes:
            _propose(file, described, source=robot, result=result)
        else:
            _check(file, described, mapping, result)


def _check(file: Path, robot: Robot | None, mapping: Path | None, result: CommandResult | None) -> None:
    """Show a log and its problems; raise InputError if one is an error."""
    checked = CheckedLog.of(file, Log.read(file, mapping=mapping), robot)
    console = standard_output()
    print_parts(checked_log_parts(checked, framed=console.is_terminal), console)
    if result:
        with result.replaced() as new:
            result.write_json(checked.results(), new)
    errors = [finding for finding in checked.findings if finding.severity == "error"]
    if errors:
        more = f" ({len(errors) - 1} more, shown above)" if len(errors) > 1 else ""
        raise InputError(f"{file}: {errors[0].text}{more}")


def _propose(file: Path, robot: Robot, *, source: str, result: CommandResult | None) -> None:
    """Show the mapping proposed for a foreign file; with a folder, write it, its log and results.json."""
    console = standard_output()
    with console.status("reading the encoder times"):
        proposal = propose(file, robot)
    findings, text = findings_of(proposal), mapping_text(proposal, robot, file=file)
    print_parts(proposal_parts(file, proposal, findings, framed=console.is_terminal), console)
    if result is None:
        console.print(Text("\n" + text), soft_wrap=True)
        return
    written = result.folder.path / "mapping.toml"
    log = Log.read(file, mapping=parse_mapping(text, source=str(written)))
    complete = with_odometry(log, robot) if proposal.roles.attitude else log
    with result.replaced() as new:
        write_text(new / "mapping.toml", text)
        complete.write(new / "log.csv")
        result.write_json(proposal_results(file, proposal, complete, findings), new)
    result.show_file("mapping.toml", "log.csv")
    if proposal.commands:
        console.print(_next_step(file, proposal, source=source, mapping=written), soft_wrap=True)


def _next_step(file: Path, proposal: Proposal, *, source: str, mapping: Path) -> str:
    command = "identify" if proposal.roles.attitude else "identify-driveline"
    tokens = ["ballbot", command, source, str(file), "--mapping", str(mapping), "--out", "found"]
    return f"Next: {shell_line(tokens)}"
