"""`ballbot identify-geometry`: radii, tilt, azimuths and the IMU's mounting, from logs."""

from __future__ import annotations

from pathlib import Path

from ballbot.cli import options
from ballbot.cli.context import open_result, read_logs
from ballbot.cli.findings import in_file, stop_or_show
from ballbot.errors import InputError
from ballbot.findings import note
from ballbot.identification.bench_checks import encoder_findings
from ballbot.identification.geometry import (
    geometry_findings,
    robot_with_geometry,
    survey_geometry,
)
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.report.bench import geometry_report
from ballbot.robot import Robot
from ballbot.robot.file import robot_text
from ballbot.summary import counted

#: r_b / r_w by the logs over the file's; beyond, a unit or a column is wrong rather than a tape measure
_RADII = (0.4, 2.5)


def identify_geometry(
    robot: options.Robot,
    /,
    *,
    upside_down: list[Path] | None = None,
    balancing: list[Path] | None = None,
    motion_capture: list[Path] | None = None,
    mapping: options.Mapping = None,
    accept: options.Accept = None,
    out: options.Out,
) -> None:
    """Identify radii, tilt, azimuths and the mounting of the IMU from logs, by kinematics alone.

    Writes report.html, results.json and robot.toml (the identified geometry, with its standard deviations).

    Example: ballbot identify-geometry alten --upside-down up.csv --balancing run.csv --motion-capture mocap.csv
    --out geometry

    Parameters
    ----------
    upside_down
        Logs of the robot clamped upside down: wheel angles and ball_omega_x, _y, _z in the robot's frame.
    balancing
        Logs of the robot balancing: wheel angles and gyro_x, _y, _z.
    motion_capture
        One file for each balancing log, in the same order: t, x y z of the ball's centre, qw qx qy qz of the body; on
        any clock and in any frame.
    """
    described = Robot.load(robot)
    on_wheels, runs, films = upside_down or [], balancing or [], motion_capture or []
    if len(runs) != len(films):
        numbers = counted(len(runs), "time"), counted(len(films), "time")
        raise InputError(
            f"--balancing is given {numbers[0]} and --motion-capture {numbers[1]}. Give one motion capture for each "
            "balancing log, in the same order."
        )
    of_ball = list(read_logs(on_wheels, mapping).values()) if on_wheels else []
    of_runs = list(read_logs(runs, mapping).values()) if runs else []
    named = dict(zip(map(str, (*on_wheels, *runs)), (*of_ball, *of_runs), strict=True))
    # the robot's radii are estimated, so that encoders need not agree with them closely
    encoders = [
        finding
        for path, log in zip(on_wheels, of_ball, strict=True)
        for finding in in_file(path, encoder_findings(described, log, like=_RADII))
    ]
    findings = stop_or_show([*bench_findings(described, named), *encoders], accept=accept)
    with open_result(
        out,
        doing="identifying the geometry",
        writes=["robot.toml"],
        inputs=[on_wheels, runs, films, mapping, robot],
    ) as result:
        found = survey_geometry(
            described,
            upside_down=of_ball,
            balancing=[(log, Log.read(film)) for log, film in zip(of_runs, films, strict=True)],
            progress=result.report,
        )
        of_geometry, files = geometry_findings(found), dict[str, str]()
        try:
            files["robot.toml"] = robot_text(robot_with_geometry(described, found))
        except InputError as error:
            text = (
                "No robot.toml was written, because the geometry found is not possible with the other values of the "
                f"robot file: {error}"
            )
            of_geometry.append(note("no-robot-file", text))
        page = geometry_report(found, of_geometry, robot=described, log_findings=findings)
        step = (
            f"`ballbot study {result.path('robot.toml')} LOG --out found`, with logs of balancing"
            if files
            else ""
        )
        result.write(page, files=files, next_step=step)
