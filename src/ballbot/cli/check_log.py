"""`ballbot check-log`: a log's columns and problems; for a foreign file, a proposed mapping."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

from rich.text import Text

from ballbot.cli.context import PAGE, CommandResult, input_files, open_result
from ballbot.cli.output import emit, print_parts, progress_bar, standard_output, suggest_page
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.log import Log
from ballbot.log.formats import is_foreign
from ballbot.log.mapping_inference.proposal import Proposal, propose
from ballbot.log.mapping_inference.report import evaluate
from ballbot.printable import shell_line
from ballbot.report.log_check import (
    CheckedLog,
    checked_log_parts,
    log_check_report,
    proposal_parts,
    proposal_report,
    proposal_results,
)
from ballbot.robot import Robot

_WRITTEN = (PAGE, "results.json")
_PROPOSED = (PAGE, "results.json", "mapping.toml", "log.csv")  # of a foreign file


def check_log(
    file: Path,
    /,
    *,
    robot: str | None = None,
    mapping: Path | None = None,
    columns: str | None = None,
    dead_band: float | None = None,
    out: Path | None = None,
) -> None:
    """Show the columns of a log and its problems. The exit code is 2 if there is an error.

    For a file that is not in Ballbot's format, propose a mapping and test it against the robot's equations. If an
    entry cannot be determined, the mapping leaves its line to fill in, and the exit code is 2.

    Example: `ballbot check-log run1.csv --robot alten`

    Example: `ballbot check-log main_control_1.txt --robot rob311 --out checked`

    Parameters
    ----------
    file
        The log: CSV or Parquet with Ballbot's column names, or any table of text, JSON or MATLAB.
    robot
        A preset's name or a robot file: checks the wheels' order, signs and gains against its kinematics.
    mapping
        A TOML file that describes the columns and units of a foreign log. If not given, one is proposed.
    columns
        The names of a foreign table's columns in its order, with commas between, for a file without a header:
        t,roll,pitch,yaw,enc1,enc2,enc3,u1,u2,u3. Write _ for a column whose name you do not know.
    dead_band
        The duty, 0 to 1, that the firmware of a foreign log adds to overcome friction: 0 if it adds none. If not given,
        it counts as less dry friction, or is asked for if the wheels often turn against their duties.
    out
        A folder for report.html, results.json and, for a foreign file, the mapping and the converted log.
    """
    described = Robot.load(robot) if robot else None
    proposes = described is not None and mapping is None and (columns is not None or is_foreign(file))
    for option, given in (("--columns", columns), ("--dead-band", dead_band)):
        if given is not None and not proposes:
            raise InputError(f"{option} is for a foreign table and needs --robot, without --mapping.")
    if dead_band is not None and not 0.0 <= dead_band < 1.0:
        raise InputError(f"--dead-band is {dead_band:g}; it must be a duty from 0 to below 1.")
    names = _PROPOSED if proposes else _WRITTEN
    inputs = input_files(file, mapping, robot)
    held = open_result(out, command="check-log", writes=names, inputs=inputs) if out else nullcontext()
    with held as result:
        if robot and described and proposes:
            proposal = _proposed(file, described, names=_column_names(columns), dead_band=dead_band)
            _show(file, described, proposal, source=robot, result=result)
        else:
            _check(file, described, mapping, result)
        if result is None:
            suggest_page()


def _column_names(columns: str | None) -> list[str] | None:
    """Return the names of --columns; names of unknown columns get a number, so that all differ."""
    if columns is None:
        return None
    names = [name.strip() for name in columns.split(",")]
    named = [
        name if any(map(str.isalnum, name)) else f"unused_{place}"
        for place, name in enumerate(names, start=1)
    ]
    twice = next((name for name in named if named.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"--columns has the name {twice} twice.")
    return named


def _check(file: Path, robot: Robot | None, mapping: Path | None, result: CommandResult | None) -> None:
    """Show a log and its problems; raise InputError if one is an error."""
    checked = CheckedLog.of(file, Log.read(file, mapping=mapping), robot)
    console = standard_output()
    print_parts(checked_log_parts(checked, framed=console.is_terminal), console)
    emit(checked.results())
    if result:
        with result.replaced() as new:
            result.write_json(checked.results(), new)
            result.write_page(log_check_report(checked, robot, result.origin), new)
        result.show_file(PAGE)
    errors = [finding for finding in checked.findings if finding.severity == "error"]
    if errors:
        more = f" ({len(errors) - 1} more, shown above)" if len(errors) > 1 else ""
        raise InputError(f"{file}: {errors[0].text}{more}")


def _proposed(file: Path, robot: Robot, *, names: list[str] | None, dead_band: float | None) -> Proposal:
    """Return the mapping proposed for a foreign file."""
    with progress_bar(standard_output(), "comparing the columns with the robot"):
        return propose(file, robot, columns=names, dead_band=dead_band)


def _show(file: Path, robot: Robot, proposal: Proposal, *, source: str, result: CommandResult | None) -> None:
    """Show the mapping proposed for a foreign file; with a folder, write it, its log and results.json.

    Raises
    ------
    InputError
        If an entry cannot be determined; everything that was determined is shown and written first.
    """
    console = standard_output()
    with progress_bar(console, "checking the log that the mapping makes"):
        found = evaluate(proposal, robot, file=file, out=result.folder.path if result else None)
    print_parts(proposal_parts(file, found, framed=console.is_terminal), console)
    if result is None:
        console.print(Text("\n" + found.text), soft_wrap=True)
        emit(proposal_results(file, found) | {"mapping_file": found.text})
    else:
        with result.replaced() as new:
            write_text(new / "mapping.toml", found.text)
            if found.log is not None:
                found.log.write(new / "log.csv")
            result.write_json(proposal_results(file, found), new)
            result.write_page(proposal_report(file, found, robot, result.origin), new)
        result.show_file(PAGE, *("mapping.toml", "log.csv")[: 1 if found.log is None else 2])
    if found.refusal:
        raise InputError(f"{file}: {found.refusal}")
    if result is not None and proposal.roles.commands:
        written = result.folder.path / "mapping.toml"
        console.print(_next_step(file, proposal, source=source, mapping=written), soft_wrap=True)


def _next_step(file: Path, proposal: Proposal, *, source: str, mapping: Path) -> str:
    command = "identify" if proposal.roles.attitude else "identify-driveline"
    tokens = ["ballbot", command, source, str(file), "--mapping", str(mapping), "--out", "found"]
    return f"Next: {shell_line(tokens)}"
