"""A proposal written as a mapping file, with its reasons as comments."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from ballbot.log.mapping_inference.proposal import Proposal
from ballbot.printable import printable_line, toml_string
from ballbot.robot import Robot


def mapping_text(proposal: Proposal, robot: Robot, *, file: Path) -> str:
    """Return the TOML of the mapping (see `ballbot.log.mapping_file`) that a proposal stands for."""
    parts = [
        [
            f"# {printable_line(file.name)} as a log of the robot "
            f"{robot.name}, proposed by `ballbot check-log`.",
            "# Assumptions that were not measured are marked so: check them before you trust the results.",
        ],
        _file(proposal),
        _time(proposal),
        _columns(proposal),
        _attitude(proposal),
        _wheels(proposal),
        _input(proposal, robot),
    ]
    return "\n\n".join("\n".join(part) for part in parts if part) + "\n"


def _file(proposal: Proposal) -> list[str]:
    table = proposal.table
    lines = ["[file]", f'separator = "{table.separator}"', f"header_lines = {table.layout.header_lines}"]
    if table.layout.names is not None:
        lines.append(f"names = {_strings(table.layout.names)}")
    if table.layout.missing:
        lines.append(f"missing = {_strings(table.layout.missing)}")
    if table.layout.drop_damaged:
        lines.append('damaged_rows = "drop"')
    if proposal.rows is not None:
        lines.append(f"rows = {list(proposal.rows)}   # time starts again outside these rows")
    return lines


def _time(proposal: Proposal) -> list[str]:
    timing = proposal.timing
    lines = ["[time]"]
    if timing.worth_it:
        lines += [
            f"# noise of the wheel speeds: {timing.before:.2g} rad/s by the file's times, {timing.after:.2g} rad/s by "
            "the encoders'",
            "repair = true",
        ]
    lines.append(f"sample_time = {proposal.sample_time:g}")
    if proposal.keep is not None:
        spans = ", ".join(f"[{start:.3f}, {end:.3f}]" for start, end in proposal.keep)
        lines.append(f"keep = [{spans}]   # balancing: neither at rest nor fallen nor held")
    return lines


def _columns(proposal: Proposal) -> list[str]:
    lines = ["[columns]", f"t = {_source(proposal.roles.time or 't')}"]
    if proposal.roles.attitude:
        lines += [f'{name}_dot = {{ derivative_of = "{name}" }}' for name in ("theta", "phi", "psi")]
    return lines


def _source(name: str) -> str:
    return toml_string(name)


def _attitude(proposal: Proposal) -> list[str]:
    if not (proposal.roles.attitude and proposal.lean):
        return []
    lines = [
        "[attitude]",
        f"from = {_strings(proposal.roles.attitude)}",
        f'unit = "{proposal.lean.unit}"   # {proposal.lean.reason}',
    ]
    tested = proposal.lean_test
    if tested is not None:
        measured = math.degrees(proposal.frame.measured_turn)
        error = "unknown" if tested.phase_error is None else f"{math.degrees(tested.phase_error):.1f}"
        lines += [
            f"turn = {math.degrees(proposal.frame.turn):.1f}   # measured: {measured:.1f}, standard error {error}",
            f"delay = {tested.lag:.4f}   # measured: behind the wheels",
        ]
    return lines


def _wheels(proposal: Proposal) -> list[str]:
    frame, lines = proposal.frame, ["[wheels]"]
    if proposal.lean_test is not None:
        placement = proposal.lean_test.placements[0]
        lines.append(
            f"# order: {placement.words}; the next best placement fits {proposal.lean_test.margin:.1f} times worse"
        )
    lines.append(f"order = {list(frame.order)}")
    heading = proposal.heading
    if heading is not None and frame.signs_by_heading:
        lines.append(
            f"# signs: the sum of the wheels' speeds and the heading correlate by {heading.correlation:.2f}"
        )
    else:
        lines.append("# signs: assumed; a heading pulse would show in which direction the wheels count")
    lines.append(f"sign = {list(frame.signs)}")
    lines.append(f"angle = {{ {_angle(proposal)} }}   # {proposal.wheel.reason}")
    lines.append('speed = { derivative_of = "angle" }')
    return lines


def _angle(proposal: Proposal) -> str:
    wheel = proposal.wheel
    words = [f"from = {_strings(proposal.roles.angles)}", f'unit = "{wheel.unit}"']
    if wheel.unit == "counts":
        words.append(f"counts_per_turn = {2.0 * math.pi / wheel.factor:g}")
    elif wheel.scale != 1.0:
        words.append(f"scale = {wheel.scale!r}")
    if proposal.largest_speed is not None:
        words.append(f"largest_speed = {proposal.largest_speed:.4g}")
    return ", ".join(words)


def _input(proposal: Proposal, robot: Robot) -> list[str]:
    names, tested = proposal.roles.commands, proposal.commands
    if not names or proposal.duty is None:
        return []
    signs, delay = list(proposal.frame.signs), 0.0
    if tested is not None:
        names = tuple(names[place - 1] for place in tested.order)
        signs = list(tested.signs)
        delay = tested.delay
    drive, duty = robot.drive, proposal.duty
    resistance = stall_resistance(robot)
    lines = ["[input]", 'kind = "pwm"   # assumed: a duty of a DC motor', f"from = {_strings(names)}"]
    if tested is not None:
        lines.append(
            f"# signs: measured; the commands explain {100 * tested.explained:.0f} % of the wheels' accelerations"
        )
    lines += [
        f"sign = {signs}",
        f"scale = {duty.scale!r}   # {duty.reason}",
        f"delay = {delay:.4f}" + ("   # measured" if tested is not None else "   # assumed"),
        "dead_band = 0.0   # assumed: the duty that the firmware adds; write it here",
        f"supply_voltage = {drive.supply_voltage!r}   # from the robot file",
        f"torque_constant = {drive.torque_constant!r}   # from the robot file",
        f"back_emf_constant = {1.0 / drive.speed_constant!r}   # "
        "from the robot file: the inverse of its speed constant",
        f"resistance = {resistance:.6g}   # assumed: the torque "
        "limit in the robot file is the stall torque at full duty",
        f"gear_ratio = {drive.gear_ratio!r}   # from the robot file",
    ]
    return lines


def stall_resistance(robot: Robot) -> float:
    """Return the winding resistance [ohm] with which full duty at standstill gives the robot's torque limit."""
    drive = robot.drive
    return drive.gear_ratio * drive.torque_constant * drive.supply_voltage / drive.torque_limit


def _strings(texts: Iterable[str]) -> str:
    return f"[{', '.join(map(toml_string, texts))}]"
