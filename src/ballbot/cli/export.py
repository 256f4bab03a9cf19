"""`ballbot export`: a controller as C firmware for its robot."""

from __future__ import annotations

from pathlib import Path

from ballbot.cli.context import input_files, open_result
from ballbot.cli.controllers import warn_of_idle_compensation, warn_of_overcompensation
from ballbot.cli.findings import Accept, check_robot
from ballbot.control.file import read_controller
from ballbot.files import write_text
from ballbot.firmware.export import check_belongs, export_controller, exported_names
from ballbot.firmware.records import FIRMWARE
from ballbot.report.export import export_parts
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
    result.show(export_parts(exported, read, framed=result.console.is_terminal))
    warn_of_idle_compensation({controller.name: read}, result.console)
    warn_of_overcompensation({controller.name: read}, described, result.console)
    result.show_file("README.md")
