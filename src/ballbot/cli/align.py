"""`ballbot align`: a log's sensors against motion capture."""

from pathlib import Path

from ballbot.cli import options
from ballbot.cli.context import open_result
from ballbot.cli.findings import check_input, in_files, stop_or_show
from ballbot.errors import about
from ballbot.log import Log
from ballbot.log.collection import named_files
from ballbot.log.pose import read_motion_capture
from ballbot.report.alignment import alignment_report
from ballbot.report.words import logs_words
from ballbot.validation.alignment import align as align_log


def align(
    log: Path,
    mocap: Path,
    /,
    *,
    out: options.Out,
    mapping: options.Mapping = None,
    mocap_mapping: options.MocapMapping = None,
    robot: options.MotorsOf = None,
    accept: options.Accept = None,
) -> None:
    """Compare a log's sensors with motion capture of the same run; clocks and frames may differ.

    Estimates the clock's offset and rate, both frames, the lever arm and the scale of the path, then errors and
    drifts. Writes report.html (Figures IV.1 to IV.4), results.json and aligned.csv: the log with mocap_x, mocap_y,
    mocap_z, mocap_theta, mocap_phi, mocap_psi at its own times and in its own world frame, empty while the cameras
    do not see the robot.

    Example: ballbot align run.csv run_mocap.csv --out aligned

    Parameters
    ----------
    log
        The robot's log, with gyro_x, gyro_y, gyro_z or theta, phi, psi. Errors are computed for the angles and x, y if
        the log has them.
    mocap
        The motion-capture file: t, qw qx qy qz of the body, and x y z of the ball's centre or of any point of the
        body.
    """
    run = Log.read(log, mapping=mapping, robot=robot)
    cameras = read_motion_capture(mocap, mocap_mapping)
    stop_or_show(in_files([(mocap, cameras.changes)]), accept=accept)
    findings = check_input(None, [log], [run], accept=accept)
    (name,) = named_files([log])
    with open_result(out, doing="aligning", writes=["aligned.csv"]) as result:
        with about(f"{log} and {mocap}"):
            alignment = align_log(run, cameras)
        findings += stop_or_show(in_files([(mocap, alignment.doubts)]), accept=accept)
        page = alignment_report(
            alignment,
            title=f"{name}: sensors against motion capture",
            lead=f"{logs_words({name: run})}, beside the motion capture in {mocap.name}.",
            log_findings=findings,
        )
        mapped = f" --mocap-mapping {mocap_mapping}" if mocap_mapping else ""
        step = f"identify-geometry ROBOT --balancing {log} --motion-capture {mocap}{mapped} --out geometry"
        result.write(page, files={"aligned.csv": alignment.log.write}, next_step=f"`ballbot {step}`")
