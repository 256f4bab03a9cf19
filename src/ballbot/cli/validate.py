"""`ballbot validate`: a robot's model, with its friction and without, against its logs."""

from __future__ import annotations

import shlex
from pathlib import Path

from rich.table import Table

from ballbot.cli.output import progress_bar, standard_output, table
from ballbot.cli.study import read_logs
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.log import STATE_NAMES, Log
from ballbot.report.provenance import provenance
from ballbot.report.results import as_json, validation_results
from ballbot.report.study_files import check_folder
from ballbot.report.tables import digits
from ballbot.report.validation_page import validation_report
from ballbot.robot import Friction, Robot
from ballbot.validation import ErrorPair, Validation, findings, join_validations
from ballbot.validation import validate as validate_log


def validate(
    robot: str,
    /,
    *logs: Path,
    out: Path,
    controller: Path | None = None,
    mapping: Path | None = None,
    seed: int = 0,
) -> None:
    """Hold a robot's model, with its friction and without, against logs that it was not fitted to.

    Writes report.html and results.json.

    Example: ballbot validate found/robot.toml step.csv --out checked

    Parameters
    ----------
    robot
        A preset's name or a robot file, with friction: `ballbot study` and `ballbot identify` write one.
    logs
        One or more logs of the robot balancing, with torques and states.
    out
        The folder to write into.
    controller
        The controller that recorded the logs; without it, its gain is recovered from each log.
    mapping
        A TOML file that says how foreign logs become Ballbot's.
    seed
        Of the noise drawn for the noise floors.
    """
    described = Robot.load(robot)
    if described.friction == Friction.none(described.wheel_count):
        raise InputError(
            f"The robot {described.name} has no friction to validate; `ballbot identify` finds it."
        )
    named = read_logs(logs, mapping)
    driver = read_controller(controller, described) if controller else None
    folder = check_folder(out)
    words = ["ballbot", "validate", robot, *map(str, logs), "--out", str(out)]
    words += ["--controller", str(controller)] if controller else []
    words += ["--mapping", str(mapping)] if mapping else []
    files = [*logs, *(path for path in (controller, mapping) if path)]
    made = provenance(command=shlex.join(words), files=files, seed=seed)

    parts = _validate(described, named, driver, seed)
    validation = join_validations(tuple(parts.values()))
    results = validation_results(validation)
    results["by_log"] = {name: validation_results(part) for name, part in parts.items()}
    write_text(folder / "results.json", as_json({"validation": results, "provenance": made.to_dict()}))
    title = f"{described.name}: the model against its logs"
    page = validation_report(
        validation, title=title, lead=f"On {', '.join(named)}.", example_of=next(iter(named)), made=made
    )
    write_text(folder / "report.html", page)
    _show(validation, folder / "report.html")


def _validate(
    robot: Robot, logs: dict[str, Log], controller: Controller | None, seed: int
) -> dict[str, Validation]:
    """Return the validation on each log; an error says which log it is about."""
    console = standard_output()
    parts: dict[str, Validation] = {}
    with progress_bar(console, "validating") as bar:
        for number, (name, log) in enumerate(logs.items()):
            bar.show(number / len(logs), doing=f"validating {name}")
            try:
                parts[name] = validate_log(robot, log, controller=controller, seed=seed)
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
    return parts


def _show(validation: Validation, report: Path) -> None:
    console = standard_output()
    console.print(_error_table("open loop", validation.open_loop.errors, framed=console.is_terminal))
    if validation.closed_loop is not None:
        console.print(
            _error_table("closed loop", validation.closed_loop.restarted, framed=console.is_terminal)
        )
    for finding in findings(validation):
        console.print(finding, markup=False, soft_wrap=True)
    console.print(str(report), markup=False, soft_wrap=True)


def _error_table(what: str, pair: ErrorPair, *, framed: bool) -> Table:
    rows = [
        (
            name,
            digits(pair.with_friction.error[i]),
            digits(pair.without_friction.error[i]),
            f"{pair.ratio[i]:.2f}",
            digits(pair.with_friction.rmse[i]),
            digits(pair.without_friction.rmse[i]),
        )
        for i, name in enumerate(STATE_NAMES)
    ]
    headings = ("state", "error (4.1)", "without friction", "ratio", "RMSE", "without friction")
    return table(f"{what}, {pair.runs} runs", headings, rows, framed=framed)
