"""`ballbot twin`: the twin's own files."""

from pathlib import Path

from cyclopts import App

from ballbot.cli import options
from ballbot.cli.output import show_written
from ballbot.errors import InputError
from ballbot.files import check_file, check_new_file, write_text
from ballbot.robot import Robot
from ballbot.twin import twin_mjcf
from ballbot.twin.model_files import robot_urdf
from ballbot.twin.scenario_file import load_scenario, scenario_text

ABOUT = """The twin's MuJoCo model and its scenarios.

Example: ballbot twin export alten --out twin.xml
"""

twin = App(name="twin", help=ABOUT)


@twin.command
def export(
    robot: options.Robot,
    /,
    *,
    scenario: str | None = None,
    out: Path,
) -> None:
    """Write the twin as MJCF, for MuJoCo's viewer and other tools, or the robot with its own friction as URDF, for ROS.

    Example: ballbot twin export alten --scenario nominal --out twin.xml

    Example: ballbot twin export mine.toml --out mine.urdf

    Effects that depend on speed or time are left out: dry friction has its value at rest; motors, supply and pushes
    are missing. Every roller is a body with one contact.

    Parameters
    ----------
    scenario
        A named scenario or a scenario file; "nominal" by default. Not for URDF.
    out
        The file to write, .xml or .urdf.
    """
    described = Robot.load(robot)
    kind = out.suffix.lower()
    if kind not in (".xml", ".urdf"):
        raise InputError(f"{out} must end in .xml for MJCF, or in .urdf.")
    if kind == ".urdf" and scenario:
        raise InputError("URDF describes the robot only: leave out --scenario, or write .xml.")
    check_file(out)
    if kind == ".urdf":
        write_text(out, robot_urdf(described))
        sentence, step = f"{described.name} as URDF, with its own friction.", f"open {out} in RViz."
    else:
        chosen = load_scenario(scenario or "nominal", described)
        write_text(out, twin_mjcf(described, chosen) + "\n")
        sentence = f"The twin of {described.name} as MJCF, with the scenario {chosen.name}."
        step = f"`python -m mujoco.viewer --mjcf={out}`"
    show_written(out, sentence, next_step=step)


@twin.command
def scenario(
    source: str = "nominal", /, *, robot: str = "alten", out: Path, force: options.Force = False
) -> None:
    """Write a scenario file to start from, with every active fault and an example of each inactive one.

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
    described = Robot.load(robot)
    check_new_file(out, force=force)
    write_text(out, scenario_text(load_scenario(source, described)))
    show_written(
        out,
        f"The scenario {source}, to be changed.",
        next_step=f"change its values, then `ballbot record {out} --robot {robot} --out run`",
    )
