"""All checks of a log, and what it can be used for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from ballbot.findings import Finding, Place, by_severity
from ballbot.log.angle_checks import check_lean, check_wrap
from ballbot.log.columns import MAX_WHEELS, STATE_NAMES, torque_names, wheel_speed_names
from ballbot.log.common_causes import join_common_causes
from ballbot.log.course_checks import check_jumps, check_lean_course
from ballbot.log.disturbance_check import check_disturbance
from ballbot.log.kinematic_check import check_wheels
from ballbot.log.log import Log
from ballbot.log.rate_checks import check_gyro, check_rates
from ballbot.log.repetition_checks import check_copied, check_held, check_stuck
from ballbot.log.spikes import check_spikes
from ballbot.log.time_checks import check_gaps, check_jitter, check_missing_values, check_rows
from ballbot.log.torque_checks import check_torques
from ballbot.log.value_checks import check_constant, check_names, check_saturation, check_speed_limit
from ballbot.robot import Robot

if TYPE_CHECKING:
    from ballbot.log.physics import Examined


def check(log: Log, *, robot: Robot | None = None) -> tuple[Finding, ...]:
    """Return everything that was found in a log, errors first.

    Parameters
    ----------
    log : Log
        The log.
    robot : Robot, optional
        With it, the wheels' columns are held against the robot's kinematics and the torques against its
        limit.
    """
    return _checked(log, robot, _physics_of(log, robot) if robot else None)


def _checked(log: Log, robot: Robot | None, examined: Examined | None) -> tuple[Finding, ...]:
    limit = robot.drive.torque_limit if robot else None
    rates = check_rates(log)
    findings = [
        *check_rows(log),
        *check_gaps(log),
        *check_jitter(log),
        *check_missing_values(log),
        *check_spikes(log),
        *rates,
        *check_gyro(log),
        *check_lean(log),
        *check_wrap(log),
        *check_constant(log),
        *check_stuck(log),
        *check_held(log),
        *check_copied(log),
        *check_jumps(log),
        *check_lean_course(log),
        *check_saturation(log, torque_limit=limit),
        *(_of_motion(log, robot, examined.findings if examined else ()) if _in_seconds(rates) else []),
        *check_names(log),
        *check_uses(log, wheel_count=robot.wheel_count if robot else _wheels_of(log)),
    ]
    if examined:
        findings = join_common_causes(findings, examined)
    # beside an error it would be one of its effects, and it takes the longest
    if robot and not any(finding.severity == "error" for finding in findings):
        findings += check_disturbance(log, robot)
    return by_severity(findings)


def check_logs(logs: Mapping[str, Log], *, robot: Robot) -> tuple[Finding, ...]:
    """Return everything found in a robot's logs, errors first, each finding with the log that it is about.

    Parameters
    ----------
    logs : mapping of str to Log
        By the names that messages use.
    robot : Robot
        Whose logs they are.
    """
    from ballbot.log.physics import different_robots, examine  # the equations of motion take a while to load

    examined = {name: examine(log, robot) for name, log in logs.items()}
    findings = [
        replace(finding, where=replace(finding.where, file=name))
        for name, log in logs.items()
        for finding in _checked(log, robot, examined[name])
    ]
    return by_severity([*findings, *different_robots(examined)])


def _physics_of(log: Log, robot: Robot) -> Examined:
    from ballbot.log.physics import examine

    return examine(log, robot)


def _in_seconds(rates: Sequence[Finding]) -> bool:
    """Return whether nothing was found of time in another unit, in which no motion can be looked at."""
    return not any(finding.code == "time-scale" for finding in rates)


def _of_motion(log: Log, robot: Robot | None, physics: Iterable[Finding]) -> list[Finding]:
    """Return what the motion shows, by the robot's equations if it is known."""
    torques = check_torques(log, robot=robot)
    # torques that are not of this motion at all make every other finding on them moot
    kept = [one for one in physics if not (torques and one.code.startswith("torque-"))]
    kinematics = _of_robot(log, robot) if robot else []
    if any(one.code in ("ball-axes", "heading-sign") for one in kinematics):
        kept = []  # what follows from wrong axes of the ball is not told again
    return [*torques, *kinematics, *kept]


def _of_robot(log: Log, robot: Robot) -> list[Finding]:
    return [*check_speed_limit(log, robot), *check_wheels(log, robot)]


def needed_columns(wheel_count: int) -> Mapping[str, tuple[str, ...]]:
    """Return, by what a log is used for, the columns that this needs."""
    torques, speeds = torque_names(wheel_count), wheel_speed_names(wheel_count)
    return MappingProxyType(
        {
            "identification and validation of the balancing robot": ("t", *torques, *STATE_NAMES),
            "closed-loop validation": ("t", *torques, *STATE_NAMES, "ref_x", "ref_y", "ref_psi"),
            "identification of drivelines": ("t", *torques, *speeds),
            "the on-board state": ("t", *speeds, "gyro_x", "gyro_y", "gyro_z", "theta", "phi", "psi"),
        }
    )


def check_uses(log: Log, *, wheel_count: int) -> list[Finding]:
    """Return a note for each use that the log lacks columns for."""
    findings = []
    for use, names in needed_columns(wheel_count).items():
        missing = tuple(name for name in names if name not in log)
        if missing:
            plural = "columns" if len(missing) > 1 else "column"
            sentence = f"Not enough for {use}: the log lacks the {plural} {', '.join(missing)}."
            findings.append(Finding(severity="note", code="use", text=sentence, where=Place(columns=missing)))
    return findings


def _wheels_of(log: Log) -> int:
    """Return the number of wheels that the log's columns name; three, the usual, where there are none."""
    numbers = range(1, MAX_WHEELS + 1)
    return max(
        (i for i in numbers if any(n in log for n in (f"u{i}", f"wheel{i}", f"wheel{i}_dot"))), default=3
    )
