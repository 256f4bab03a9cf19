"""`ballbot identify-geometry`: radii, tilt, azimuths and the IMU's mounting, from logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ballbot.cli.context import PAGE, input_files, open_result, read_logs
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity, note
from ballbot.identification.bench_checks import encoder_findings
from ballbot.identification.geometry import (
    geometry_findings,
    robot_with_geometry,
    survey_geometry,
)
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.report.bench import geometry_parts, geometry_report
from ballbot.robot import Robot
from ballbot.robot.file import write_robot
from ballbot.summary import counted

_WRITTEN = (PAGE, "robot.toml", "results.json")
#: r_b / r_w by the logs over the file's; beyond, a unit or a column is wrong rather than a tape measure
_RADII = (0.4, 2.5)


def identify_geometry(
    robot: str,
    /,
    *,
    upside_down: list[Path] | None = None,
    balancing: list[Path] | None = None,
    motion_capture: list[Path] | None = None,
    mapping: Path | None = None,
    accept: Accept = None,
    out: Path,
) -> None:
    """Identify radii, tilt, azimuths and the mounting of the IMU from logs, by kinematics alone.

    Writes report.html, results.json and robot.toml (the identified geometry, with its standard deviations).

    Example: ballbot identify-geometry alten --upside-down up.csv --balancing run.csv --motion-capture mocap.csv
    --out geometry

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    upside_down
        Logs of the robot clamped upside down: wheel angles and ball_omega_x, _y, _z in the robot's frame.
    balancing
        Logs of the robot balancing: wheel angles and gyro_x, _y, _z.
    motion_capture
        One file for each balancing log, in the same order: t, x y z of the ball's centre, qw qx qy qz of the body; on
        any clock and in any frame.
    mapping
        A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    on_wheels, runs, films = upside_down or [], balancing or [], motion_capture or []
    if len(runs) != len(films):
        numbers = counted(len(runs), "time"), counted(len(films), "time")
        raise InputError(
            f"--balancing is given {numbers[0]} and --motion-capture {numbers[1]}. Give one motion capture for each "
            "balancing log, in the same order."
        )
    of_ball = dict(
        zip(on_wheels, read_logs(tuple(on_wheels), mapping).values() if on_wheels else (), strict=True)
    )
    of_runs = dict(zip(runs, read_logs(tuple(runs), mapping).values() if runs else (), strict=True))
    findings = _checked(described, of_ball, of_runs, accept)
    inputs = input_files(on_wheels, runs, films, mapping, robot)
    with (
        open_result(out, command="identify-geometry", writes=_WRITTEN, inputs=inputs) as result,
        result.progress("identifying the geometry") as bar,
    ):
        found = survey_geometry(
            described,
            upside_down=list(of_ball.values()),
            balancing=[(log, Log.read(film)) for log, film in zip(of_runs.values(), films, strict=True)],
            progress=bar.report,
        )
        of_geometry = geometry_findings(found)
        bar.begin_writing()
        with result.replaced() as new:
            try:
                write_robot(robot_with_geometry(described, found), new / "robot.toml")
            except InputError as error:
                text = (
                    "No robot.toml was written, because the geometry found is not "
                    f"possible with the other values of the robot file: {error}"
                )
                of_geometry.append(note("no-robot-file", text))
            result.write_json(found.to_dict(), new, findings=[*findings, *of_geometry])
            page = geometry_report(
                found, of_geometry, robot=described, made=result.origin, log_findings=findings
            )
            result.write_page(page, new)
    result.show(geometry_parts(found, of_geometry))
    result.show_file(PAGE)


def _checked(
    robot: Robot, of_ball: Mapping[Path, Log], of_runs: Mapping[Path, Log], accept: list[str] | None
) -> tuple[Finding, ...]:
    """Return what is wrong with the robot and its logs; stop on an error that is not accepted.

    The robot's radii are estimated, so that encoders need not agree with them closely.
    """
    encoders = (
        replace(one, where=replace(one.where, file=str(path)))
        for path, log in of_ball.items()
        for one in encoder_findings(robot, log, like=_RADII)
    )
    of_bench = bench_findings(robot, {str(path): log for path, log in {**of_ball, **of_runs}.items()})
    findings = by_severity([*of_bench, *encoders])
    stop_or_show(findings, accept=accept)
    return findings
