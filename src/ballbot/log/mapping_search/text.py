"""A proposal as a mapping file with the reasons as comments, the log that it makes, and the answer in a few lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot.errors import InputError
from ballbot.file_formats import format_line
from ballbot.findings import Finding, by_severity
from ballbot.log.checks import check
from ballbot.log.checks.kinematics import disturbance_findings
from ballbot.log.log import Log
from ballbot.log.mapping import apply_mapping
from ballbot.log.mapping_file import parse_mapping
from ballbot.log.mapping_search.found import KINDS, Proposal, Question
from ballbot.log.mapping_search.names import InputKind
from ballbot.log.pose import with_odometry
from ballbot.printable import printable_line
from ballbot.robot import Robot
from ballbot.schema import toml_line

#: errors of a log that are faults of the recording, under whatever mapping: they stop the analysis of the log, which
#: names them again, and not the mapping
OF_THE_RECORDING = frozenset(
    ("copied", "corrupted", "gap", "held", "jump", "missing", "rows", "spike", "torque-clipped")
)
#: largest share of the torques' variance that may change from row to row, 1 - cos(2 pi / 8): a sine of fewer than 8
#: rows a period shows neither when a torque acts nor, of a voltage or duty, the back-EMF of the wheel's speed
MOST_CHANGE = 0.3
#: a delay of the commands is written if it is this many standard errors from zero
CLEAR_DELAY = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """All that a proposal comes to."""

    proposal: Proposal
    findings: tuple[Finding, ...]
    text: str  #: the mapping file
    log: Log | None  #: made by the mapping; None if something is open, or it makes none
    refusal: str  #: why the mapping cannot be used as it is: one sentence; empty if it can


def surest(evaluated: Sequence[Evaluation]) -> Evaluation:
    """Return what shows most of several logs of one robot: fewest questions, then the surest order of the wheels."""

    def order(one: Evaluation) -> tuple[int, float]:
        tested = one.proposal.tested
        return len(one.proposal.questions) + bool(one.refusal), -(tested.margin if tested else 0.0)

    return min(evaluated, key=order)


def evaluate(proposal: Proposal, robot: Robot, *, common: Proposal | None = None) -> Evaluation:
    """Return a proposal's mapping file, the log that it makes, and whether that agrees with the robot.

    Parameters
    ----------
    proposal : Proposal
    robot : Robot
    common : Proposal, optional
        The surest of several logs of the same robot: it answers what this log leaves open.
    """
    if common is not None:
        proposal = _answered(proposal, common)
    findings, text, log = proposal.findings, mapping_text(proposal, robot), None
    refusal = _refusal(proposal, robot)
    if not refusal:
        try:
            log = Log(apply_mapping(parse_mapping(text, source="the mapping"), proposal.base.cut))
            log = with_odometry(log, robot) if proposal.roles.attitude else log
        except InputError as error:
            refusal = f"the mapping makes no log: {error}"
    if log is not None:
        errors = [one for one in check(log, robot=robot) if one.severity == "error"]
        wrong = [one for one in errors if one.code not in OF_THE_RECORDING]
        findings = by_severity((*findings, *errors))
        if wrong:
            refusal = f"the log contradicts the robot {robot.name}: {wrong[0].text}"
        refusal = refusal or _too_coarse(log)
    if proposal.tested is not None:
        findings = by_severity((*findings, *disturbance_findings(proposal.tested.disturbance)))
    return Evaluation(proposal=proposal, findings=findings, text=text, log=log, refusal=refusal)


def _too_coarse(log: Log) -> str:
    """Return why the rows of a log are too far apart for its torques; empty if they are not."""
    if "u1" not in log:
        return ""
    u = log.torques
    power = 2.0 * float(np.var(u, axis=0).sum())
    share = float(np.var(np.diff(u, axis=0), axis=0).sum()) / power if power > 0.0 else 0.0
    if share <= MOST_CHANGE:
        return ""
    return (
        f"the torques change by {100.0 * share:.0f} % of their variance from row to row, {1e3 * log.sample_time:.3g} "
        "ms apart, which is too coarse to show when they act. Log every control period."
    )


def _answered(proposal: Proposal, common: Proposal) -> Proposal:
    """Return a proposal with the answers of another log of the same robot, and without its own times to keep."""
    still = {one.key for one in common.questions}
    questions = tuple(one for one in proposal.questions if one.key in still)
    answered = replace(proposal, questions=questions, keep=None, rows=None)
    if proposal.questions and proposal.tested is not None and common.tested is not None:
        answered = replace(answered, frame=common.frame)
        if proposal.drive is not None and common.drive is not None:
            drive = replace(proposal.drive, assigned=common.drive.assigned, scale=common.drive.scale)
            answered = replace(answered, drive=drive)
    return answered


def _refusal(proposal: Proposal, robot: Robot) -> str:
    if proposal.what == "IMU only":
        return (
            "it has no wheel angles, and shows no friction: with a mapping file it is usable for `ballbot align`; for "
            "everything else, log the encoders too."
        )
    if proposal.what == "held by hand":
        return (
            "the wheels do not explain how the robot leans: it is held by hand or stands on a bench, or it is not this "
            "robot. Record it while it balances, with every wheel's angle."
        )
    if proposal.contradiction:
        return f"the log contradicts the robot {robot.name}: {proposal.contradiction}"
    if proposal.questions:
        names = ", ".join(f"{one.name} ({one.key})" for one in proposal.questions)
        return f"cannot determine: {names}; the lines to fill in are in the mapping file."
    return ""


def raw_log(proposal: Proposal, robot: Robot) -> Log:
    """Return the log of a proposal without a drive, with the commands as torques in its order of the wheels."""
    text = mapping_text(replace(proposal, questions=()), robot)
    # a hole in one column does not keep the commands' effect from showing
    return Log(apply_mapping(parse_mapping(text, source="the mapping"), proposal.base.cut))


def mapping_text(proposal: Proposal, robot: Robot) -> str:
    """Return the TOML of the mapping (see `ballbot.log.mapping_file`) that a proposal describes."""
    header = [
        f"# {printable_line(proposal.file.name)} as a log of the robot {robot.name}, by `ballbot check-log`.",
        format_line("mapping"),
    ]
    if proposal.questions:
        header.append(
            toml_line("complete", False, "answer the lines with cannot determine, then remove this line")
        )
    parts = [
        header,
        _file_lines(proposal),
        _time_lines(proposal),
        _column_lines(proposal),
        _attitude_lines(proposal),
        _wheel_lines(proposal),
        _input_lines(proposal, robot),
    ]
    return "\n\n".join("\n".join(_asked(part, proposal.questions)) for part in parts if part) + "\n"


def _asked(lines: list[str], questions: Sequence[Question]) -> list[str]:
    """Return the lines of a table with the question before each key that is open, or after its heading."""
    made, table = list[str](), ""
    asked = {" ".join(one.key.split()[:2]): one for one in questions}
    for line in lines:
        table = line if line.startswith("[") else table
        found = asked.get(f"{table} {line.split(' = ')[0].lstrip('# ')}")
        if found is None and table == line == "[input]":
            found = asked.get("[input] zero")
        if found is not None:
            made.append(printable_line(f"# cannot determine: {found.text}"))
        made.append(line)
    return made


def _file_lines(proposal: Proposal) -> list[str]:
    layout = proposal.table.layout
    lines = [
        "[file]",
        toml_line("separator", proposal.table.separator),
        toml_line("header_lines", layout.header_lines),
    ]
    if layout.decimal_comma:
        lines.append(toml_line("decimal", "comma"))
    if layout.names is not None:
        lines.append(toml_line("names", layout.names))
    if layout.missing:
        lines.append(toml_line("missing", layout.missing))
    if layout.drop_damaged:
        lines.append(toml_line("damaged_rows", "drop"))
    if proposal.repeated:
        lines.append(toml_line("repeated_rows", "drop"))
    if proposal.unordered:
        lines.append(toml_line("unordered_rows", "drop"))
    if proposal.rows is not None:
        lines.append(toml_line("rows", proposal.rows, "time starts again outside these rows"))
    return lines


def _time_lines(proposal: Proposal) -> list[str]:
    lines = ["[time]"]
    if proposal.motion is not None and proposal.motion.noise is not None:
        before, after = proposal.motion.noise
        reason = (
            f"noise of the wheel speeds {before:.2g} rad/s; with the times that the encoders give {after:.2g}"
        )
        lines.append(toml_line("repair", True, reason))
    # an even interval near the rows' own: 5 ms or a multiple, 1 ms if rows come faster
    usual = float(np.median(np.diff(proposal.base.t)))
    lines.append(toml_line("sample_time", float(f"{max(0.005 * int(usual / 0.005 + 0.1), 0.001):g}")))
    if proposal.keep is not None:
        spans = [(round(start, 3), round(end, 3)) for start, end in proposal.keep]
        lines.append(toml_line("keep", spans, "balancing: neither at rest nor fallen nor held by hand"))
    return lines


def _column_lines(proposal: Proposal) -> list[str]:
    roles, time = proposal.roles, proposal.time
    source = roles.time if time.name == "s" else {"from": roles.time, "unit": time.name}
    lines = ["[columns]", toml_line("t", source, time.reason)]
    if roles.attitude and (proposal.motion is None or proposal.motion.gyro is None):
        lines += [toml_line(f"{name}_dot", {"derivative_of": name}) for name in ("theta", "phi", "psi")]
    return lines


def _attitude_lines(proposal: Proposal) -> list[str]:
    roles, frame, tested = proposal.roles, proposal.frame, proposal.tested
    gyro = proposal.motion.gyro if proposal.motion else None
    if not roles.attitude or proposal.lean is None:
        return []
    lines = ["[attitude]"]
    if roles.quaternion:
        lines.append(toml_line("from", roles.quaternion, "a quaternion w, x, y, z"))
    else:
        units = proposal.base.angle_units(proposal.lean.name)
        unit: object = units[0] if len(set(units)) == 1 else units
        lines += [toml_line("from", roles.attitude), toml_line("unit", unit, proposal.lean.reason)]
    if roles.half_turn is not None:
        lines.append(toml_line("upside_down", True, "the roll stays near half a turn"))
    if -1 in frame.axis_signs or any(one.key == "[attitude] sign" for one in proposal.questions):
        lines.append(toml_line("sign", frame.axis_signs[: len(roles.attitude)], "of roll, pitch and yaw"))
    if tested is not None:
        error = (
            ""
            if tested.phase_error is None
            else f", standard error {math.degrees(tested.phase_error):.1f} deg"
        )
        reason = f"measured {math.degrees(frame.measured_turn):.1f} deg{error}"
        lines.append(toml_line("turn", round(math.degrees(frame.turn), 1), reason))
    if gyro is not None:
        rates = {
            "from": [roles.gyro[place] for place in gyro.order],
            "unit": gyro.unit,
            "sign": [sign * axis for sign, axis in zip(gyro.signs, frame.axis_signs, strict=True)],
        }
        shown = ", ".join(f"{one:.2f}" for one in gyro.correlations)
        lines.append(toml_line("rates", rates, f"correlations with the rates of the angles {shown}"))
    return lines


def _wheel_lines(proposal: Proposal) -> list[str]:
    roles, frame, tested, motion = proposal.roles, proposal.frame, proposal.tested, proposal.motion
    if motion is None:
        return []
    reason, shown = "as in the file: nothing tests it", "as in the file"
    if tested is not None:
        best, other = tested.placements[:2]
        reason = (
            f"{best.description}; the next best, {other.description}, fits {tested.margin:.1f} times worse"
        )
        shown = "with the smaller turn of the IMU; a log that turns its heading would show it"
    if motion.heading is not None:
        shown = f"the wheels' sum and the heading's rate correlate by {motion.heading.correlation:.2f}"
    lines = ["[wheels]", toml_line("order", frame.order, reason), toml_line("sign", frame.signs, shown)]
    wheel = motion.units[1]
    table: dict[str, object] = {"from": roles.angles, "unit": wheel.name}
    if wheel.name.startswith("counts"):
        table["counts_per_turn"] = float(f"{2.0 * math.pi / wheel.factor:g}")
    if motion.wrap is not None:
        table["wrap"] = motion.wrap
    if motion.largest_speed is not None:
        table["largest_speed"] = float(f"{motion.largest_speed:.4g}")
    if roles.of_speeds:
        return [*lines, toml_line("angle", {"integral_of": "speed"}), toml_line("speed", table, wheel.reason)]
    return [*lines, toml_line("angle", table, wheel.reason), toml_line("speed", {"derivative_of": "angle"})]


def _input_lines(proposal: Proposal, robot: Robot) -> list[str]:
    names, drive, order = proposal.roles.commands, proposal.drive, proposal.frame.order
    if not names:
        return []
    # by the file's wheels, as `order` in [wheels] applies to the motors, too
    columns, signs, reason = list(names), [1] * len(names), "nothing tests it"
    assigned = drive.assigned if drive else None
    if assigned is not None:
        for j, wheel in enumerate(
            assigned.wheels
        ):  # command j of the log that was compared is number order[j]
            columns[order[wheel] - 1], signs[order[wheel] - 1] = names[order[j] - 1], assigned.signs[j]
        reason = (
            f"the motion explains {100.0 * assigned.explained:.0f} % of them, {assigned.advantage:.1f} standard errors "
            "better than any other order or signs"
        )
    kind, scale = (drive.kind, drive.scale) if drive else ("torque", 1.0)
    lines = ["[input]", *kind_lines(kind or "torque", scale, robot, stated=kind is not None)]
    for other in KINDS if drive and kind is None else ():
        if drive and other in drive.ratios:
            lines.append(f"# if it is a {other}, these lines in place of the three above:")
            lines += [f"#   {one}" for one in kind_lines(other, drive.ratios[other][0], robot, stated=True)]
    if any(one.key == "[input] zero" for one in proposal.questions):
        lines += ["# zero = ..  # the number that stands for no command", "# direction = [..]"]
    delay, shown = 0.0, ""
    if drive:
        clear = drive.delay > CLEAR_DELAY * drive.delay_error
        delay = round(drive.delay, 4) if clear else 0.0
        measured = f"{1e3 * drive.delay:.0f} ms, standard error {1e3 * drive.delay_error:.0f} ms"
        shown = f"by the wheels' accelerations {measured}"
    return [
        *lines,
        toml_line("from", columns),
        toml_line("sign", signs, reason),
        toml_line("delay", delay, shown),
    ]


def kind_lines(kind: InputKind, scale: float, robot: Robot, *, stated: bool) -> list[str]:
    """Return the lines of [input] that depend on the kind of the command."""
    drive, source = robot.drive, "from the robot file"
    lines = [
        toml_line("kind", kind, "" if stated else "not stated"),
        toml_line("scale", scale),
    ]
    if kind == "torque":
        return lines
    motor = [
        toml_line("torque_constant", drive.torque_constant, source),
        toml_line("gear_ratio", drive.gear_ratio, source),
    ]
    if kind == "current":
        return [*lines, *motor]
    band = toml_line("dead_band", 0.0, "what the firmware adds; not stated, it counts as less dry friction")
    stall = drive.gear_ratio * drive.torque_constant * drive.supply_voltage / drive.torque_limit
    return [
        *lines,
        f"# {band}" if kind == "duty" else toml_line("dead_band", 0.0, "a voltage has none"),
        toml_line("supply_voltage", drive.supply_voltage, source),
        *motor,
        toml_line("back_emf_constant", 1.0 / drive.speed_constant, f"{source}: 1 / speed constant"),
        toml_line(
            "resistance", float(f"{stall:.6g}"), "assumed: full duty at standstill gives the torque limit"
        ),
    ]


#: what each log is usable for
_USES: Mapping[str, str] = {
    "balancing": "identify, simulate and validate",
    "held by hand": "nothing but checks of its sensors",
    "free wheels": "identify-driveline",
    "IMU only": "align",
}
#: lines of an answer
MOST_LINES = 30


def answer_lines(found: Evaluation) -> list[str]:
    """Return what the log is, what was found in it and what is open, in at most `MOST_LINES` lines."""
    one, roles, tested, drive = (
        found.proposal,
        found.proposal.roles,
        found.proposal.tested,
        found.proposal.drive,
    )
    without = " (without torques)" if one.what == "balancing" and not roles.commands else ""
    lines = [
        f"{one.file.name}: {one.what}, {np.ptp(one.base.t):.0f} s; usable for {_USES[one.what]}{without}."
    ]
    lines.append(f"time       {roles.time} [{one.time.name}]: {one.time.reason}")
    if one.lean is not None:
        lines.append(f"lean       {', '.join(roles.attitude)} [{one.lean.name}]: {one.lean.reason}")
    if one.motion is not None:
        wheel = one.motion.units[1]
        lines.append(f"wheels     {', '.join(roles.angles)} [{wheel.name}]: {wheel.reason}")
    if tested is not None:
        best, other = tested.placements[:2]
        lines.append(
            f"order      {list(one.frame.order)}, signs {list(one.frame.signs)}: {best.description}; the next best, "
            f"{other.description}, fits {tested.margin:.1f} times worse"
        )
        error = tested.phase_error
        shown = "" if error is None else f" +- {math.degrees(error):.1f}"
        lines.append(
            f"IMU        turned by {math.degrees(one.frame.turn):.1f} deg (measured "
            f"{math.degrees(one.frame.measured_turn):.1f}{shown}); wheel 1 is where the robot file has it"
        )
    if drive is not None:
        fits = (
            f", {drive.ratio:.2f} times the torques that the motion needs"
            if math.isfinite(drive.ratio)
            else ""
        )
        lines.append(
            f"commands   {', '.join(roles.commands)}: {drive.kind or 'kind not stated'} x {drive.scale:.6g}{fits}"
        )
        assigned = drive.assigned
        if assigned is not None:
            by_file = sorted(range(len(assigned.wheels)), key=lambda j: one.frame.order[j])
            lines.append(
                f"           for wheels {[assigned.wheels[j] + 1 for j in by_file]}, signs "
                f"{[assigned.signs[j] for j in by_file]}: {100.0 * assigned.explained:.0f} % explained, "
                f"{assigned.advantage:.1f} standard errors before any other order or signs"
            )
    lines += [f"cannot determine: {question.text}" for question in one.questions]
    told = [f"{finding.severity}: {finding.text}" for finding in found.findings]
    room = MOST_LINES - len(lines) - 1
    lines += told[:room]
    if len(told) > room:
        lines.append(f"{len(told) - room} more in the report.")
    return lines
