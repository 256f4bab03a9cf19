"""A proposal reported: its findings, and the mapping file with the reasons as comments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.log.checks.kinematics import disturbance_findings
from ballbot.log.mapping_inference.proposal import Proposal
from ballbot.log.signals import INTERVAL, fallen_rows, local_fit
from ballbot.printable import printable_line
from ballbot.robot import Robot
from ballbot.schema import toml_line

#: a placement is certain if the next best one fits so many times worse
CLEAR_MARGIN = 1.5
#: and if the standard error of the phase is below this [rad]
CLEAR_PHASE = np.deg2rad(5.0)
#: gains relative to the robot's within which units and geometry are accepted
GAIN_RANGE = (0.5, 2.0)
#: a logged speed that differs so much from its angle's rate [rad/s] is a glitch
GLITCH = 5.0


def findings_of(proposal: Proposal) -> tuple[Finding, ...]:
    """Return the findings on a proposal, warnings first."""
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
    """Return a warning if logged speeds contradict the rates of their angles."""
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
        sentence = "The log has too little balancing to test the placement of the wheels."
        return [_finding("warning", "wheels", sentence)]
    best, found = tested.placements[0], []
    if tested.margin < CLEAR_MARGIN:
        other = tested.placements[1]
        sentence = (
            f"The places of the wheels are uncertain: {best.description} fits only {tested.margin:.2f} times better "
            f"than {other.description}. Let the robot sway in all directions and turn its heading back and forth."
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
            f"The columns {', '.join(proposal.roles.commands)} do not drive the wheels; check their meaning."
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


def mapping_text(proposal: Proposal, robot: Robot, *, file: Path) -> str:
    """Return the TOML of the mapping (see `ballbot.log.mapping_file`) that a proposal describes."""
    header = [
        f"# {printable_line(file.name)} as a log of the robot {robot.name}, proposed by `ballbot check-log`.",
        "# Assumptions that were not measured are marked: check them before you rely on the results.",
    ]
    parts = [
        header,
        _file_lines(proposal),
        _time_lines(proposal),
        _column_lines(proposal),
        _attitude_lines(proposal),
        _wheel_lines(proposal),
        _input_lines(proposal, robot),
    ]
    return "\n\n".join("\n".join(part) for part in parts if part) + "\n"


def _file_lines(proposal: Proposal) -> list[str]:
    table = proposal.table
    lines = [
        "[file]",
        toml_line("separator", table.separator),
        toml_line("header_lines", table.layout.header_lines),
    ]
    if table.layout.names is not None:
        lines.append(toml_line("names", table.layout.names))
    if table.layout.missing:
        lines.append(toml_line("missing", table.layout.missing))
    if table.layout.drop_damaged:
        lines.append(toml_line("damaged_rows", "drop"))
    if proposal.rows is not None:
        lines.append(toml_line("rows", proposal.rows, "time starts again outside these rows"))
    return lines


def _time_lines(proposal: Proposal) -> list[str]:
    timing = proposal.timing
    lines = ["[time]"]
    if timing.worth_it:
        lines += [
            f"# noise of the wheel speeds: {timing.before:.2g} rad/s with the file's times, {timing.after:.2g} rad/s "
            "with those of the encoders",
            toml_line("repair", True),
        ]
    lines.append(toml_line("sample_time", float(f"{proposal.sample_time:g}")))
    if proposal.keep is not None:
        spans = [(round(start, 3), round(end, 3)) for start, end in proposal.keep]
        lines.append(toml_line("keep", spans, "balancing: neither at rest nor fallen nor held by hand"))
    return lines


def _column_lines(proposal: Proposal) -> list[str]:
    lines = ["[columns]", toml_line("t", proposal.roles.time or "t")]
    if proposal.roles.attitude:
        lines += [toml_line(f"{name}_dot", {"derivative_of": name}) for name in ("theta", "phi", "psi")]
    return lines


def _attitude_lines(proposal: Proposal) -> list[str]:
    if not (proposal.roles.attitude and proposal.lean):
        return []
    lines = [
        "[attitude]",
        toml_line("from", proposal.roles.attitude),
        toml_line("unit", proposal.lean.unit, proposal.lean.reason),
    ]
    tested = proposal.lean_test
    if tested is not None:
        measured = math.degrees(proposal.frame.measured_turn)
        error = "unknown" if tested.phase_error is None else f"{math.degrees(tested.phase_error):.1f}"
        turn = round(math.degrees(proposal.frame.turn), 1)
        lines += [
            toml_line("turn", turn, f"measured: {measured:.1f}, standard error {error}"),
            toml_line("delay", round(tested.lag, 4), "measured: behind the wheels"),
        ]
    return lines


def _wheel_lines(proposal: Proposal) -> list[str]:
    frame, lines = proposal.frame, ["[wheels]"]
    if proposal.lean_test is not None:
        placement, margin = proposal.lean_test.placements[0], proposal.lean_test.margin
        lines.append(
            f"# order: {placement.description}; the next best placement fits {margin:.1f} times worse"
        )
    lines.append(toml_line("order", frame.order))
    heading = proposal.heading
    if heading is not None and frame.signs_by_heading:
        lines.append(
            f"# signs: the sum of the wheels' speeds and the heading correlate by {heading.correlation:.2f}"
        )
    else:
        lines.append("# signs: assumed; a heading pulse would show in which direction the wheels count")
    return [
        *lines,
        toml_line("sign", frame.signs),
        toml_line("angle", _angle_table(proposal), proposal.wheel.reason),
        toml_line("speed", {"derivative_of": "angle"}),
    ]


def _angle_table(proposal: Proposal) -> dict[str, object]:
    wheel = proposal.wheel
    angle: dict[str, object] = {"from": proposal.roles.angles, "unit": wheel.unit}
    if wheel.unit == "counts":
        angle["counts_per_turn"] = float(f"{2.0 * math.pi / wheel.factor:g}")
    elif wheel.scale != 1.0:
        angle["scale"] = wheel.scale
    if proposal.largest_speed is not None:
        angle["largest_speed"] = float(f"{proposal.largest_speed:.4g}")
    return angle


def _input_lines(proposal: Proposal, robot: Robot) -> list[str]:
    names, tested = proposal.roles.commands, proposal.commands
    if not names or proposal.duty is None:
        return []
    signs: Sequence[int] = proposal.frame.signs
    delay, drive, duty = 0.0, robot.drive, proposal.duty
    explained = []
    if tested is not None:
        names = tuple(names[place - 1] for place in tested.order)
        signs, delay = tested.signs, tested.delay
        percent = 100 * tested.explained
        explained = [f"# signs: measured; the commands explain {percent:.0f} % of the wheels' accelerations"]
    robot_file = "from the robot file"
    resistance = float(f"{stall_resistance(robot):.6g}")
    return [
        "[input]",
        toml_line("kind", "pwm", "assumed: a duty of a DC motor"),
        toml_line("from", names),
        *explained,
        toml_line("sign", signs),
        toml_line("scale", duty.scale, duty.reason),
        toml_line("delay", round(delay, 4), "assumed" if tested is None else "measured"),
        toml_line("dead_band", 0.0, "assumed: the duty that the firmware adds; write it here"),
        toml_line("supply_voltage", drive.supply_voltage, robot_file),
        toml_line("torque_constant", drive.torque_constant, robot_file),
        toml_line("back_emf_constant", 1.0 / drive.speed_constant, f"{robot_file}: 1 / speed constant"),
        toml_line(
            "resistance", resistance, "assumed: full duty at standstill gives the robot's torque limit"
        ),
        toml_line("gear_ratio", drive.gear_ratio, robot_file),
    ]


def stall_resistance(robot: Robot) -> float:
    """Return the winding resistance [ohm] with which full duty at standstill gives the robot's torque limit."""
    drive = robot.drive
    return drive.gear_ratio * drive.torque_constant * drive.supply_voltage / drive.torque_limit
