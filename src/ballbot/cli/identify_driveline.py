"""`ballbot identify-driveline`: the thesis's first stage, one driveline with its wheel free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ballbot.cli.context import PAGE, input_files, open_result
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.findings import Finding, by_severity
from ballbot.fitting.run import Run
from ballbot.identification.agreement import file_findings
from ballbot.identification.bench_checks import sweep_findings
from ballbot.identification.driveline import (
    Sweep,
    fit_drivelines,
    robot_of_sweep,
    sweep_estimate,
    sweeps_of,
)
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.log.mapping import dead_band_findings
from ballbot.report.driveline import (
    driveline_parts,
    driveline_report,
    driveline_results,
)
from ballbot.robot import Robot
from ballbot.robot.file import write_robot

_WRITTEN = (PAGE, "results.json", "robot.toml")


def identify_driveline(
    robot: str,
    log: Path,
    /,
    *,
    out: Path,
    mapping: Path | None = None,
    speed_limit: float | None = None,
    accept: Accept = None,
) -> None:
    """Identify b, c, s and v_s of each driveline from a torque sweep with the wheels off the ball.

    Each wheel is an axis of the robot file's inertia (`ballbot identify-axis`) with that law. Writes report.html,
    results.json and robot.toml (with each wheel's b, c and s, the mean of v_s, and their standard deviations and
    correlations). Friction in the robot file that states standard deviations is compared.

    Example: ballbot identify-driveline alten sweep/log.csv --out found

    Parameters
    ----------
    robot
        A preset's name or a robot file, which gives the inertia.
    log
        A log with torques and wheel speeds of a slow sweep with the wheels off the ball, not of the robot balancing.
    out
        The folder to write into.
    mapping
        A TOML file that describes the columns and units of a foreign log, as `ballbot check-log` writes it.
    speed_limit
        Speed limit of the supply [rad/s]. If not given, the greatest speed in the log.
    """
    described = Robot.load(robot)
    read = Log.read(log, mapping=mapping)
    sweeps = sweeps_of(described, read, limit=speed_limit)
    findings = _checked(described, log, read, sweeps, mapping, accept)
    inputs = input_files(robot, log, mapping)
    with open_result(out, command="identify-driveline", writes=_WRITTEN, inputs=inputs) as result:
        with result.progress("sweep") as bar:
            fits = fit_drivelines(sweeps, run=Run(progress=bar.report))
        findings = by_severity([*findings, *file_findings(described, sweep_estimate(fits))])
        identified = robot_of_sweep(described, fits, log=log.name)
        made = result.origin
        page = driveline_report(described.name, sweeps, fits, made, findings)
        with result.replaced() as new:
            write_text(new / "results.json", results_text(driveline_results(fits, made, findings)))
            result.write_page(page, new)
            write_robot(identified, new / "robot.toml")
    result.show(driveline_parts(fits))
    result.show_file(PAGE)


def _checked(
    robot: Robot,
    file: Path,
    log: Log,
    sweeps: Sequence[Sweep],
    mapping: Path | None,
    accept: list[str] | None,
) -> tuple[Finding, ...]:
    """Return what checks of the robot, the log and the sweeps found; stop on an error that is not accepted."""
    of_sweeps = (
        replace(one, where=replace(one.where, file=str(file))) for one in sweep_findings(robot, sweeps)
    )
    findings = by_severity(
        [*bench_findings(robot, {str(file): log}), *of_sweeps, *dead_band_findings([mapping])]
    )
    stop_or_show(findings, accept=accept)
    return findings
