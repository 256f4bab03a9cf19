"""`ballbot identify-driveline`: the thesis's first stage, one driveline with its wheel free."""

from __future__ import annotations

from pathlib import Path

from ballbot.cli import options
from ballbot.cli.context import open_result
from ballbot.cli.findings import in_file, stop_or_show
from ballbot.findings import by_severity
from ballbot.fitting.run import Run
from ballbot.identification.agreement import file_findings
from ballbot.identification.bench_checks import sweep_findings
from ballbot.identification.driveline import fit_drivelines, robot_with_friction, sweep_estimate, sweeps_of
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.log.mapping import dead_band_findings
from ballbot.report.bench import driveline_report
from ballbot.robot import Robot
from ballbot.robot.file import robot_text


def identify_driveline(
    robot: options.Robot,
    log: Path,
    /,
    *,
    out: options.Out,
    mapping: options.Mapping = None,
    speed_limit: float | None = None,
    accept: options.Accept = None,
) -> None:
    """Identify b, c, s and v_s of each driveline from a torque sweep with the wheels off the ball.

    Each wheel is an axis of the robot file's inertia (`ballbot identify-axis`) with that law. Writes report.html,
    results.json and robot.toml (with each wheel's b, c and s, the mean of v_s, and their standard deviations and
    correlations). Friction in the robot file that states standard deviations is compared.

    Example: ballbot identify-driveline alten sweep/log.csv --out found

    Parameters
    ----------
    log
        A log with torques and wheel speeds of a slow sweep with the wheels off the ball, not of the robot balancing.
    speed_limit
        Speed limit of the supply [rad/s]. If not given, the greatest speed in the log.
    """
    described = Robot.load(robot)
    read = Log.read(log, mapping=mapping)
    sweeps = sweeps_of(described, read, limit=speed_limit)
    findings = stop_or_show(
        [
            *bench_findings(described, {str(log): read}),
            *in_file(log, sweep_findings(described, sweeps)),
            *dead_band_findings([mapping]),
        ],
        accept=accept,
    )
    with open_result(out, doing="sweep", writes=["robot.toml"], inputs=[robot, log, mapping]) as result:
        fits = fit_drivelines(sweeps, run=Run(progress=result.report))
        estimate = sweep_estimate(fits)
        findings = by_severity([*findings, *file_findings(described, estimate)])
        source = f"identified: sweep of the free wheels, {log.name}"
        identified = robot_with_friction(described, estimate, source=source)
        page = driveline_report(described.name, sweeps, fits, findings)
        files = {"robot.toml": robot_text(identified)}
        sweep = result.path("results.json")
        step = f"`ballbot identify {robot} LOG --sweep {sweep} --out found`, with logs of balancing"
        result.write(page, files=files, next_step=step)
