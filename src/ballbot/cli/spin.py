"""`ballbot spin`: the ball's angular velocity from a video of its seam."""

from __future__ import annotations

import math
from pathlib import Path

from scipy.spatial.transform import Rotation

from ballbot.cli.findings import Accept, accept_argv, stop_or_show
from ballbot.cli.output import progress_bar, standard_output
from ballbot.errors import InputError
from ballbot.files import write_bytes, write_text
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.printable import shell_line
from ballbot.report.page import as_json, provenance
from ballbot.report.spin import difference_figure, spin_results, velocity_figure
from ballbot.report.style import drawn
from ballbot.result_folder import result_folder
from ballbot.robot import Robot
from ballbot.vision.comparison import WheelComparison, compare_with_wheels, log_with_spin, spin_findings
from ballbot.vision.seam import seam_named
from ballbot.vision.spin import Setup, Spin, facing, measure_spin, overlay
from ballbot.vision.video import open_video

_WRITTEN = ("spin.csv", "results.json", "velocity.svg", "overlay.png", "difference.svg", "log.csv")


def spin(
    video: Path,
    /,
    *,
    out: Path,
    seam: str = "thesis",
    colour: str | None = None,
    circle: str | None = None,
    distance: float | None = None,
    forward: float | None = None,
    frame_rate: float | None = None,
    log: Path | None = None,
    robot: str | None = None,
    mapping: Path | None = None,
    accept: Accept = None,
) -> None:
    """Measure the ball's angular velocity from a video of its seam, seen from above on the upside-down robot.

    Finds the ball, its seam and the camera's distance, follows the seam frame by frame, and with a log compares the
    result with T_obw times the wheels' speeds (the thesis's Figure V.2). Writes spin.csv (t, ball_omega_x, _y,
    _z, their standard errors, tracked), results.json, velocity.svg and overlay.png; with a log also difference.svg
    and log.csv, the log with ball_omega.

    Example: ballbot spin upside_down.mp4 --log upside_down.csv --robot alten --out spin

    Parameters
    ----------
    video
        Any file that OpenCV reads. The camera stands still and looks down on the ball.
    out
        The folder to write into.
    seam
        thesis, tennis or basketball.
    colour
        The seam's colour, as red,green,blue from 0 to 255. Estimated if not given.
    circle
        The ball's outline, as x,y,radius in pixels. Estimated if not given.
    distance
        Distance from the lens to the ball's centre, in ball radii. Estimated from the seam's perspective if not given.
    forward
        Direction of the robot's x axis in the picture, in degrees clockwise from the right. If not given, it is
        estimated from the log; without a log, velocities are in the camera's frame: x to the right, y down, z away.
    frame_rate
        Frames per second of the camera, if the file states another number, as for slow motion.
    log
        A log of the same run, with the wheels' speeds.
    robot
        A preset's name or a robot file; needed with a log.
    mapping
        A TOML file that describes the columns and units of a foreign log, as `ballbot check-log` writes it.
    """
    if log is not None and robot is None:
        raise InputError(
            "--log needs --robot, because the ball's velocity is "
            "computed from the wheel speeds with the robot's geometry."
        )
    turn = _turn(forward)
    setup = Setup(
        seam=seam_named(seam),
        colour=_colour(colour) if colour is not None else None,
        circle=_circle(circle) if circle is not None else None,
        distance=distance,
        known_rate=frame_rate is not None,
    )
    run = Log.read(log, mapping=mapping) if log is not None else None
    described = Robot.load(robot) if robot is not None else None
    findings = bench_findings(described, {str(log): run}) if described and run else ()
    stop_or_show(findings, accept=accept)
    film = open_video(video, frame_rate=frame_rate)
    console, files = standard_output(), [path for path in (video, log, mapping) if path is not None]
    with result_folder(out, command="spin", names=_WRITTEN, inputs=files) as folder:
        with progress_bar(console, "looking") as bar:
            found = measure_spin(
                film,
                setup,
                progress=lambda now: bar.show(now.share, doing=now.stage, note=video.stem),
            )
        comparison = None
        if run is not None and described is not None:
            try:
                comparison = compare_with_wheels(found, run, described, known=turn)
            except InputError as error:
                raise InputError(f"{video} and {log}: {error}") from None
            turn = turn or comparison.robot_camera
        found = found.turned(turn) if turn is not None else found
        options = {"seam": seam, "colour": colour, "circle": circle, "distance": distance, "forward": forward,
                   "frame-rate": frame_rate, "log": log, "robot": robot, "mapping": mapping}  # fmt: skip
        words = ["ballbot", "spin", str(video), "--out", str(out)]
        words += [
            word for name, value in options.items() if value is not None for word in (f"--{name}", str(value))
        ]
        words += accept_argv(accept)
        made = provenance(command=shell_line(words), files=files, seed=0)
        with folder.replaced() as new:
            results = spin_results(found, comparison, log_findings=findings)
            write_text(new / "results.json", as_json(results | {"provenance": made.to_dict()}))
            _write(new, found, comparison, run)
    for sentence in spin_findings(found, comparison):
        console.print(sentence, markup=False, soft_wrap=True)
    console.print(str(folder.path / "spin.csv"), soft_wrap=True)


def _write(folder: Path, found: Spin, comparison: WheelComparison | None, run: Log | None) -> None:
    found.log().write(folder / "spin.csv")
    write_text(folder / "velocity.svg", drawn(lambda: velocity_figure(found, comparison), name="velocity"))
    write_bytes(folder / "overlay.png", overlay(found))
    if run is None or comparison is None:
        return
    difference = drawn(lambda: difference_figure(found, comparison), name="difference")
    write_text(folder / "difference.svg", difference)
    log_with_spin(run, found, comparison.clock).write(folder / "log.csv")


def _turn(forward: float | None) -> Rotation | None:
    if forward is None:
        return None
    if not math.isfinite(forward):
        raise InputError(f"--forward is {forward:g}; it must be an angle in degrees.")
    return facing(math.radians(forward))


def _circle(text: str) -> tuple[float, float, float]:
    values = _numbers(text)
    if len(values) != 3:
        raise InputError(f"--circle is {text!r}; it must be x,y,radius in pixels, such as 320,240,150.")
    return values[0], values[1], values[2]


def _colour(text: str) -> tuple[int, int, int]:
    values = _numbers(text)
    if len(values) != 3 or not all(0.0 <= value <= 255.0 for value in values):
        raise InputError(
            f"--colour is {text!r}; it must be red,green,blue from 0 to 255, such as 225,190,40."
        )
    return round(values[0]), round(values[1]), round(values[2])


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return []
