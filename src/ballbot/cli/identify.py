"""`ballbot identify`: friction parameters from balancing logs."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as ProgressBar
from rich.table import Table

from ballbot.cli.output import standard_output, table
from ballbot.cli.study import read_logs
from ballbot.files import write_text
from ballbot.identification import Identification, Progress, read_bounds
from ballbot.identification import identify as find_friction
from ballbot.report.provenance import provenance
from ballbot.report.study_files import check_folder
from ballbot.report.tables import digits
from ballbot.robot import Robot
from ballbot.robot.file import write_robot

_UNITS = {"b": "N m s/rad", "c": "N m", "s": "N m", "v_s": "rad/s", "delta": "", "C_rr": ""}


def identify(
    robot: str,
    /,
    *logs: Path,
    out: Path,
    mapping: Path | None = None,
    bounds: Path | None = None,
    seed: int = 0,
    window: float = 0.25,
) -> None:
    """Find a robot's friction in its logs: b, c, s of each wheel, v_s, delta and C_rr.

    Writes robot.toml (the robot with that friction) and results.json.

    Example: ballbot identify alten square.csv hold.csv --out found

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    logs
        One or more logs of the robot balancing, with torques and states.
    out
        The folder to write into.
    mapping
        A TOML file that says how foreign logs become Ballbot's.
    bounds
        A TOML file of the bounds within which the friction is sought, as in: coulomb = [0.0, 0.5]
    seed
        Of all that is random; equal seeds give equal results.
    window
        Length of the windows predicted, in seconds.
    """
    described = Robot.load(robot)
    named = read_logs(logs, mapping)
    within = read_bounds(bounds) if bounds else None
    folder = check_folder(out)
    console = standard_output()
    bar = (
        TextColumn("identifying"),
        BarColumn(),
        TextColumn("error x {task.fields[ratio]}"),
        TimeElapsedColumn(),
    )
    with ProgressBar(*bar, console=console, disable=not console.is_terminal, transient=True) as shown:
        task = shown.add_task("", total=1.0, ratio="1.00")

        def tell(progress: Progress) -> None:
            ratio = f"{math.exp(progress.cost):.3f}"
            shown.update(task, completed=progress.generation / progress.of, ratio=ratio)

        found = find_friction(
            described, list(named.values()), bounds=within, window=window, seed=seed, progress=tell
        )

    words = ["ballbot", "identify", robot, *map(str, logs), "--out", str(out), "--seed", str(seed)]
    words += ["--window", str(window)]
    words += ["--mapping", str(mapping)] if mapping else []
    words += ["--bounds", str(bounds)] if bounds else []
    files = [
        *([] if robot in Robot.presets() else [Path(robot)]),
        *logs,
        *(p for p in (mapping, bounds) if p),
    ]
    made = provenance(command=shlex.join(words), files=files, seed=seed)
    write_robot(found.robot, folder / "robot.toml")
    results = found.to_dict() | {"provenance": made.to_dict()}
    write_text(folder / "results.json", json.dumps(results, indent=2, allow_nan=False) + "\n")
    _show(found, console)
    console.print(str(folder / "robot.toml"), markup=False, soft_wrap=True)


def _show(found: Identification, console: Console) -> None:
    console.print(_parameter_table(found, framed=console.is_terminal))
    console.print(_error_table(found, framed=console.is_terminal))
    for sentence in found.warnings:
        console.print(sentence, markup=False, soft_wrap=True)


def _parameter_table(found: Identification, *, framed: bool) -> Table:
    rows = []
    for symbol, value in found.parameters.items():
        values = value if isinstance(value, list) else [value]
        error = found.standard_errors[symbol]
        errors = error if isinstance(error, list) else [error]
        for i, (one, its_error) in enumerate(zip(values, errors, strict=True), start=1):
            name = f"{symbol}{i}" if isinstance(value, list) else symbol
            rows.append((name, digits(one), digits(its_error, 2), _UNITS[symbol]))
    return table("friction", ("parameter", "value", "standard error", "unit"), rows, framed=framed)


def _error_table(found: Identification, *, framed: bool) -> Table:
    judged = found.held_out
    rows = [
        (state, digits(judged.with_friction[state]), digits(judged.without_friction[state]), f"{ratio:.2f}")
        for state, ratio in judged.ratios.items()
    ]
    title = f"open-loop error (4.1) on {judged.windows} windows held out"
    return table(title, ("state", "with friction", "without", "ratio"), rows, framed=framed)
