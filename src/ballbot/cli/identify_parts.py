"""`ballbot identify-driveline`, `-upside-down`, `-geometry` and `-axis`: a part of a robot, or any axis, by itself."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli import options
from ballbot.cli.context import open_result, read_logs
from ballbot.cli.findings import in_files, stop_or_show
from ballbot.errors import InputError
from ballbot.findings import by_severity, check_codes, note
from ballbot.fitting.run import Run
from ballbot.identification import axis
from ballbot.identification.axis.checks import ERROR_CODES, record_findings
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.identification.bench_checks import encoder_findings, sweep_findings, upside_down_findings
from ballbot.identification.driveline import fit_driveline, robot_with_friction, sweep_estimate, sweeps_of
from ballbot.identification.geometry import geometry_findings, robot_with_geometry, survey_geometry
from ballbot.identification.stated_uncertainty import file_findings
from ballbot.identification.upside_down import identify_upside_down as find_friction
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.log.pose import read_motion_capture
from ballbot.progress import in_stage
from ballbot.report.axis import axis_report
from ballbot.report.bench import driveline_report, geometry_report, upside_down_report
from ballbot.robot import Robot
from ballbot.robot.file import robot_text
from ballbot.summary import counted

#: plausible ratios of r_b / r_w from the logs to the file's; outside, a unit or a column is wrong
_RADII = (0.4, 2.5)
_COLUMNS, _METHOD = AxisColumns(), axis.AxisOptions()


def identify_driveline(
    robot: options.Robot,
    log: Path,
    /,
    *,
    out: options.Out,
    mapping: options.Mapping = None,
    accept: options.Accept = None,
) -> None:
    """Identify b, c, s, v_s and delta of each driveline from a torque sweep with the wheels off the ball.

    Each wheel is an axis of the robot file's inertia (`ballbot identify-axis`) with that law. Writes report.html,
    results.json and robot.toml (with each wheel's b, c and s, the means of v_s and delta, their standard deviations and
    correlations). If the friction in the robot file has standard deviations, the two are compared.

    Example: ballbot identify-driveline alten sweep/log.csv --out found

    Parameters
    ----------
    log
        A log with torques and wheel speeds of a slow sweep with the wheels off the ball, not of the robot balancing.
    """
    described = Robot.load(robot)
    read = Log.read(log, mapping=mapping, robot=described)
    sweeps = sweeps_of(described, read)
    of_sweep = in_files([(log, sweep_findings(described, sweeps))])
    of_log = bench_findings(described, {str(log): read})
    findings = stop_or_show([*of_log, *of_sweep], accept=accept)
    with open_result(out, doing="sweep", writes=["robot.toml"]) as result:
        fits = [
            fit_driveline(sweep, run=Run(progress=in_stage(result.report, f"wheel {sweep.wheel}")))
            for sweep in sweeps
        ]
        estimate = sweep_estimate(fits)
        findings = by_severity([*findings, *file_findings(described, estimate)])
        source = f"identified: sweep of the free wheels, {log.name}"
        files = {"robot.toml": robot_text(robot_with_friction(described, estimate, source=source))}
        page = driveline_report(described.name, sweeps, fits, findings)
        step = f"`ballbot identify {robot} LOG --out found`, with logs of balancing"
        result.write(page, files=files, next_step=step)


def identify_upside_down(
    robot: options.Robot,
    /,
    *logs: options.Log,
    out: options.Out,
    mapping: options.Mapping = None,
    seed: options.Seed = 0,
    window: options.Window = 1.0,
    accept: options.Accept = None,
) -> None:
    """Identify the friction of drivelines and ball-wheel contacts with the robot clamped upside down.

    The ball lies on the wheels, and a camera gives its angular velocity; wheel speeds, if logged, are used. If
    the robot file already has friction, as after `ballbot identify`, both are validated on the same windows.

    Writes report.html, robot.toml (the robot with the identified friction, if it is usable) and results.json.

    Example: ballbot identify-upside-down alten upside_down.csv --out found

    Parameters
    ----------
    logs
        One or more logs with u1, u2 .. and ball_omega_x, _y, _z in the robot's frame.
    """
    described = Robot.load(robot)
    named = read_logs(logs, mapping, described)
    by_path = dict(zip(map(str, logs), named.values(), strict=True))
    of_ball = in_files(
        (path, upside_down_findings(described, log)) for path, log in zip(logs, named.values(), strict=True)
    )
    findings = stop_or_show([*bench_findings(described, by_path), *of_ball], accept=accept)
    with open_result(out, doing="identifying", writes=["robot.toml"], seed=seed) as result:
        run = Run(seed=seed, progress=result.report)
        fit = find_friction(described, list(named.values()), window=window, run=run)
        page = upside_down_report(fit, named, findings=findings)
        step = f"`ballbot study {result.path('robot.toml')} LOG --out found`, with logs of balancing"
        result.write_robot(page, fit.robot, fit.verdict, next_step=step)


def identify_geometry(
    robot: options.Robot,
    /,
    *,
    upside_down: list[Path] | None = None,
    balancing: list[Path] | None = None,
    motion_capture: list[Path] | None = None,
    mapping: options.Mapping = None,
    mocap_mapping: options.MocapMapping = None,
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
    on_wheels, runs, captures = upside_down or [], balancing or [], motion_capture or []
    if len(runs) != len(captures):
        numbers = counted(len(runs), "time"), counted(len(captures), "time")
        raise InputError(
            f"--balancing is given {numbers[0]} and --motion-capture {numbers[1]}. Give one motion capture for each "
            "balancing log, in the same order."
        )
    of_ball = list(read_logs(on_wheels, mapping, described).values()) if on_wheels else []
    of_runs = list(read_logs(runs, mapping, described).values()) if runs else []
    named = dict(zip(map(str, (*on_wheels, *runs)), (*of_ball, *of_runs), strict=True))
    # the radii are estimated, so that encoders may differ from them
    encoders = in_files(
        (path, encoder_findings(described, log, like=_RADII))
        for path, log in zip(on_wheels, of_ball, strict=True)
    )
    findings = stop_or_show([*bench_findings(described, named), *encoders], accept=accept)
    cameras = [read_motion_capture(capture, mocap_mapping) for capture in captures]
    of_cameras = ((capture, mocap.changes) for capture, mocap in zip(captures, cameras, strict=True))
    stop_or_show(in_files(of_cameras), accept=accept)
    with open_result(out, doing="identifying the geometry", writes=["robot.toml"]) as result:
        geometry = survey_geometry(
            described,
            upside_down=of_ball,
            balancing=[*zip(of_runs, cameras, strict=True)],
            accept=accept or (),
            progress=result.report,
        )
        step = f"`ballbot study {result.path('robot.toml')} LOG --out found`, with logs of balancing"
        of_geometry, files = geometry_findings(geometry), dict[str, str]()
        try:
            files["robot.toml"] = robot_text(robot_with_geometry(described, geometry))
        except InputError as error:
            text = (
                "No robot.toml was written, because the identified geometry is not possible with the other values of "
                f"the robot file: {error}"
            )
            of_geometry.append(note("no-robot-file", text))
            step = f"correct {robot} as the note no-robot-file says, and repeat this command."
        page = geometry_report(geometry, of_geometry, robot=described, log_findings=findings)
        result.write(page, files=files, next_step=step)


def identify_axis(
    record: Path,
    /,
    *against: Path,
    out: options.Out,
    also: Annotated[list[Path] | None, Parameter(negative="")] = None,
    columns: Annotated[AxisColumns, Parameter(name="*")] = _COLUMNS,
    mapping: options.Mapping = None,
    method: Annotated[axis.AxisOptions, Parameter(name="*")] = _METHOD,
    accept: options.Accept = None,
) -> None:
    """Identify the mass (or inertia) and friction of one axis from records of its force and position.

    The fit starts from the inverse model by least squares and minimises the output error over windows. Forces over
    position, friction under load and the friction law are selected by the prediction of held-out blocks of time. Writes
    report.html and results.json.
    For a robot's own drivelines use `ballbot identify-driveline`.

    Example: ballbot identify-axis axis.csv --out found

    Parameters
    ----------
    record
        A log file (docs/logs.md), its columns or variables by name.
    against
        Other records of the same axis, with the same columns, used only for validation.
    also
        A further record that is fitted together with the first one; may be given several times.
    """
    check_codes(accept or (), listed=ERROR_CODES)
    fitted = (record, *(also or ()))
    paths = (*fitted, *against)
    read = [read_axis_record(path, columns, mapping=mapping) for path in paths]
    of_records = ((path, record_findings(own)) for path, own in zip(paths, read, strict=True))
    findings = stop_or_show(in_files(of_records), accept=accept)
    with open_result(out, doing="identifying the axis") as result:
        fit = axis.identify_axis(
            read[: len(fitted)],
            options=method,
            validation_records=read[len(fitted) :],
            run=Run(progress=result.report),
        )
        step = "name another record of the axis after this one, to validate the result."
        if against:
            step = "take mass and friction from results.json into your model of the axis."
        result.write(axis_report(fit, read[0], findings), next_step=step)
