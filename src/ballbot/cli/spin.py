"""`ballbot spin`: the ball's angular velocity from a video of its seam."""

import math
from dataclasses import replace
from pathlib import Path

from ballbot.arguments import numbers_listed
from ballbot.cli import options
from ballbot.cli.context import Content, open_result
from ballbot.cli.findings import stop_or_show
from ballbot.errors import InputError, about
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.report.spin import spin_report
from ballbot.robot import Robot
from ballbot.vision.seam import seam_named
from ballbot.vision.spin import compare_with_wheels, facing, log_with_spin, measure_spin, overlay
from ballbot.vision.video import open_video

_WRITTEN = ("spin.csv", "overlay.png", "log.csv")


def spin(
    video: Path,
    /,
    *,
    out: options.Out,
    seam: str = "thesis",
    circle: str | None = None,
    forward: float | None = None,
    frame_rate: float | None = None,
    log: Path | None = None,
    robot: str | None = None,
    mapping: options.Mapping = None,
    accept: options.Accept = None,
) -> None:
    """Measure the ball's angular velocity from a video of its seam, seen from above on the upside-down robot.

    Finds the ball, its seam and the camera's distance, follows the seam frame by frame, and with a log compares the
    result with the ball's velocity by the wheels' speeds. Writes report.html, spin.csv (t, ball_omega_x,
    _y, _z, their standard errors, tracked), results.json and overlay.png; with a log also log.csv, the log with
    ball_omega.

    Example: ballbot spin upside_down.mp4 --log upside_down/log.csv --robot alten --out spin

    Parameters
    ----------
    video
        Any file that OpenCV reads. The camera stands still and looks down on the ball.
    seam
        tennis, basketball, or thesis: one closed curve like a tennis ball's with narrower necks, as of tape on a plain
        ball.
    circle
        The ball's outline, as x,y,radius in pixels. Estimated if not given.
    forward
        Direction of the robot's x axis in the picture, in degrees clockwise from the right. If not given, it is
        estimated from the log; without a log, velocities are in the camera's frame: x to the right, y down, z away.
    frame_rate
        Frame rate of the camera [1/s], if the file states a different one, as for slow motion.
    log
        A log of the same run, with the wheels' speeds.
    robot
        A preset's name or a robot file; needed with a log.
    """
    if log is not None and robot is None:
        raise InputError(
            "--log needs --robot, because the ball's velocity is "
            "computed from the wheel speeds with the robot's geometry."
        )
    turn = None if forward is None else facing(math.radians(forward))
    outline = None
    if circle is not None:
        wanted = "x,y,radius in pixels, such as 320,240,150"
        x, y, radius = numbers_listed(circle, "--circle", count=3, wanted=wanted)
        outline = (x, y, radius)
    curve = seam_named(seam)
    described = Robot.load(robot) if robot is not None else None
    run = Log.read(log, mapping=mapping, robot=described) if log is not None else None
    findings = bench_findings(described, {str(log): run}) if described and run else ()
    stop_or_show(findings, accept=accept, others="`ballbot check-log`")
    film = open_video(video, frame_rate=frame_rate)
    with open_result(out, doing="looking", writes=_WRITTEN) as result:
        measured = measure_spin(
            film,
            seam=curve,
            circle=outline,
            progress=lambda now: result.report(replace(now, note=video.stem)),
        )
        comparison, files = None, dict[str, Content]()
        if run is not None and described is not None:
            with about(f"{video} and {log}"):
                comparison = compare_with_wheels(measured, run, described, known=turn)
            turn = turn or comparison.motion.body_marker
        measured = replace(measured, robot_camera=turn) if turn is not None else measured
        if run is not None and comparison is not None:
            files["log.csv"] = log_with_spin(run, measured, comparison.motion.clock).write
        files |= {"spin.csv": measured.log().write, "overlay.png": (picture := overlay(measured))}
        page = spin_report(measured, comparison, video=video.name, picture=picture, log_findings=findings)
        step = "give the log of the run with --log and --robot."
        if run is not None:
            step = f"`ballbot identify-upside-down {robot} {result.path('log.csv')} --out found`"
        result.write(page, files=files, named=["spin.csv"], next_step=step)
