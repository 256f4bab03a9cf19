"""What a proposal's tests found, as sentences: what is sure, what is not, and what log would tell."""

from __future__ import annotations

import math

import numpy as np

from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.log.checks.kinematics import disturbance_findings
from ballbot.log.mapping_inference.proposal import Proposal
from ballbot.log.signals import INTERVAL, fallen_rows, local_fit

#: a next best placement must fit this many times worse
CLEAR_MARGIN = 1.5
#: and a phase be known this well [rad]
CLEAR_PHASE = np.deg2rad(5.0)
#: gains over the robot's own within which units and geometry are believed
GAIN_RANGE = (0.5, 2.0)
#: a logged speed this far from its angle's [rad/s] is a glitch
GLITCH = 5.0


def findings_of(proposal: Proposal) -> tuple[Finding, ...]:
    """Return all that is to be known of a proposal, warnings first."""
    found = [
        *[_finding("note", "file", note) for note in proposal.table.notes],
        *_rows(proposal),
        *_roles(proposal),
        *_encoders(proposal),
        *_timing(proposal),
        *_placement(proposal),
        *_heading(proposal),
        *_episodes(proposal),
        *_commands(proposal),
        *(disturbance_findings(proposal.lean_test.disturbance) if proposal.lean_test else []),
    ]
    return by_severity(found)


def _finding(severity: Severity, code: str, sentence: str, columns: tuple[str, ...] = ()) -> Finding:
    return Finding(severity=severity, code=code, text=sentence, where=Place(columns=columns))


def _rows(proposal: Proposal) -> list[Finding]:
    if proposal.rows is None:
        return []
    first, last = proposal.rows
    sentence = (
        f"Time does not always increase, as if runs were joined: rows {first} to {last} are the longest run."
    )
    return [_finding("warning", "time", sentence)]


def _roles(proposal: Proposal) -> list[Finding]:
    roles, found = proposal.roles, []
    if proposal.by_data:
        sentence = (
            f"The columns are recognised by their values: {roles.time} is the time, "
            f"{', '.join(roles.attitude)} roll and pitch, {', '.join(roles.angles)} "
            f"the wheel angles, {', '.join(roles.commands) or 'none'} commands."
        )
        found.append(_finding("warning", "columns", sentence))
    if not roles.attitude:
        sentence = (
            "There are no roll and pitch, so the wheels cannot "
            "be located; the log can be used for drivelines only."
        )
        found.append(_finding("note", "columns", sentence))
    if not roles.commands and roles.body_commands:
        sentence = (
            f"The only commands are {', '.join(roles.body_commands)}, "
            "about the body's axes; log the command of each motor."
        )
        found.append(_finding("warning", "columns", sentence))
    return found


def _encoders(proposal: Proposal) -> list[Finding]:
    found = []
    if proposal.largest_speed is not None:
        sentence = (
            "A wheel angle jumps by more than the wheel can turn: its "
            "encoder was reset, and the angle is continued from there."
        )
        found.append(_finding("warning", "reset", sentence, proposal.roles.angles))
    found += _glitches(proposal)
    return found


def _glitches(proposal: Proposal) -> list[Finding]:
    """Return a warning where the logged speeds have values that the angles do not bear out."""
    names = proposal.roles.speeds
    if not names:
        return []
    first, last = proposal.rows or (1, len(next(iter(proposal.table.columns.values()))))
    columns = {name: values[first - 1 : last] for name, values in proposal.table.columns.items()}
    angles = np.column_stack([columns[name] for name in proposal.roles.angles]) * proposal.wheel.factor
    logged = np.column_stack([columns[name] for name in names])
    _, speeds = local_fit(columns[proposal.roles.time or ""], angles, rows=3)
    wrong = int((np.abs(logged - speeds) > GLITCH).any(axis=1).sum())
    if not wrong:
        return []
    sentence = (
        f"The logged speeds {', '.join(names)} differ much from the rates of "
        f"their angles in {wrong} rows; the angles are differentiated instead."
    )
    return [_finding("warning", "glitch", sentence, names)]


def _timing(proposal: Proposal) -> list[Finding]:
    timing = proposal.timing
    if timing.before is None:
        return [
            _finding(
                "note", "timing", "The wheels are too slow for the encoders to show when rows were sampled."
            )
        ]
    if timing.worth_it:
        sentence = (
            "The times of the rows are inaccurate, equally for all wheels, as when a host "
            f"logs the latest message: the noise of the speeds is {timing.before:.2g} "
            f"rad/s with the logged times, and {timing.after:.2g} rad/s with the times "
            "estimated from the encoders (each wheel validated on the others)."
        )
        return [_finding("note", "timing", sentence, ("t",))]
    return []


def _placement(proposal: Proposal) -> list[Finding]:
    tested = proposal.lean_test
    if tested is None:
        if not proposal.roles.attitude:
            return []
        sentence = "The log has too little balancing to test where the wheels are."
        return [_finding("warning", "wheels", sentence)]
    best, found = tested.placements[0], []
    if tested.margin < CLEAR_MARGIN:
        other = tested.placements[1]
        sentence = (
            f"The places of the wheels are uncertain: {best.words} fits only {tested.margin:.2f} times better "
            f"than {other.words}. Let the robot sway in all directions and turn its heading back and forth."
        )
        found.append(_finding("warning", "wheels", sentence))
    if tested.phase_error is not None and tested.phase_error > CLEAR_PHASE:
        sentence = (
            "The IMU's rotation about the vertical is known to only "
            f"{math.degrees(tested.phase_error):.0f} deg; a longer log helps."
        )
        found.append(_finding("warning", "wheels", sentence))
    if not GAIN_RANGE[0] < best.gain < GAIN_RANGE[1]:
        sentence = (
            f"The lean responds to the wheels {best.gain:.3g} times as strongly as this "
            "robot's should: a unit, a radius or the height of the centre of mass is wrong."
        )
        found.append(_finding("warning", "scale", sentence))
    if best.mirrored:
        sentence = (
            "The log is a mirror image of the robot: the order of the wheels is reversed, "
            "or one axis of the IMU (roll or pitch); this log cannot show which."
        )
        found.append(_finding("note", "wheels", sentence))
    if best.flipped is not None:
        sentence = f"Wheel {best.flipped} of the file counts in the opposite direction to the others."
        found.append(_finding("note", "wheels", sentence))
    return found


def _heading(proposal: Proposal) -> list[Finding]:
    if proposal.lean_test is None or proposal.frame.signs_by_heading:
        return []
    sentence = (
        "The log does not turn its heading enough to show in which direction the "
        "wheels count, or to separate a reversed wheel from a mirror image. Add "
        "a heading pulse (all wheels together, one second in each direction)."
    )
    return [_finding("warning", "heading", sentence)]


def _episodes(proposal: Proposal) -> list[Finding]:
    found, signals = [], proposal.signals
    if signals.lean is not None:
        down = fallen_rows(signals.lean.value)
        falls = int((np.diff(down.astype(np.int8)) == 1).sum() + down[0])
        if falls:
            time = float(signals.rows[int(np.argmax(down))])
            sentence = (
                f"The robot falls, or is not yet on its ball, {falls} "
                f"times, first at {time:.1f} s; these rows are excluded."
            )
            found.append(_finding("warning", "fall", sentence))
    if proposal.lean_test is not None and proposal.lean_test.pushed.any():
        seconds = float(proposal.lean_test.pushed.sum()) * INTERVAL
        sentence = (
            f"For {seconds:.1f} s the wheels do not explain the lean: "
            "hands on the robot, or pushes. These rows are excluded."
        )
        found.append(_finding("warning", "hands", sentence))
    return found


def _commands(proposal: Proposal) -> list[Finding]:
    tested = proposal.commands
    if tested is None:
        if not proposal.roles.commands:
            return []
        sentence = (
            f"The columns {', '.join(proposal.roles.commands)} do not drive the wheels; check what they are."
        )
        return [_finding("warning", "commands", sentence)]
    found = []
    if tested.order != tuple(range(1, len(tested.order) + 1)):
        sentence = (
            "The commands are numbered differently from the "
            f"wheels: wheels 1, 2, .. have commands {tested.order}."
        )
        found.append(_finding("warning", "commands", sentence))
    if len(set(tested.signs)) > 1:
        sentence = f"The signs of the commands differ between wheels: {list(tested.signs)}."
        found.append(_finding("warning", "commands", sentence))
    delay = round(1e3 * tested.delay)
    sentence = (
        (
            f"Commands are logged {-delay} ms after the response of the motors"
            if delay < 0
            else f"Motors respond {delay} ms after the command"
        )
        + (f", the lean is logged {1e3 * proposal.lean_test.lag:.0f} ms late" if proposal.lean_test else "")
        + "; torque constant, winding resistance and dead band are assumed. "
        "A free-wheel sweep gives their ratios, a data sheet the scale."
    )
    found.append(_finding("note", "drive", sentence))
    return found
