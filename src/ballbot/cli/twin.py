"""`ballbot twin`: the twin's own files, and the thesis's recommendations tried on it."""

from __future__ import annotations

import os
from pathlib import Path

from cyclopts import App

from ballbot.cli.context import parse_seeds
from ballbot.cli.output import progress_bar, standard_output, table
from ballbot.files import check_file, write_text
from ballbot.result_folder import result_folder
from ballbot.results import as_json
from ballbot.robot import Robot
from ballbot.twin import twin_mjcf
from ballbot.twin.mjcf import Mounting
from ballbot.twin.scenario import load_scenario, write_scenario

_ABOUT = """The twin's MuJoCo model, its scenarios, and the thesis's recommendations tried on it.

Example: ballbot twin export alten --out twin.xml
"""

twin = App(name="twin", help=_ABOUT)


@twin.command
def export(
    robot: str,
    /,
    *,
    scenario: str = "nominal",
    mounting: Mounting = "floor",
    out: Path,
) -> None:
    """Write the twin as MJCF, for MuJoCo's viewer and other tools.

    Example: ballbot twin export alten --scenario nominal --out twin.xml

    Everything that depends on speed or time is left out: dry friction has its value at rest, and motors, supply and
    pushes are missing.

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    scenario
        A named scenario or a scenario file.
    mounting
        floor, stand (held, wheels in the air) or upside_down (held, the ball on the wheels).
    out
        The file to write.
    """
    described = Robot.load(robot)
    check_file(out)
    write_text(out, twin_mjcf(described, load_scenario(scenario, described), mounting=mounting) + "\n")
    standard_output().print(str(out), soft_wrap=True)


@twin.command
def scenario(source: str = "nominal", /, *, robot: str = "alten", out: Path) -> None:
    """Write a scenario file to start from, with all faults that are on and an example of each fault that is off.

    Example: ballbot twin scenario nominal --out mine.toml

    Parameters
    ----------
    source
        A named scenario or a scenario file.
    robot
        A preset's name or a robot file, which gives the rollers and the sensors.
    out
        The file to write.
    """
    write_scenario(load_scenario(source, Robot.load(robot)), out)
    standard_output().print(str(out), soft_wrap=True)


@twin.command
def recommendations(
    robot: str = "alten", /, *, seeds: str = "1-5", duration: float = 64.0, out: Path
) -> None:
    """Try what the thesis recommends: single-row wheels, a stiffer ball, less play, sensor fusion.

    Example: ballbot twin recommendations alten --seeds 1-5 --out recommended

    Prints position error and torque noise before and after, without and with friction compensation; writes
    results.json with every run's scores.

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    seeds
        Random seeds, such as 1-10 or 1,4,7-9.
    duration
        Length of a run around a square of 0.5 m [s].
    out
        The folder to write into.
    """
    from ballbot.workflows.twin_recommendations import HEADINGS, rows, try_recommendations

    console = standard_output()
    inputs = [] if robot in Robot.presets() else [Path(robot)]
    with result_folder(out, command="twin recommendations", names=("results.json",), inputs=inputs) as folder:
        with progress_bar(console, "trying the recommendations") as bar:
            found = try_recommendations(
                Robot.load(robot),
                seeds=parse_seeds(seeds),
                duration=duration,
                threads=os.cpu_count() or 1,
                progress=lambda now: bar.show(now.share),
            )
        scores = {name: comparison.scores for name, comparison in found.items()}
        with folder.replaced() as new:
            write_text(new / "results.json", as_json(scores))
    title = "Position error after settling, and torque noise"
    console.print(table(title, HEADINGS, rows(found), framed=console.is_terminal))
    console.print(str(folder.path / "results.json"), soft_wrap=True)
