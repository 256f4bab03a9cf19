"""`ballbot check-log`: a log's columns and problems; for a foreign file, a proposed mapping."""

from collections.abc import Sequence
from pathlib import Path

from rich.text import Text

from ballbot.cli import options
from ballbot.cli.context import CommandResult, Content, open_result
from ballbot.cli.output import progress_bar
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.checks import BALANCING, DRIVELINES
from ballbot.log.columns import given_names
from ballbot.log.formats import is_foreign
from ballbot.log.mapping_search.motion import Stated
from ballbot.log.mapping_search.names import InputKind
from ballbot.log.proposal import answer_lines, evaluate, propose
from ballbot.printable import shell_line
from ballbot.report.blocks import finding_line
from ballbot.report.log_check import CheckedLog, log_check_report, proposal_report
from ballbot.robot import Robot


def check_log(
    file: Path,
    /,
    *others: Path,
    robot: str | None = None,
    mapping: options.Mapping = None,
    command: InputKind | None = None,
    full_scale: options.Positive | None = None,
    counts_per_turn: options.Positive | None = None,
    columns: str | None = None,
    out: options.OptionalOut = None,
) -> None:
    """Show the columns of a log and its problems. The exit code is 2 if there is an error.

    For files that are not in Ballbot's format and have no mapping, propose one and test it against the robot's
    equations. If something cannot be determined, the mapping file lists all questions at once, and the exit code is 2.

    Example: `ballbot check-log run1.csv --robot alten`

    Example: `ballbot check-log main_control_1.txt --robot rob311 --command duty --out checked`

    Parameters
    ----------
    file
        The log: CSV or Parquet with Ballbot's column names, or any table of text, JSON or MATLAB.
    others
        More logs, shown without --out. A mapping proposed for one log of a robot is for all, by --mapping.
    robot
        A preset's name or a robot file: checks the wheels' order, signs and gains against its kinematics.
    command
        What the firmware's command of a motor is: torque at the wheel, current, voltage or PWM duty.
    full_scale
        The number that stands for full duty in a foreign log: 1, 100, 255, 1000.
    counts_per_turn
        The encoder's counts in one turn of a wheel, gear included, if they differ from the robot file's.
    columns
        The names of a foreign table's columns in its order, with commas between, for a file without a header:
        t,roll,pitch,yaw,enc1,enc2,enc3,u1,u2,u3. Write _ for a column whose name you do not know.
    """
    files, described = (file, *others), Robot.load(robot) if robot else None
    proposes = described is not None and mapping is None and (columns is not None or is_foreign(file))
    stated = Stated(
        command=command,
        full_scale=full_scale,
        counts_per_turn=counts_per_turn,
        columns=given_names(columns),
    )
    for name, value in vars(stated).items():
        if value is not None and not proposes:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"{option} is for a foreign table and needs --robot, without --mapping.")
    if out and others:
        raise InputError("--out takes one log; give the others commands of their own.")
    writes = ("mapping.toml", "log.csv") if proposes else ()
    with open_result(out, writes=writes) as result:
        for path in files:
            if robot and described and proposes:
                _show(path, described, stated, source=robot, result=result)
            else:
                _check(path, described, mapping, result, source=robot)


def _check(
    file: Path, robot: Robot | None, mapping: Path | None, result: CommandResult, *, source: str | None
) -> None:
    """Show a log and its problems; raise InputError if one is an error."""
    checked = CheckedLog.of(file, Log.read(file, mapping=mapping, robot=robot), robot)
    page = log_check_report(checked, robot)
    errors = [finding for finding in checked.findings if finding.severity == "error"]
    command = next((_COMMANDS[use] for use in checked.uses if use in _COMMANDS), "")
    tail = ["--mapping", str(mapping)] if mapping else []
    step = "" if errors else _next_step(command if source else "check-log", source, file, tail)
    printed = [page.lead, *map(finding_line, checked.findings), *page.parts()]
    result.write(page, printed=printed, next_step=step)
    if errors:
        more = f" ({len(errors) - 1} more, shown above)" if len(errors) > 1 else ""
        raise InputError(f"{file}: {errors[0].text}{more}")


#: the command for a use
_COMMANDS = {BALANCING: "study", DRIVELINES: "identify-driveline"}


def _next_step(command: str, robot: str | None, log: Path, tail: Sequence[str]) -> str:
    """Return the command to use a log with next; without one, what to add to the log."""
    if not command:
        return "add the missing columns that are listed above; a mapping file gives them their names (docs/logs.md)."
    words = [command, str(log), "--robot", "ROBOT"] if robot is None else [command, robot, str(log)]
    folder = [] if robot is None else ["--out", "found"]
    return f"`{shell_line(['ballbot', *words, *tail, *folder])}`"


def _show(file: Path, robot: Robot, stated: Stated, *, source: str, result: CommandResult) -> None:
    """Show the mapping proposed for a foreign file; with a folder, write it, the log that it makes and results.json.

    Raise InputError if something cannot be determined, or if the log contradicts the robot, after everything that was
    determined is shown and written.
    """
    with progress_bar(result.console, f"comparing {file.name} with the robot"):
        found = evaluate(propose(file, robot, stated))
    printed = [Text(line) for line in answer_lines(found)]
    texts: dict[str, Content] = {"mapping.toml": found.text}
    files = texts if found.log is None else texts | {"log.csv": found.log.write}
    step = ""
    if result.folder is None:
        printed.append(Text("\n" + found.text))
        if not found.refusal:
            step = "the same command with `--out checked` writes the mapping and the log."
    elif not found.refusal:
        attitude, commands = found.roles.attitude, found.roles.commands
        command = ("identify" if attitude else "identify-driveline") if commands else "check-log"
        tail = ["--mapping", str(result.folder.path / "mapping.toml")]
        step = _next_step(command, source if commands else None, file, tail)
    page = proposal_report(found, kept=result.folder is not None)
    result.write(page, files=files, printed=printed, named=[*files], next_step=step)
    if found.refusal:
        raise InputError(f"{file}: {found.refusal}")
