"""What the physics of one log says, in the order in which one check rests on another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbot.findings import Finding, Place
from ballbot.log.columns import torque_names
from ballbot.log.kinematic_check import wheel_agreement
from ballbot.log.log import Log
from ballbot.log.physics.delay import answer_of, delay_findings
from ballbot.log.physics.gains import gain_findings, torque_gains
from ballbot.log.physics.lean import LeanEvidence, lean_evidence, lean_findings
from ballbot.log.physics.motion import Motion, Rows, motion_of, usable_rows
from ballbot.log.physics.torque import TorqueEvidence, driving_of, torque_evidence, torque_findings
from ballbot.robot import Robot

#: share of the rows at a torque's largest value from which it is clipped; a motor at its limit is there, too, but then
#: the motion needs no more
CLIPPED = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Examined:
    """What one log says by itself; None where it says nothing or an earlier check failed."""

    findings: tuple[Finding, ...] = ()
    lean: LeanEvidence | None = None
    torque: TorqueEvidence | None = None
    wheel_gain: float | None = None  #: wheel speeds over those that the states make, the wheels' mean


def examine(log: Log, robot: Robot) -> Examined:
    """Return what is wrong with a log of balancing by the robot's own equations, and the scales that it shows.

    The torques are held against a motion that the lean confirms: if the lean does not fit the ball's acceleration, or
    shows nothing of it, nothing is said of the torques.

    Parameters
    ----------
    log : Log
        If it lacks the states or the torques, the checks that need them are left out.
    robot : Robot
        Its rigid body and geometry; its friction is not used.
    """
    late = delay_findings(answer_of(log, robot), names=torque_names(robot.wheel_count))
    rows = usable_rows(log, robot)
    if rows is None:
        return Examined(findings=tuple(late))
    motion = motion_of(log, rows)
    lean = lean_evidence(motion, robot)
    gain = _wheel_gain(log, robot)
    if findings := lean_findings(lean):
        return Examined(findings=(*late, *findings), lean=lean, wheel_gain=gain)
    if late:
        return Examined(findings=tuple(late), lean=lean, wheel_gain=gain)
    if not lean.conclusive:
        sentence = (
            "The signs and scales of lean and torques cannot be checked: the "
            "acceleration of the ball does not follow the lean clearly enough "
            "(too little motion, slipping wheels, or a robot that is held)."
        )
        return Examined(findings=(Finding(code="physics", severity="note", text=sentence),), wheel_gain=gain)
    torque, findings = _torque(log, rows, motion, robot)
    return Examined(findings=tuple(findings), lean=lean, torque=torque, wheel_gain=gain)


def _torque(
    log: Log, rows: Rows, motion: Motion, robot: Robot
) -> tuple[TorqueEvidence | None, list[Finding]]:
    """Return what the torques say and what is wrong; their scale only if nothing else is."""
    driving = driving_of(log, rows, motion, robot)
    if driving is None:
        return None, []
    found = torque_evidence(driving)
    names = torque_names(robot.wheel_count)
    findings = torque_findings(found, names=names)
    if any(finding.code != "torque-scale" for finding in findings):
        return None, findings
    if findings and found.scale[1] < 1.0 and (clipped := _clipped(log, names)):
        return found, [clipped]
    gains = torque_gains(driving, motion, robot)
    return found, (gain_findings(gains, found, names=names) if gains else []) or findings


def _clipped(log: Log, names: tuple[str, ...]) -> Finding | None:
    """Return the error of torques that are too small because they stand at their largest value for long."""
    peaks = {name: float(np.nanmax(np.abs(log[name]))) for name in names}
    shares = {name: float(np.mean(np.abs(log[name]) == peak)) for name, peak in peaks.items()}
    clipped = [name for name, share in shares.items() if share > CLIPPED]
    if not clipped:
        return None
    values = ", ".join(
        f"{name} at {peaks[name]:.3g} N m in {100 * shares[name]:.0f} % of the rows" for name in clipped
    )
    sentence = (
        f"The torques were clipped in the recording: they are at their largest value ({values}) "
        "while the motion needs more. Record them without that limit, or remove these intervals."
    )
    return Finding(
        code="torque-clipped", severity="error", text=sentence, where=Place(columns=tuple(clipped))
    )


def _wheel_gain(log: Log, robot: Robot) -> float | None:
    found = wheel_agreement(log, robot)
    if found is None or min(found.correlations) < 0.98 or min(found.signs) < 0:
        return None
    if list(found.order) != sorted(found.order):
        return None
    return float(np.mean(found.gains))
