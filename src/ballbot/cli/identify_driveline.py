"""`ballbot identify-driveline`: the thesis's first stage, one driveline with its wheel free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from ballbot.cli.context import CommandResult, WholeNumber, input_files, open_result
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.cli.output import table
from ballbot.files import write_text
from ballbot.findings import Finding, by_severity
from ballbot.fitting.parameter import ParameterSpace
from ballbot.fitting.run import Run
from ballbot.identification.driveline import (
    LOWER,
    UPPER,
    DrivelineFit,
    PrintedFit,
    Sweep,
    driveline_parameters,
    fit_as_printed,
    fit_driveline,
    sweeps_of,
)
from ballbot.identification.driveline_checks import sweep_findings
from ballbot.identification.windows import back_emf_of
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.progress import Progress, part_of
from ballbot.report.driveline import (
    driveline_findings,
    driveline_report,
    driveline_results,
    error_rows,
    parameter_rows,
)
from ballbot.results import as_json
from ballbot.robot import Friction, Robot
from ballbot.robot.file import write_robot

_WRITTEN = ("report.html", "results.json", "robot.toml")

#: share of a wheel's work that the fit to its pieces is
_PIECES = 0.5


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

    The first of the thesis's three stages (section 3.1), with its Figures 3.1 and 3.2. Writes report.html,
    results.json and robot.toml (with each wheel's b, c and s, and the means of v_s and delta).

    Example: ballbot identify-driveline alten driveline_sweep.csv --out found

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
        Speed limit of the supply, in rad/s; the greatest speed in the log if not given.
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
    findings = _checked(described, log, read, sweeps, accept)
    space = driveline_parameters(lower=lower, upper=upper)
    inputs = input_files(robot, log, mapping)
    with open_result(out, command="identify-driveline", writes=_WRITTEN, inputs=inputs, seed=seed) as result:
        fits, printed = _fit(sweeps, space, seed, result)
        friction = _friction(fits, rolling=described.friction.rolling)
        made = result.origin
        page = driveline_report(described.name, sweeps, fits, printed, made, findings)
        with result.replaced() as new:
            write_text(new / "results.json", as_json(driveline_results(fits, printed, made, findings)))
            write_text(new / "report.html", page)
            write_robot(described.replace(friction=friction), new / "robot.toml")
    _show(fits, printed, result.console)
    result.show_file("report.html")


def _checked(
    robot: Robot, file: Path, log: Log, sweeps: Sequence[Sweep], accept: list[str] | None
) -> tuple[Finding, ...]:
    """Return what checks of the robot, the log and the sweeps found; stop on an error that is not accepted."""
    of_sweeps = (
        replace(one, where=replace(one.where, file=str(file))) for one in sweep_findings(robot, sweeps)
    )
    findings = by_severity([*bench_findings(robot, {str(file): log}), *of_sweeps])
    stop_or_show(findings, accept=accept)
    return findings


def _fit(
    sweeps: Sequence[Sweep], space: ParameterSpace, seed: int, result: CommandResult
) -> tuple[list[DrivelineFit], list[PrintedFit]]:
    """Fit every wheel, to the pieces of its sweep and then as printed."""
    fits: list[DrivelineFit] = []
    printed: list[PrintedFit] = []
    with result.progress("sweep") as bar:

        def show(now: Progress) -> None:
            bar.report(replace(now, note=f"error {math.exp(now.cost):.3g}"))

        for i, sweep in enumerate(sweeps):
            of_wheel = part_of(show, i / len(sweeps), (i + 1) / len(sweeps), stage=f"wheel {i + 1}")
            of_pieces, of_printed = part_of(of_wheel, 0.0, _PIECES), part_of(of_wheel, _PIECES, 1.0)
            fit = fit_driveline(sweep, space=space, run=Run(seed=seed, progress=of_pieces))
            fits.append(fit)
            printed.append(fit_as_printed(sweep, fit, space=space, run=Run(seed=seed, progress=of_printed)))
    return fits, printed


def _friction(fits: Sequence[DrivelineFit], *, rolling: float) -> Friction:
    """Return each wheel's b, c and s, and the means of v_s and delta."""
    return Friction(
        viscous=tuple(float(fit.values[0]) for fit in fits),
        coulomb=tuple(float(fit.values[1]) for fit in fits),
        stribeck=tuple(float(fit.values[2]) for fit in fits),
        stribeck_speed=_mean_of_known(fits, 3),
        stribeck_exponent=_mean_of_known(fits, 4),
        rolling=rolling,
    )


def _mean_of_known(fits: Sequence[DrivelineFit], place: int) -> float:
    """Return the mean over the wheels that show a parameter; over all if none does, where it has no effect."""
    known = [fit for fit in fits if not fit.unknown[place]] or fits
    return sum(float(fit.values[place]) for fit in known) / len(known)


def _show(fits: Sequence[DrivelineFit], printed: Sequence[PrintedFit], console: Console) -> None:
    framed = console.is_terminal
    headings = ("parameter", "unit", *(f"wheel {fit.wheel}" for fit in fits))
    console.print(table("Friction of the drivelines", headings, parameter_rows(fits), framed=framed))
    headings = (
        "",
        "cost (3.5)",
        "RMS [rad/s]",
        "without friction",
        "(3.2) as printed",
        "same friction in (3.2)",
    )
    console.print(table("Speed errors", headings, error_rows(fits, printed), framed=framed))
    for finding in driveline_findings(fits, printed):
        console.print(finding.text, markup=False, soft_wrap=True)
