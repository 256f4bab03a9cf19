"""`ballbot export`: a controller as C firmware for its robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rich.console import RenderableType
from rich.text import Text

from ballbot.cli.context import input_files, open_result
from ballbot.cli.controllers import warn_of_idle_compensation, warn_of_overcompensation
from ballbot.cli.findings import Accept, check_robot
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller
from ballbot.files import write_text
from ballbot.firmware.export import Export, check_belongs, export_controller, exported_names
from ballbot.firmware.records import FIRMWARE
from ballbot.report.console import table
from ballbot.robot import Robot


def export(
    controller: Path,
    /,
    *,
    robot: str,
    lean: float = 0.35,
    accept: Accept = None,
    out: Path,
) -> None:
    """Write a controller as C99 firmware: sources, the controller's numbers, build files and examples.

    Example: ballbot export found/controller.toml --robot found/robot.toml --out firmware

    The library has the estimator that the controller names, the control law with all its parts, and the safety layer.
    It computes in single precision, needs no operating system and no C library, and takes no memory. Start with
    README.md in the folder; ballbot_hardware.h has the seven functions to write for a board.

    Parameters
    ----------
    controller
        A controller file.
    robot
        A preset's name or a robot file: the robot that the controller was designed for.
    lean
        Largest tilt [rad] at which the firmware gives torques; beyond it the robot is stopped. `ballbot limits` finds
        the largest tilt from which a robot recovers.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    check_robot(described, robot, accept=accept)
    check_belongs(controller, described)
    read = read_controller(controller, described)
    inputs = input_files(robot, controller)
    writes = [*exported_names(), "results.json"]
    with open_result(out, command="export", writes=writes, inputs=inputs) as result:
        exported = export_controller(read, lean=lean)
        with result.replaced() as new:
            for name, text in exported.files.items():
                (new / name).parent.mkdir(parents=True, exist_ok=True)
                write_text(new / name, text)
            results = {
                "robot": described.name,
                "estimator": read.estimator,
                "sample_time": read.sample_time,
                "safety": exported.limits,
                "schema": FIRMWARE.digest,
                "parameter_bytes": exported.parameter_bytes,
                "state_bytes": exported.state_bytes,
            }
            result.write_json(results, new)
    result.show(_parts(exported, read, framed=result.console.is_terminal))
    warn_of_idle_compensation({controller.name: read}, result.console)
    warn_of_overcompensation({controller.name: read}, described, result.console)
    result.show_file("README.md")


def _parts(exported: Export, controller: Controller, *, framed: bool) -> Iterator[RenderableType]:
    """Yield the controller, sizes and limits of an exported firmware."""
    limits = exported.limits
    parts = ", ".join(part.label for _, part in controller.parts.present()) or "none"
    compensation = "no" if controller.compensation == "none" else controller.compensation
    yield Text(
        f"{len(exported.files)} files for {controller.robot.name}. Estimator: {controller.estimator}; {compensation} "
        f"friction compensation; parts: {parts}."
    )
    rows = [
        ["period", f"{1e3 * controller.sample_time:g} ms"],
        ["numbers of the controller (flash)", f"{exported.parameter_bytes} bytes"],
        ["state (RAM)", f"{exported.state_bytes} bytes"],
        ["torque limit", f"{controller.torque_limit:.3g} N m"],
        ["stops beyond a lean of", f"{limits.lean:g} rad"],
        ["stops if a sample comes after more than", f"{1e3 * limits.max_interval:g} ms"],
        ["stops after missing samples", f"{limits.max_missing + 1}"],
        ["stops if a sensor repeats itself for", f"{limits.max_unchanged} samples"],
        ["a wheel must turn under", f"{limits.turning_torque:.3g} N m"],
    ]
    yield table("firmware", ("quantity", "value"), rows, framed=framed)
