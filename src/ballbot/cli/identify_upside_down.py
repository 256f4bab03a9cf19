"""`ballbot identify-upside-down`: friction from the robot clamped upside down, the ball on its wheels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from ballbot.cli.context import (
    CommandResult,
    RunOptions,
    WholeNumber,
    input_files,
    open_long_result,
    read_logs,
)
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.cli.output import table
from ballbot.files import write_text
from ballbot.findings import Finding, by_severity, texts
from ballbot.fitting.checkpoint import identity
from ballbot.identification import Progress, read_bounds
from ballbot.identification.upside_down import UpsideDown
from ballbot.identification.upside_down import identify_upside_down as find_friction
from ballbot.identification.upside_down_checks import upside_down_findings
from ballbot.log import Log
from ballbot.log.checks import bench_findings
from ballbot.report.bench import movement_figure, prediction_figure
from ballbot.report.style import drawn
from ballbot.report.tables import digits
from ballbot.robot import Friction, Robot
from ballbot.robot.file import write_robot
from ballbot.workflows.ball_movement import ball_movement

_WRITTEN = ("robot.toml", "results.json", "prediction.svg", "movement.svg")
_UNITS = {"b": "N m s/rad", "c": "N m", "s": "N m", "v_s": "rad/s", "delta": ""}


def identify_upside_down(
    robot: str,
    /,
    *logs: Path,
    out: Path,
    mapping: Path | None = None,
    bounds: Path | None = None,
    seed: WholeNumber = 0,
    window: float = 1.0,
    accept: Accept = None,
    resume: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Identify the friction of drivelines and ball-wheel contacts with the robot clamped upside down.

    The second of the thesis's three stages: the ball lies on the wheels, and a camera gives its angular velocity. If
    the robot file has friction already, as after `ballbot identify`, both are validated on the same windows.

    Writes robot.toml (the robot with the friction found), results.json, prediction.svg and movement.svg (the thesis's
    Figure 3.4).

    Example: ballbot identify-upside-down alten upside_down.csv --out found

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    logs
        One or more logs with u1, u2 .. and ball_omega_x, _y, _z in the robot's frame.
    out
        The folder to write into.
    mapping
        A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it.
    bounds
        A TOML file with lower and upper bounds of the friction, such as: coulomb = [0.0, 0.5].
    seed
        Random seed. The same seed gives the same result.
    window
        Length of the predicted windows, in seconds.
    resume
        Continue an interrupted run in the same folder.
    """
    described = Robot.load(robot)
    named = read_logs(logs, mapping)
    findings = _checked(described, dict(zip(logs, named.values(), strict=True)), accept)
    within = read_bounds(bounds) if bounds else None
    depends_on = {"bounds": within, "seed": seed, "window": window}
    belongs_to = identity(described, list(named.values()), depends_on)
    with open_long_result(
        out,
        command="identify-upside-down",
        writes=_WRITTEN,
        inputs=input_files(logs, mapping, bounds, robot),
        belongs_to=belongs_to,
        seed=seed,
        run=RunOptions(resume=resume),
    ) as result:
        with result.progress("identifying") as bar:

            def show(progress: Progress) -> None:
                bar.show(progress.share, note=f"error {progress.cost:.3f} rad/s")

            found = find_friction(
                described,
                list(named.values()),
                bounds=within,
                window=window,
                run=result.run_with(show),
            )
        with result.replaced() as new:
            _write(found, next(iter(named.values())), result, findings, new)
    _show(found, described, result.console)
    result.show_file("robot.toml", "prediction.svg", "movement.svg")


def _checked(robot: Robot, logs: Mapping[Path, Log], accept: list[str] | None) -> tuple[Finding, ...]:
    """Return what is wrong with the robot and with the logs; stop on an error that is not accepted."""
    of_ball = (
        replace(one, where=replace(one.where, file=str(path)))
        for path, log in logs.items()
        for one in upside_down_findings(robot, log)
    )
    of_bench = bench_findings(robot, {str(path): log for path, log in logs.items()})
    findings = by_severity([*of_bench, *of_ball])
    stop_or_show(findings, accept=accept)
    return findings


def _write(
    found: UpsideDown, log: Log, result: CommandResult, findings: Sequence[Finding], folder: Path
) -> None:
    movement = ball_movement(found.robot)
    result.write_json(found.to_dict() | {"movement": movement}, folder, findings=findings)
    write_robot(found.robot, folder / "robot.toml")
    write_text(folder / "prediction.svg", drawn(lambda: prediction_figure(found, log), name="prediction"))
    write_text(folder / "movement.svg", drawn(lambda: movement_figure(movement), name="movement"))


def _show(found: UpsideDown, described: Robot, console: Console) -> None:
    console.print(_parameter_table(found, described, framed=console.is_terminal))
    console.print(_error_table(found, framed=console.is_terminal))
    for sentence in (*texts(found.warnings), *_comparison(described)):
        console.print(sentence, markup=False, soft_wrap=True)


def _comparison(described: Robot) -> list[str]:
    """Return what to make of a friction that stood in the robot's file before."""
    if described.friction == Friction.none(described.wheel_count):
        return []
    return [
        "The friction identified while balancing differs from this one for two reasons: "
        "there the weight of the robot rests on the contacts, which adds to c and s, "
        "and what the model neglects (play, slip, rollers) is absorbed by whichever "
        "parameter predicts best. Use each in the situation where it was identified."
    ]


def _parameter_table(found: UpsideDown, described: Robot, *, framed: bool) -> Table:
    friction = described.friction
    before = {
        "b": friction.viscous,
        "c": friction.coulomb,
        "s": friction.stribeck,
        "v_s": (friction.stribeck_speed,),
        "delta": (friction.stribeck_exponent,),
    }
    rows = []
    for symbol, value in found.parameters.items():
        values = value if isinstance(value, list) else [value]
        error = found.standard_errors[symbol]
        errors = error if isinstance(error, list) else [error]
        for i, (one, its_error, old) in enumerate(zip(values, errors, before[symbol], strict=True), start=1):
            name = f"{symbol}{i}" if isinstance(value, list) else symbol
            rows.append((name, digits(one), digits(its_error, 2), digits(old), _UNITS[symbol]))
    headings = ("parameter", "upside down", "standard error", "robot file", "unit")
    return table("Friction of drivelines and ball-wheel contacts", headings, rows, framed=framed)


def _error_table(found: UpsideDown, *, framed: bool) -> Table:
    rows = [
        (f"Omega_{axis}", *(digits(float(errors[i])) for errors in found.held_out.values()))
        for i, axis in enumerate("xyz")
    ]
    title = f"Open-loop RMSE in rad/s on {len(found.held_out_windows)} held-out windows of {found.window:g} s"
    return table(title, ("state", *(f"friction: {name}" for name in found.held_out)), rows, framed=framed)
