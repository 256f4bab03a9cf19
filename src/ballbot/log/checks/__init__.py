"""Checks of a log: its faults, their likely causes, and the uses that it permits.

time_and_rates   time, missing cells; positions and angles against their rates: units, signs, swapped columns
values           spikes, dead and saturated columns, unknown names, falls, jumps, offsets
repetition       values, rows or a whole log that froze or repeats
stuck_encoders   encoders that hold their angle while their wheels turn
kinematics       wheel columns against the states
torques          torques by themselves: dead, unrelated to the motion, late
lean             lean axes against the ball's acceleration
torque_balance   torques against those that the motion needs: order, sign
torque_gains     how large each torque is against its need, and whether that changes within a log
physics          the last four in their order, several logs against each other, disturbances

`check` gives the findings of one log, `check_logs` those of several logs of a robot, and `checked_logs` the input of
an analysis: logs whose checks ran once, before any computation, and whose errors, if any, the user accepted. Findings
of one cause are joined.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from ballbot.findings import (
    Finding,
    Place,
    as_argument,
    by_severity,
    check_codes,
    in_check_log,
    stop_on_errors,
)
from ballbot.log.checks.kinematics import ALIKE, check_disturbance, check_sampling, check_wheels
from ballbot.log.checks.repetition import check_copied, check_held, check_stuck
from ballbot.log.checks.stuck_encoders import check_stuck_encoders
from ballbot.log.checks.time_and_rates import (
    check_gaps,
    check_gyro,
    check_jitter,
    check_missing_values,
    check_rates,
    check_rows,
)
from ballbot.log.checks.torques import check_torques
from ballbot.log.checks.values import (
    check_constant,
    check_jumps,
    check_lean,
    check_lean_course,
    check_names,
    check_saturation,
    check_speed_limit,
    check_spikes,
    check_wrap,
)
from ballbot.log.collection import LogsLike, as_logs
from ballbot.log.columns import MAX_WHEELS, STATE_NAMES, similar_column, torque_names, wheel_speed_names
from ballbot.log.fingerprints import refuse_copies
from ballbot.log.log import Log
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.plausibility import named_robot_findings

if TYPE_CHECKING:
    from ballbot.log.checks.physics import PhysicsOfLog

_VELOCITY = ("x", "y", "x_dot", "y_dot")
_LEAN = ("theta", "phi")
_OF_TORQUES = ("torque-", "dead-motor")


def join_common_causes(findings: Sequence[Finding], examined: PhysicsOfLog) -> list[Finding]:
    """Return the findings, those of one cause as one.

    - The wheels turn too slowly for the states by the factor by which the ball accelerates too much for the lean (or
      the other way round): the ball's velocity, which both checks use, is scaled.
    - A torque that repeats its value is not that of the motion: it froze.
    - A lean angle contradicts its rate and the ball's acceleration: the angle has the opposite sign, not the rate.

    Parameters
    ----------
    findings : sequence of Finding
        Of all checks of one log.
    examined : PhysicsOfLog
        Results of the equations of motion on the same log.
    """
    found = _negated_angles(_scaled_velocity(findings, examined), examined)
    held = {one.where.columns for one in found if one.code == "stuck"}
    return [one for one in found if not (one.code.startswith(_OF_TORQUES) and one.where.columns in held)]


def _scaled_velocity(findings: Sequence[Finding], examined: PhysicsOfLog) -> list[Finding]:
    lean, wheels = examined.lean, examined.wheel_gain
    if lean is None or wheels is None or not {"wheels", "lean-scale"} <= {one.code for one in findings}:
        return list(findings)
    scale = abs(lean.gravity_gain)
    if not 1.0 / ALIKE < scale * wheels < ALIKE:
        return list(findings)
    sentence = (
        f"The ball accelerates {scale:.3g} times as much as the lean implies, and the wheels turn {wheels:.3g} times "
        f"as fast as the ball's velocity implies: x, y, x_dot and y_dot are scaled by {scale:.3g} (unit, wheel radius, "
        "ball radius, gear ratio or encoder counts per turn). Correct the scale of these columns."
    )
    joined = Finding(code="lean-scale", severity="error", text=sentence, where=Place(columns=_VELOCITY))
    return [joined, *(one for one in findings if one.code not in ("wheels", "lean-scale"))]


def _negated_angles(findings: Sequence[Finding], examined: PhysicsOfLog) -> list[Finding]:
    lean = examined.lean
    if lean is None or not lean.misread or lean.angles[0].swapped or lean.rates[0].swapped:
        return list(findings)
    angles = {name for name, sign in zip(_LEAN, lean.angles[0].signs, strict=True) if sign < 0}
    against_rate = {one.where.columns[0] for one in findings if one.code == "sign" and one.where.columns}
    if not angles or min(lean.rates[0].signs) < 0 or not angles <= against_rate:
        return list(findings)
    joined = [
        _negated(one) if one.code == "sign" and one.where.columns[0] in angles else one for one in findings
    ]
    return [one for one in joined if one.code != "lean-axes"]


def _negated(contradiction: Finding) -> Finding:
    angle, rate = contradiction.where.columns
    sentence = (
        f"{angle} and {rate} have opposite signs, and the ball accelerates against {angle}: {angle} has the opposite "
        f"sign. Negate {angle}."
    )
    return Finding(code="sign", severity="error", text=sentence, where=contradiction.where)


def check(log: Log, *, robot: Robot | None = None) -> tuple[Finding, ...]:
    """Return the findings of all checks of a log, errors first.

    Parameters
    ----------
    log : Log
        The log.
    robot : Robot, optional
        With it, the wheels' columns are compared with the robot's kinematics and the torques with its limit.
    """
    if robot is None:
        return _log_findings(log, None, None)
    from ballbot.log.checks.physics import examine, torque_bounds

    examined = examine(log, robot)
    return by_severity([*_log_findings(log, robot, examined), *torque_bounds([examined], robot)])


def _log_findings(log: Log, robot: Robot | None, examined: PhysicsOfLog | None) -> tuple[Finding, ...]:
    limit = robot.drive.torque_limit if robot else None
    wheel_count = robot.wheel_count if robot else _wheels_of(log)
    rates = check_rates(log)
    findings = [
        *log.changes,
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
        *(check_stuck_encoders(log, wheel_count=wheel_count) if _in_seconds(rates) else []),
        *check_names(log),
        *check_uses(log, wheel_count=wheel_count),
    ]
    if examined:
        findings = join_common_causes(findings, examined)
    # an error would be its cause, and it takes the longest
    if robot and not any(finding.severity == "error" for finding in findings):
        findings += check_disturbance(log, robot)
    return by_severity(findings)


def check_logs(logs: Mapping[str, Log], *, robot: Robot) -> tuple[Finding, ...]:
    """Return the findings of a robot's logs, errors first, each with the log that it is about.

    Parameters
    ----------
    logs : mapping of str to Log
        By the names that messages use.
    robot : Robot
        Whose logs they are.
    """
    # importing the equations of motion takes time
    from ballbot.log.checks.physics import different_robots, examine, torque_bounds

    examined = {name: examine(log, robot) for name, log in logs.items()}
    findings = [
        replace(finding, where=replace(finding.where, file=name))
        for name, log in logs.items()
        for finding in _log_findings(log, robot, examined[name])
    ]
    return by_severity([*findings, *different_robots(examined), *torque_bounds(examined.values(), robot)])


def _in_seconds(rates: Sequence[Finding]) -> bool:
    """Return whether there is no finding on the unit of time; with a wrong unit no motion can be checked."""
    return not any(finding.code == "time-scale" for finding in rates)


def _of_motion(log: Log, robot: Robot | None, physics: Iterable[Finding]) -> list[Finding]:
    """Return the findings on the motion, by the robot's equations if it is known."""
    torques = check_torques(log, robot=robot)
    # torques that do not belong to this motion make every other finding on them meaningless
    kept = [one for one in physics if not (torques and one.code.startswith("torque-"))]
    kinematics = _of_robot(log, robot) if robot else []
    if any(one.code in ("ball-axes", "heading-sign", "encoders") for one in kinematics):
        kept = []  # they would follow from the wrong axes of the ball, or from the ball's path by wrong wheels
    return [*torques, *kinematics, *kept]


def _of_robot(log: Log, robot: Robot) -> list[Finding]:
    return [*check_sampling(log, robot), *check_speed_limit(log, robot), *check_wheels(log, robot)]


def needed_columns(wheel_count: int) -> Mapping[str, tuple[str, ...]]:
    """Return the columns that each use of a log needs."""
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
    for use, needed in needed_columns(wheel_count).items():
        missing = tuple(name for name in needed if name not in log)
        if missing:
            plural = "columns" if len(missing) > 1 else "column"
            names = f"{plural} {', '.join(missing)}{similar_column(missing, log.names)}"
            sentence = f"Not enough for {use}: the log lacks the {names}."
            findings.append(Finding(severity="note", code="use", text=sentence, where=Place(columns=missing)))
    return findings


def _wheels_of(log: Log) -> int:
    """Return the number of wheels that the log's columns name; three if they name none."""
    numbers = range(1, MAX_WHEELS + 1)
    return max(
        (i for i in numbers if any(n in log for n in (f"u{i}", f"wheel{i}", f"wheel{i}_dot"))), default=3
    )


#: codes that concern a balancing robot only
_OF_BALANCING = ("use", "saturation")


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedLogs:
    """Logs that were checked and whose errors, if any, the user accepted; see `checked_logs`."""

    logs: Mapping[str, Log]  #: by the names that messages use
    findings: tuple[Finding, ...]  #: of all logs, errors first

    @classmethod
    def simulated(cls, log: Log) -> CheckedLogs:
        """Return a log that Ballbot has just simulated, which needs no checks."""
        return cls(logs={"": log}, findings=())

    def with_logs(self, logs: Mapping[str, Log]) -> CheckedLogs:
        """Return the findings with logs derived from the checked ones, such as parts of them."""
        return replace(self, logs=logs)


def checked_logs(
    robot: RobotLike | None,
    logs: LogsLike | CheckedLogs,
    *,
    accept: Collection[str] = (),
    going_on: Callable[[Sequence[str]], str] = as_argument,
    more: Callable[[Finding], str] = in_check_log,
) -> CheckedLogs:
    """Check logs, unless they are checked, and stop on an error that is not accepted.

    Parameters
    ----------
    robot : Robot, preset or robot file, optional
        Whose logs they are. Without it, only the checks without a robot run.
    logs : Log or log file, several in a list or a mapping, or CheckedLogs
        See `ballbot.log.as_logs` for their names in messages.
    accept : collection of str
        Codes of errors despite which to continue; see `ballbot.findings.CODES`.
    going_on, more : callable
        See `ballbot.findings.stop_on_errors`.

    Raises
    ------
    InputError
        If the robot or a log has an error whose code is not accepted, two logs are of the same run, or a code is
        unknown.
    """
    codes = check_codes(accept)
    if isinstance(logs, CheckedLogs):
        return logs
    named = as_logs(logs)
    refuse_copies(named)
    findings = _without_robot(named) if robot is None else _with_robot(as_robot(robot), named)
    stop_on_errors(findings, accept=codes, going_on=going_on, more=more)
    return CheckedLogs(logs=named, findings=findings)


def bench_findings(robot: Robot, logs: Mapping[str, Log]) -> tuple[Finding, ...]:
    """Return the findings of a robot and of its logs on a bench, on which it does not balance.

    Parameters
    ----------
    robot : Robot
    logs : mapping of str to Log
        By the names that messages use.
    """
    of_logs = (one for one in _without_robot(logs) if one.code not in _OF_BALANCING)
    return by_severity([*named_robot_findings(robot), *of_logs])


def _with_robot(robot: Robot, named: Mapping[str, Log]) -> tuple[Finding, ...]:
    return by_severity([*named_robot_findings(robot), *check_logs(named, robot=robot)])


def _without_robot(named: Mapping[str, Log]) -> tuple[Finding, ...]:
    return by_severity(
        replace(finding, where=replace(finding.where, file=name))
        for name, log in named.items()
        for finding in check(log)
    )


__all__ = ["CheckedLogs", "bench_findings", "check", "check_logs", "checked_logs", "needed_columns"]
