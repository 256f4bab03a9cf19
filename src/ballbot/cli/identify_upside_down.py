"""`ballbot identify-upside-down`: friction from the robot clamped upside down, the ball on its wheels."""

from __future__ import annotations

from ballbot.cli import options
from ballbot.cli.context import open_result, read_logs
from ballbot.cli.findings import in_file, stop_or_show
from ballbot.errors import InputError
from ballbot.fitting.run import Run, check_seed
from ballbot.identification.bench_checks import upside_down_findings
from ballbot.identification.upside_down import identify_upside_down as find_friction
from ballbot.log.checks import bench_findings
from ballbot.report.bench import upside_down_report
from ballbot.robot import Robot
from ballbot.robot.file import robot_text


def identify_upside_down(
    robot: options.Robot,
    /,
    *logs: options.Log,
    out: options.Out,
    mapping: options.Mapping = None,
    seed: options.Seed = 0,
    window: float = 1.0,
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
    window
        Length of the predicted windows [s].
    """
    described = Robot.load(robot)
    named = read_logs(logs, mapping)
    by_path = dict(zip(logs, named.values(), strict=True))
    of_ball = [
        one for path, log in by_path.items() for one in in_file(path, upside_down_findings(described, log))
    ]
    of_bench = bench_findings(described, {str(path): log for path, log in by_path.items()})
    findings = stop_or_show([*of_bench, *of_ball], accept=accept)
    check_seed(seed)
    with open_result(
        out, doing="identifying", writes=["robot.toml"], inputs=[logs, mapping, robot], seed=seed
    ) as result:
        found = find_friction(
            described, list(named.values()), window=window, run=Run(seed=seed, progress=result.report)
        )
        page = upside_down_report(found, described, named, findings=findings)
        files = {"robot.toml": robot_text(found.robot)} if found.verdict.usable else {}
        step = (
            f"`ballbot study {result.path('robot.toml')} LOG --out found`, with logs of balancing"
            if files
            else ""
        )
        result.write(page, files=files, named=[*files], next_step=step)
    if not found.verdict.usable:
        raise InputError(f"{found.verdict.sentence} No robot.toml was written.")
