"""Whether a log's robot was pushed by more than its model knows: what that leaves of a verdict."""

from __future__ import annotations

import numpy as np

from ballbot.findings import Finding
from ballbot.log.columns import wheel_angle_names
from ballbot.log.log import Log
from ballbot.robot import Robot

#: unmodelled torque over gravity's, over a quarter of a second, from which a closed-loop verdict is refused
DWARFED = 1.0
_ATTITUDE = ("theta", "phi", "psi")


def check_disturbance(log: Log, robot: Robot) -> list[Finding]:
    """Return a warning where the torque that neither wheels nor gravity explain is more than gravity's.

    It takes theta, phi, psi and the encoders' angles; see `ballbot.log.proposal.lean_test`.
    """
    from ballbot.log.proposal.episodes import balancing
    from ballbot.log.proposal.lean_test import lean_test
    from ballbot.log.proposal.signals import even_rows, smooth

    names = (*_ATTITUDE, *wheel_angle_names(robot.wheel_count))
    if robot.wheel_count < 3 or not set(names) <= set(log.names) or len(log) < 2:
        return []
    table = np.column_stack([log[name] for name in names])
    known = np.isfinite(table).all(axis=1)
    if known.sum() < 2:
        return []
    t, table = log.t[known], table[known]
    # a lean about the world's axes, seen from the body
    lean = (table[:, 0] + 1j * table[:, 1]) * np.exp(-1j * table[:, 2])
    rows = even_rows(t)
    tilt = smooth(rows, t, np.column_stack([lean.real, lean.imag]))
    wheels = smooth(rows, t, table[:, 3:])
    heading = smooth(rows, t, table[:, 2:3])
    usable = balancing(tilt.value, wheels.rate, None)
    # rows that a gap was drawn over are not balancing
    usable &= np.diff(t)[np.clip(np.searchsorted(t, rows, side="right") - 1, 0, len(t) - 2)] < 0.05
    tested = lean_test(robot, tilt, wheels, heading, usable)
    return [] if tested is None else disturbance_findings(tested.disturbance)


def disturbance_findings(disturbance: float) -> list[Finding]:
    """Return the warning that a disturbance, in parts of gravity's, asks for; none where it is small."""
    if disturbance < DWARFED:
        return []
    sentence = (
        f"Something other than wheels and gravity moves the lean, {disturbance:.1f} "
        "times as strongly as gravity: the log is good for predictions of a "
        "fraction of a second, but not for closed-loop or long open-loop validation."
    )
    return [Finding(severity="warning", code="disturbance", text=sentence)]
