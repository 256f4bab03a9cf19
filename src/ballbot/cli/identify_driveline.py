"""`ballbot identify-driveline`: the thesis's first stage, one driveline with its wheel free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ballbot.cli.context import PAGE, WholeNumber, input_files, open_result
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.findings import Finding, by_severity
from ballbot.fitting.run import Run
from ballbot.identification.agreement import file_findings
from ballbot.identification.driveline import (
    LOWER,
    UPPER,
    Sweep,
    driveline_parameters,
    fit_drivelines,
    sweeps_of,
)
from ballbot.identification.driveline_checks import sweep_findings
from ballbot.identification.driveline_robot import robot_of_sweep, sweep_estimate
from ballbot.identification.windows import back_emf_of
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.log.mapping_file import dead_band_findings
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
    lower: tuple[float, float, float, float, float] = LOWER,
    upper: tuple[float, float, float, float, float] = UPPER,
    seed: WholeNumber = 0,
    accept: Accept = None,
) -> None:
    """Identify b, c, s, v_s and delta of each driveline from a torque sweep with the wheels off the ball.

    Writes report.html, results.json and robot.toml (with each wheel's b, c and s, the means of v_s and delta, and
    their standard deviations and correlations). Friction in the robot file that states standard deviations is compared.

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
    lower
        Lower bounds of b, c, s, v_s and delta.
    upper
        Upper bounds of b, c, s, v_s and delta.
    seed
        Random seed. The same seed gives the same result.
    """
    described = Robot.load(robot)
    read, back_emf = Log.read(log, mapping=mapping), back_emf_of(mapping)
    sweeps = sweeps_of(described, read, limit=speed_limit, back_emf=back_emf)
    findings = _checked(described, log, read, sweeps, mapping, accept)
    space = driveline_parameters(lower=lower, upper=upper)
    inputs = input_files(robot, log, mapping)
    with open_result(out, command="identify-driveline", writes=_WRITTEN, inputs=inputs, seed=seed) as result:
        with result.progress("sweep") as bar:
            fits, printed = fit_drivelines(sweeps, space=space, run=Run(seed=seed, progress=bar.report))
        findings = by_severity([*findings, *file_findings(described, sweep_estimate(fits))])
        identified = robot_of_sweep(described, fits, log=log.name)
        made = result.origin
        page = driveline_report(described.name, sweeps, fits, printed, made, findings)
        with result.replaced() as new:
            write_text(new / "results.json", results_text(driveline_results(fits, printed, made, findings)))
            result.write_page(page, new)
            write_robot(identified, new / "robot.toml")
    result.show(driveline_parts(fits, printed))
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
