"""`ballbot identify-upside-down`: friction from the robot clamped upside down, the ball on its wheels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ballbot.cli.context import (
    PAGE,
    LogPath,
    WholeNumber,
    input_files,
    open_result,
    read_logs,
)
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.errors import InputError
from ballbot.findings import by_severity
from ballbot.fitting.run import Run, check_seed
from ballbot.identification.bench_checks import upside_down_findings
from ballbot.identification.upside_down import identify_upside_down as find_friction
from ballbot.log.checks import bench_findings
from ballbot.report.bench import upside_down_parts, upside_down_report
from ballbot.robot import Robot

_WRITTEN = (PAGE, "robot.toml", "results.json")


def identify_upside_down(
    robot: str,
    /,
    *logs: LogPath,
    out: Path,
    mapping: Path | None = None,
    seed: WholeNumber = 0,
    window: float = 1.0,
    accept: Accept = None,
) -> None:
    """Identify the friction of drivelines and ball-wheel contacts with the robot clamped upside down.

    The ball lies on the wheels, and a camera gives its angular velocity; wheel speeds, if logged, are used. If
    the robot file already has friction, as after `ballbot identify`, both are validated on the same windows.

    Writes report.html, robot.toml (the robot with the identified friction, if it is usable) and results.json.

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
    seed
        Random seed. The same seed gives the same result.
    window
        Length of the predicted windows [s].
    """
    described = Robot.load(robot)
    named = read_logs(logs, mapping)
    by_file = {str(path): log for path, log in zip(logs, named.values(), strict=True)}
    findings = by_severity(
        [
            *bench_findings(described, by_file),
            *(
                replace(one, where=replace(one.where, file=file))
                for file, log in by_file.items()
                for one in upside_down_findings(described, log)
            ),
        ]
    )
    stop_or_show(findings, accept=accept)
    check_seed(seed)
    with open_result(
        out,
        command="identify-upside-down",
        writes=_WRITTEN,
        inputs=input_files(logs, mapping, robot),
        seed=seed,
    ) as result:
        with result.progress("identifying") as bar:
            found = find_friction(
                described,
                list(named.values()),
                window=window,
                run=Run(seed=seed, progress=bar.report),
            )
        with result.replaced() as new:
            result.write_json(found.to_dict(), new, findings=[*findings, *found.findings])
            if found.verdict.usable:
                found.robot.write(new / "robot.toml")
            page = upside_down_report(found, described, named, made=result.origin, findings=findings)
            result.write_page(page, new)
    result.show(upside_down_parts(found, described))
    result.show_file(PAGE, *(["robot.toml"] if found.verdict.usable else []))
    if not found.verdict.usable:
        raise InputError(f"{found.verdict.sentence} No robot.toml was written.")
