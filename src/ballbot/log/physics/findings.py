"""What the physics of one log says, in the order in which one check rests on another."""

from __future__ import annotations

from ballbot.findings import Finding
from ballbot.log.columns import torque_names
from ballbot.log.log import Log
from ballbot.log.physics.delay import answer_of, delay_findings
from ballbot.log.physics.lean import lean_evidence, lean_findings
from ballbot.log.physics.motion import motion_of, usable_rows
from ballbot.log.physics.torque import driving_of, torque_evidence, torque_findings
from ballbot.robot import Robot


def physics_findings(log: Log, robot: Robot) -> list[Finding]:
    """Return what is wrong with a log of balancing by the robot's own equations.

    The torques are held against a motion that the lean confirms: if the lean does not fit the ball's acceleration, or
    shows nothing of it, nothing is said of the torques.

    Parameters
    ----------
    log : Log
        If it lacks the states or the torques, the checks that need them are left out.
    robot : Robot
        Its rigid body and geometry; its friction is not used.
    """
    names = torque_names(robot.wheel_count)
    late = delay_findings(answer_of(log, robot), names=names)
    if late:
        return late
    rows = usable_rows(log, robot)
    if rows is None:
        return []
    motion = motion_of(log, rows)
    lean = lean_evidence(motion, robot)
    findings = lean_findings(lean)
    if findings:
        return findings
    if not lean.conclusive:
        sentence = (
            "The signs and scales of lean and torques cannot be checked: the ball's acceleration does not follow the "
            "lean clearly enough (too little motion, wheels that slip, or a robot that is held)."
        )
        return [Finding(code="physics", severity="note", text=sentence)]
    driving = driving_of(log, rows, motion, robot)
    if driving is None:
        return []
    return torque_findings(torque_evidence(driving), names=names)
