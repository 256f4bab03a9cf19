"""`ballbot study`: the main job, from a robot and its logs to a report and a controller."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from ballbot.cli.output import standard_output
from ballbot.errors import InputError
from ballbot.experiments.study import study as run_study
from ballbot.identification import read_bounds
from ballbot.log import Log
from ballbot.report.provenance import provenance
from ballbot.report.study_files import check_folder, write_study
from ballbot.report.summary import summary
from ballbot.robot import Robot


def study(
    robot: str,
    /,
    *logs: Path,
    out: Path,
    plant: Literal["model", "twin"] = "model",
    mapping: Path | None = None,
    bounds: Path | None = None,
    seed: int = 0,
) -> None:
    """Find a robot's friction in its logs, judge the model, design a controller and show what it gains.

    Writes report.html, results.json, robot.toml (the friction found) and controller.toml.

    Example: ballbot study alten square.csv hold.csv --out found

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    logs
        One or more logs of the robot balancing, with torques and states.
    out
        The folder to write into.
    plant
        What the compensations are compared on: the model with the friction found, or the physics-engine twin.
    mapping
        A TOML file that says how foreign logs become Ballbot's.
    bounds
        A TOML file of the bounds within which the friction is sought.
    seed
        Of all that is random; equal seeds give equal results.
    """
    described = Robot.load(robot)
    named = read_logs(logs, mapping)
    within = read_bounds(bounds) if bounds else None
    folder = check_folder(out)
    files = [*_robot_file(robot), *logs, *(path for path in (mapping, bounds) if path)]
    command = _command(robot, logs, out=out, plant=plant, mapping=mapping, bounds=bounds, seed=seed)
    made = provenance(command=command, files=files, seed=seed)
    console = standard_output()
    bar = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    with Progress(*bar, console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task("reading", total=1.0)

        def tell(stage: str, share: float) -> None:
            progress.update(task, description=stage, completed=share)

        result = run_study(described, named, plant=plant, bounds=within, seed=seed, progress=tell)
        tell("writing the report", 1.0)
        report = write_study(result, folder, made=made)
    for heading, words in summary(result):
        console.print(f"[bold]{heading}[/]: ", end="")
        console.print(words, markup=False, soft_wrap=True)
    console.print(str(report), markup=False, soft_wrap=True)


def read_logs(paths: Sequence[Path], mapping: Path | None) -> dict[str, Log]:
    """Return the logs by their files' stems, with their folders before them where stems recur.

    Raises
    ------
    InputError
        Where there is none, one is named twice or cannot be read.
    """
    if not paths:
        raise InputError("No log was given; name one or more files after the robot.")
    stems = [path.stem for path in paths]
    names = stems if len(set(stems)) == len(stems) else [str(path.with_suffix("")) for path in paths]
    for path, name in zip(paths, names, strict=True):
        if names.count(name) > 1:
            raise InputError(f"The log {path} was given twice; name each file once.")
    return {name: Log.read(path, mapping=mapping) for path, name in zip(paths, names, strict=True)}


def _robot_file(robot: str) -> list[Path]:
    return [] if robot in Robot.presets() else [Path(robot)]


def _command(
    robot: str,
    logs: Sequence[Path],
    *,
    out: Path,
    plant: str,
    mapping: Path | None,
    bounds: Path | None,
    seed: int,
) -> str:
    """Return the command line that makes this study again."""
    words = ["ballbot", "study", robot, *map(str, logs), "--out", str(out)]
    words += ["--plant", plant] if plant != "model" else []
    words += ["--mapping", str(mapping)] if mapping else []
    words += ["--bounds", str(bounds)] if bounds else []
    words += ["--seed", str(seed)] if seed else []
    return shlex.join(words)
