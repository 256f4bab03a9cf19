"""`ballbot spin`: the ball's angular velocity from a video of its seam."""

from dataclasses import replace
from pathlib import Path

from ballbot.arguments import numbers_listed
from ballbot.cli import options
from ballbot.cli.context import open_result
from ballbot.cli.findings import stop_or_show
from ballbot.errors import about
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.report.spin import spin_report
from ballbot.robot import Robot
from ballbot.vision.seam import seam_named
from ballbot.vision.spin import compare_with_wheels, log_with_spin, measure_spin, overlay
from ballbot.vision.video import open_video

_WRITTEN = ("spin.csv", "overlay.png", "log.csv")


def spin(
    video: Path,
    /,
    *,
    log: Path,
    robot: str,
    out: options.Out,
    seam: str = "thesis",
    circle: str | None = None,
    frame_rate: float | None = None,
    mapping: options.Mapping = None,
    accept: options.Accept = None,
) -> None:
    """Measure the ball's angular velocity from a video of its seam, seen from above on the upside-down robot.

    Finds the ball, its seam and the camera's distance, follows the seam frame by frame, and compares the result with
    the ball's velocity by the wheels' speeds, which also gives the direction of the robot's x axis in the picture.
    Writes report.html, spin.csv (t, ball_omega_x, _y, _z, their standard errors, tracked), results.json, overlay.png
    and log.csv, the log with ball_omega.

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
    frame_rate
        Frame rate of the camera [1/s], if the file states a different one, as for slow motion.
    log
        A log of the same run, with the wheels' speeds.
    robot
        A preset's name or a robot file, by whose geometry the ball's velocity follows from the wheels' speeds.
    """
    outline = None
    if circle is not None:
        wanted = "x,y,radius in pixels, such as 320,240,150"
        x, y, radius = numbers_listed(circle, "--circle", count=3, wanted=wanted)
        outline = (x, y, radius)
    curve = seam_named(seam)
    described = Robot.load(robot)
    run = Log.read(log, mapping=mapping, robot=described)
    findings = bench_findings(described, {str(log): run})
    stop_or_show(findings, accept=accept, others="`ballbot check-log`")
    film = open_video(video, frame_rate=frame_rate)
    with open_result(out, doing="looking", writes=_WRITTEN) as result:
        measured = measure_spin(
            film,
            seam=curve,
            circle=outline,
            progress=lambda now: result.report(replace(now, note=video.stem)),
        )
        with about(f"{video} and {log}"):
            comparison = compare_with_wheels(measured, run, described)
        measured, picture = replace(measured, robot_camera=comparison.motion.body_marker), overlay(measured)
        page = spin_report(measured, comparison, video=video.name, picture=picture, log_findings=findings)
        files = {
            "spin.csv": measured.log().write,
            "overlay.png": picture,
            "log.csv": log_with_spin(run, measured, comparison.motion.clock).write,
        }
        step = f"`ballbot identify-upside-down {robot} {result.path('log.csv')} --out found`"
        result.write(page, files=files, named=["spin.csv"], next_step=step)
