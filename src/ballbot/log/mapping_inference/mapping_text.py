"""A proposal written as a mapping file, with the reasons as comments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from ballbot.file_formats import format_line
from ballbot.log.columns import FACTORS
from ballbot.log.mapping_inference.command_units import Unit
from ballbot.log.mapping_inference.conclusions import conclusions_of
from ballbot.log.mapping_inference.evidence import Conclusion, in_percent
from ballbot.log.mapping_inference.proposal import Proposal, rates_delay, rates_signs
from ballbot.log.mapping_inference.stall import stall_resistance
from ballbot.log.mapping_inference.tolerances import ASSUMED
from ballbot.log.mapping_inference.units import PATH, PER_ROW
from ballbot.log.row_order import repeated_rows
from ballbot.printable import printable_line
from ballbot.robot import Robot
from ballbot.schema import toml_line


def mapping_text(proposal: Proposal, robot: Robot, *, file: Path) -> str:
    """Return the TOML of the mapping (see `ballbot.log.mapping_file`) that a proposal describes."""
    header = [
        f"# {printable_line(file.name)} as a log of the robot {robot.name}, proposed by `ballbot check-log`.",
        "# Assumptions that were not measured are marked: check them before you rely on the results.",
    ]
    header.append(format_line("mapping"))
    concluded: dict[str, Conclusion] = {}
    for one in conclusions_of(proposal):  # of two about one line, a question stays
        if one.key not in concluded or concluded[one.key].determined:
            concluded[one.key] = one
    questions = [one for one in concluded.values() if not one.determined]
    if questions:
        lines = [f"#   {one.key}: {one.question}; {one.evidence}" for one in questions]
        header += ["# cannot determine:", *[printable_line(line) for line in lines]]
        header += [
            toml_line("complete", False, "fill in the lines with cannot determine, then remove this line")
        ]
    parts = [
        header,
        _file_lines(proposal),
        _time_lines(proposal),
        _column_lines(proposal),
        _attitude_lines(proposal, concluded),
        _wheel_lines(proposal),
        _input_lines(proposal, robot, concluded),
    ]
    asked = {one.key: one for one in questions}
    return "\n\n".join("\n".join(_with_questions(part, asked)) for part in parts if part) + "\n"


def _with_questions(lines: list[str], asked: dict[str, Conclusion]) -> list[str]:
    """Return the lines of a table with a comment before each key whose value is undetermined."""
    table, made = "", []
    for line in lines:
        table = line if line.startswith("[") else table
        question = asked.get(f"{table} {line.split(' = ')[0]}")
        if question is not None:
            made.append(printable_line(f"# cannot determine: {question.question}; {question.evidence}"))
        made.append(line)
    return made


def _file_lines(proposal: Proposal) -> list[str]:
    table = proposal.table
    lines = [
        "[file]",
        toml_line("separator", table.separator),
        toml_line("header_lines", table.layout.header_lines),
    ]
    if table.layout.decimal_comma:
        lines.append(toml_line("decimal", "comma"))
    if table.layout.names is not None:
        lines.append(toml_line("names", table.layout.names))
    if table.layout.missing:
        lines.append(toml_line("missing", table.layout.missing))
    if table.layout.drop_damaged:
        lines.append(toml_line("damaged_rows", "drop"))
    if repeated_rows(table.columns, proposal.roles.time or "").any():
        lines.append(toml_line("repeated_rows", "drop"))
    if proposal.unordered:
        lines.append(toml_line("unordered_rows", "drop"))
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
    roles, time = proposal.roles, proposal.time
    source: object = roles.time or "t"
    if roles.time_parts:
        source = dict(zip(("from", "nanoseconds"), roles.time_parts, strict=True))
    elif time.unit != "s":
        source = {"from": source, "unit": time.unit}
    lines = ["[columns]", toml_line("t", source, time.reason)]
    if roles.attitude and proposal.gyro is None:
        lines += [toml_line(f"{name}_dot", {"derivative_of": name}) for name in ("theta", "phi", "psi")]
    return lines


def _reason(one: Conclusion | None) -> str:
    """Return why a number is what it is, with its standard error."""
    if one is None:
        return "assumed"
    assumed = "assumed; " if one.value.endswith(ASSUMED) else ""
    reason = assumed + one.evidence.partition(";")[0]
    return f"{reason}; standard error {one.error_text}" if one.error_text else reason


def attitude_units(proposal: Proposal) -> list[str]:
    """Return the units of roll, pitch and, if there is one, yaw."""
    by_factor = {factor: unit for unit, factor in FACTORS["rad"].items()}
    return [
        min(by_factor.items(), key=lambda one: abs(math.log(one[0] / factor)))[1]
        for factor in proposal.attitude_factors
    ]


def one_or_each(units: list[str]) -> str | list[str]:
    """Return the unit if all are one, else the units."""
    return units[0] if len(set(units)) == 1 else units


def _attitude_lines(proposal: Proposal, concluded: Mapping[str, Conclusion]) -> list[str]:
    if not (proposal.roles.attitude and proposal.lean):
        return []
    quaternion = proposal.roles.quaternion
    if quaternion:
        lines = ["[attitude]", toml_line("from", quaternion, "a quaternion w, x, y, z")]
    else:
        lines = [
            "[attitude]",
            toml_line("from", proposal.roles.attitude),
            toml_line("unit", one_or_each(attitude_units(proposal)), proposal.lean.reason),
        ]
    if proposal.roles.half_turn is not None:
        lines.append(toml_line("upside_down", True, "the roll stays near half a turn"))
    lines += _world_lines(proposal, concluded)
    tested, frame, gyro = proposal.lean_test, proposal.frame, proposal.gyro
    if -1 in frame.axis_signs:
        lines.append(
            toml_line(
                "sign", frame.axis_signs[: len(proposal.roles.attitude)], "lean and yaw of opposite sign"
            )
        )
    if tested is not None:
        turn = round(math.degrees(frame.turn), 1)
        lines += [
            toml_line("turn", turn, _reason(concluded.get("[attitude] turn"))),
            toml_line("delay", proposal.sensor_delay, _reason(concluded.get("[attitude] delay"))),
        ]
    if gyro is not None:
        rates = {
            "from": [proposal.roles.gyro[place] for place in gyro.order],
            "unit": gyro.unit,
            **({"scale": gyro.scale} if gyro.scale != 1.0 else {}),
            "sign": list(rates_signs(proposal)),
            "delay": rates_delay(proposal),
        }
        lines.append(toml_line("rates", rates, gyro.reason))
    return lines


def _world_lines(proposal: Proposal, concluded: Mapping[str, Conclusion]) -> list[str]:
    """Return comments with the lines that a lean about the world's axes needs; nothing if it is about the IMU's."""
    asked = concluded.get("[attitude] from")
    if asked is None or asked.determined or proposal.lean is None or proposal.roles.quaternion:
        return []
    lines = ["# if it is about the world's axes, these lines in [columns] in place of [attitude]:"]
    for name, source, sign, unit in zip(
        ("theta", "phi", "psi"),
        proposal.roles.attitude,
        proposal.frame.axis_signs,
        attitude_units(proposal),
        strict=False,
    ):
        entry = {"from": source, "unit": unit, "sign": sign, "delay": proposal.sensor_delay}
        lines.append(f"#   {toml_line(name, entry)}")
        if proposal.gyro is not None:  # without one, the rates are derivatives already
            lines.append(f"#   {toml_line(f'{name}_dot', {'derivative_of': name})}")
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
    if not frame.signs_by_heading:
        lines.append("# signs: assumed; a heading pulse would show in which direction the wheels count")
    elif heading is not None:
        lines.append(
            f"# signs: the sum of the wheels' speeds and the heading correlate by {heading.correlation:.2f}"
        )
    else:
        lines.append("# signs: the lean's acceleration fits the heading that the wheels give with them")
    measured = toml_line(proposal.roles.measured, _wheel_table(proposal), proposal.wheel.reason)
    made = toml_line("speed", {"derivative_of": "angle"})
    if proposal.roles.of_speeds:
        made = toml_line("angle", {"integral_of": "speed"})
    return [*lines, toml_line("sign", frame.signs), measured, made]


def _wheel_table(proposal: Proposal) -> dict[str, object]:
    wheel = proposal.wheel
    table: dict[str, object] = {"from": proposal.roles.angles, "unit": wheel.unit}
    if wheel.unit in (PATH, PER_ROW, "turn/s"):
        unit = "rad" if wheel.unit == PATH else "rad/s"
        table |= {"unit": unit, "scale": float(f"{wheel.factor:.8g}")}
    elif wheel.unit in ("counts", "counts/s"):
        table["counts_per_turn"] = float(f"{2.0 * math.pi / wheel.factor:g}")
    elif wheel.scale != 1.0:
        table["scale"] = wheel.scale
    if proposal.roles.wrap is not None:
        table["wrap"] = proposal.roles.wrap
    if proposal.largest_speed is not None:
        table["largest_speed"] = float(f"{proposal.largest_speed:.4g}")
    return table


def _input_lines(proposal: Proposal, robot: Robot, concluded: Mapping[str, Conclusion]) -> list[str]:
    names, evidence = proposal.roles.commands, proposal.drive
    if not names or evidence is None:
        return []
    unit, assigned = evidence.unit, evidence.assigned
    order = proposal.frame.order
    signs: Sequence[int] = [proposal.frame.signs[wheel - 1] for wheel in order]
    by_wheel = [names[wheel - 1] for wheel in order]
    if assigned is not None:
        by_wheel = [names[assigned.wheels.index(wheel)] for wheel in range(len(names))]
        signs = [assigned.signs[assigned.wheels.index(wheel)] for wheel in range(len(names))]
    # [wheels] order applies to these lists, too
    listed = {wheel: place for place, wheel in enumerate(order)}
    places = [listed[k] for k in range(1, len(names) + 1)]
    zero, directions = proposal.roles.zero, dict(zip(names, proposal.roles.directions, strict=False))
    return [
        "[input]",
        *_kind_lines(proposal, unit, robot, concluded),
        *_other_kinds(proposal, robot, concluded),
        toml_line("from", [by_wheel[place] for place in places]),
        *([] if zero is None else [toml_line("zero", zero.value, zero.evidence)]),
        *(
            [toml_line("direction", [directions[by_wheel[place]] for place in places], "forward above zero")]
            if directions
            else []
        ),
        toml_line("sign", [signs[place] for place in places]),
        toml_line("delay", proposal.command_delay.applied, _reason(concluded.get("[input] delay"))),
    ]


def _kind_lines(
    proposal: Proposal, unit: Unit, robot: Robot, concluded: Mapping[str, Conclusion]
) -> list[str]:
    """Return the lines that depend on the kind of the command: these stand together, to be replaced together."""
    kind = {"torque": "torque", "current": "current", "duty": "pwm", "voltage": "pwm"}[unit.kind]
    share = proposal.drive.units[unit] if proposal.drive else 0.0
    if (asked := concluded.get("[input] kind")) is not None:
        share = min(share, asked.confidence)
    scale = unit.scale / robot.drive.supply_voltage if unit.kind == "voltage" else unit.scale
    return [
        toml_line("kind", kind, f"{in_percent(share)} %: {unit.description}"),
        toml_line("scale", scale),
        *_motor_lines(proposal, unit, robot, concluded),
    ]


def _other_kinds(proposal: Proposal, robot: Robot, concluded: Mapping[str, Conclusion]) -> list[str]:
    """Return comments with the lines that each kind which is not excluded needs; nothing if the kind is determined."""
    asked = concluded.get("[input] kind")
    if asked is None or asked.determined or proposal.drive is None:
        return []
    lines = []
    for kind in asked.alternatives:
        unit = next(unit for unit in proposal.drive.units if unit.kind == kind)  # the likeliest comes first
        needed = _kind_lines(proposal, unit, robot, concluded)
        lines += [
            f"# if it is a {kind}, these lines in place of those above in [input]:",
            *(f"#   {line}" for line in needed),
        ]
    return lines


#: why a resistance is written that nobody states
RESISTANCE_ASSUMED = "assumed: full duty at standstill gives the robot's torque limit"


def _motor_lines(
    proposal: Proposal, unit: Unit, robot: Robot, conclusions: Mapping[str, Conclusion]
) -> list[str]:
    """Return the lines on the motors that a kind of command needs besides its scale."""
    dead_band, concluded = conclusions.get("[input] dead_band"), conclusions.get("[input] resistance")
    drive, robot_file = robot.drive, "from the robot file"
    constant = toml_line("torque_constant", drive.torque_constant, robot_file)
    gear_ratio = toml_line("gear_ratio", drive.gear_ratio, robot_file)
    if unit.kind == "torque":
        return []
    if unit.kind == "current":
        return [constant, gear_ratio]
    band = "# " + toml_line(
        "dead_band", 0.0, "what the firmware adds; not stated, it counts as less dry friction"
    )
    if unit.kind == "voltage":
        band = toml_line("dead_band", 0.0, "a voltage has none")
    elif proposal.dead_band is not None:
        band = toml_line("dead_band", proposal.dead_band, "given: the duty that the firmware adds")
    elif dead_band is not None and not dead_band.determined:
        expected = proposal.added_duty or 0.0
        band = toml_line("dead_band", expected, "assumed: the duty that the firmware adds; write it here")
    elif proposal.added_duty is not None:
        band = toml_line(
            "dead_band",
            proposal.added_duty,
            "expected by the motion: the duty that the firmware adds; correct it",
        )
    resistance, reason = float(f"{stall_resistance(robot):.6g}"), RESISTANCE_ASSUMED
    if concluded is not None:
        reason += f"; {concluded.evidence}"
    return [
        band,
        toml_line("supply_voltage", drive.supply_voltage, robot_file),
        constant,
        toml_line("back_emf_constant", 1.0 / drive.speed_constant, f"{robot_file}: 1 / speed constant"),
        toml_line("resistance", resistance, reason),
        gear_ratio,
    ]
