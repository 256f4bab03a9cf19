"""A proposal as a mapping file with the reasons as comments, the log that it makes, and the answer in a few lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ballbot.errors import InputError
from ballbot.file_formats import format_line
from ballbot.findings import Finding, by_severity
from ballbot.log.checks import check
from ballbot.log.checks.kinematics import disturbance_findings
from ballbot.log.log import Log
from ballbot.log.mapping import apply_mapping
from ballbot.log.mapping_file import parse_mapping
from ballbot.log.mapping_search.commands import CommandDrive
from ballbot.log.mapping_search.frame import SensorFrame
from ballbot.log.mapping_search.motion import Columned, SensedMotion
from ballbot.log.mapping_search.names import InputKind
from ballbot.log.mapping_search.placement import LeanTest
from ballbot.log.mapping_search.roles import Roles
from ballbot.log.mapping_search.units import Unit
from ballbot.log.pose import with_odometry
from ballbot.printable import printable_line
from ballbot.robot import Robot
from ballbot.schema import toml_line

#: errors of a log that are faults of the recording, under whatever mapping: they stop the analysis of the log, which
#: names them again, and not the mapping
OF_THE_RECORDING = frozenset(("corrupted", "gap", "held", "jump", "missing", "rows", "spike"))
#: largest share of the torques' variance that may change from row to row, 1 - cos(2 pi / 8): a sine of fewer than 8
#: rows a period shows neither when a torque acts nor, of a voltage or duty, the back-EMF of the wheel's speed
MOST_CHANGE = 0.3
#: a delay of the commands is written if it is this many standard errors from zero
CLEAR_DELAY = 2.0


What = Literal["balancing", "held by hand", "free wheels", "IMU only"]


@dataclass(frozen=True, kw_only=True)
class Question:
    """What the log and its user leave open."""

    key: str  #: where the answer stands: "[input] kind"
    name: str  #: "kind of the command"
    answers: tuple[str, ...]  #: the likeliest first
    evidence: str

    @property
    def text(self) -> str:
        """The question with its alternatives."""
        return f"{self.name} ({' or '.join(self.answers)}): {self.evidence}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What a foreign log is."""

    base: Columned
    lean: Unit | None
    motion: SensedMotion | None  #: None without wheels
    frame: SensorFrame
    keep: tuple[tuple[float, float], ...] | None  #: spans of balancing [s]
    what: What
    drive: CommandDrive | None = None
    questions: tuple[Question, ...] = ()
    contradiction: str = ""  #: why it is not this robot's log, in a sentence; empty if nothing says so
    findings: tuple[Finding, ...] = ()

    @property
    def file(self) -> Path:
        return self.base.path

    @property
    def roles(self) -> Roles:
        return self.base.roles

    @property
    def tested(self) -> LeanTest | None:
        return self.motion.tested if self.motion else None


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
            log = mapped(proposal, robot)
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


def mapped(proposal: Proposal, robot: Robot) -> Log:
    """Return the log that a proposal makes; one without a drive takes the commands for torques."""
    text = mapping_text(replace(proposal, questions=()), robot)
    log = Log(apply_mapping(parse_mapping(text, source="the mapping"), proposal.base.cut))
    return with_odometry(log, robot) if proposal.roles.attitude else log


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
    answered = replace(proposal, questions=questions, keep=None, base=replace(proposal.base, rows=None))
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


#: the key of an entry, its value, which is left out if it is None, and the reason; or a line that begins with #
_Entry = tuple[str, object, str]


def mapping_text(proposal: Proposal, robot: Robot) -> str:
    """Return the TOML of the mapping (see `ballbot.log.mapping_file`) that a proposal describes."""
    lines = [
        f"# {printable_line(proposal.file.name)} as a log of the robot {robot.name}, by `ballbot check-log`.",
        format_line("mapping"),
    ]
    if proposal.questions:
        reason = "answer the lines with cannot determine, then remove this line"
        lines.append(toml_line("complete", False, reason))
    asked = {" ".join(one.key.split()[:2]): one.text for one in proposal.questions}
    tables = {
        "[file]": _file_entries(proposal),
        "[time]": _time_entries(proposal),
        "[columns]": _column_entries(proposal),
        "[attitude]": _attitude_entries(proposal),
        "[wheels]": _wheel_entries(proposal),
        "[input]": _input_entries(proposal, robot),
    }
    for table, entries in tables.items():
        if not entries:
            continue
        lines += ["", table]
        for key, value, reason in [("zero", None, ""), *entries] if table == "[input]" else entries:
            if f"{table} {key}" in asked:
                lines.append(printable_line(f"# cannot determine: {asked[f'{table} {key}']}"))
            if key.startswith("#") or value is not None:
                lines.append(_line((key, value, reason)))
    return "\n".join(lines) + "\n"


def _line(entry: _Entry) -> str:
    return entry[0] if entry[0].startswith("#") else toml_line(*entry)


def _file_entries(proposal: Proposal) -> list[_Entry]:
    base, layout = proposal.base, proposal.base.table.layout
    return [
        ("separator", base.table.separator, ""),
        ("header_lines", layout.header_lines, ""),
        ("decimal", "comma" if layout.decimal_comma else None, ""),
        ("names", layout.names, ""),
        ("missing", layout.missing or None, ""),
        ("damaged_rows", "drop" if layout.drop_damaged else None, ""),
        ("repeated_rows", "drop" if base.repeated else None, ""),
        ("unordered_rows", "drop" if base.unordered else None, ""),
        ("rows", base.rows, "time starts again outside these rows"),
    ]


def _time_entries(proposal: Proposal) -> list[_Entry]:
    noise = proposal.motion.noise if proposal.motion else None
    reason = (
        f"noise of the wheel speeds {noise[0]:.2g} rad/s; with the times that the encoders give {noise[1]:.2g}"
        if noise
        else ""
    )
    # an even interval near the rows' own: 5 ms or a multiple, 1 ms if rows come faster
    interval = max(0.005 * int(float(np.median(np.diff(proposal.base.t))) / 0.005 + 0.1), 0.001)
    spans = [(round(start, 3), round(end, 3)) for start, end in proposal.keep or ()]
    return [
        ("repair", True if noise else None, reason),
        ("sample_time", float(f"{interval:g}"), ""),
        ("keep", spans or None, "balancing: neither at rest nor fallen nor held by hand"),
    ]


def _column_entries(proposal: Proposal) -> list[_Entry]:
    roles, time = proposal.roles, proposal.base.time
    source = roles.time if time.name == "s" else {"from": roles.time, "unit": time.name}
    entries: list[_Entry] = [("t", source, time.reason)]
    if roles.attitude and (proposal.motion is None or proposal.motion.gyro is None):
        entries += [(f"{name}_dot", {"derivative_of": name}, "") for name in ("theta", "phi", "psi")]
    return entries


def _attitude_entries(proposal: Proposal) -> list[_Entry]:
    roles, frame, tested, lean = proposal.roles, proposal.frame, proposal.tested, proposal.lean
    gyro = proposal.motion.gyro if proposal.motion else None
    if lean is None:
        return []
    units = proposal.base.angle_units(lean.name)
    entries: list[_Entry] = [
        ("from", roles.attitude, ""),
        ("unit", units[0] if len(set(units)) == 1 else units, lean.reason),
    ]
    if roles.quaternion:
        entries = [("from", roles.quaternion, "a quaternion w, x, y, z")]
    entries.append(("upside_down", roles.half_turn and True, "the roll stays near half a turn"))
    if -1 in frame.axis_signs or any(one.key == "[attitude] sign" for one in proposal.questions):
        entries.append(("sign", frame.axis_signs[: len(roles.attitude)], "of roll, pitch and yaw"))
    if tested is not None:
        reason = f"measured {math.degrees(frame.measured_turn):.1f} deg"
        if tested.phase_error is not None:
            reason += f", standard error {math.degrees(tested.phase_error):.1f} deg"
        entries.append(("turn", round(math.degrees(frame.turn), 1), reason))
    if gyro is not None:
        rates = {
            "from": [roles.gyro[place] for place in gyro.order],
            "unit": gyro.unit,
            "sign": [sign * axis for sign, axis in zip(gyro.signs, frame.axis_signs, strict=True)],
        }
        shown = ", ".join(f"{one:.2f}" for one in gyro.correlations)
        entries.append(("rates", rates, f"correlations with the rates of the angles {shown}"))
    return entries


def _wheel_entries(proposal: Proposal) -> list[_Entry]:
    roles, frame, tested, motion = proposal.roles, proposal.frame, proposal.tested, proposal.motion
    if motion is None:
        return []
    shown = "with the smaller turn of the IMU; a log that turns its heading would show it"
    if motion.heading is not None:
        shown = f"the wheels' sum and the heading's rate correlate by {motion.heading.correlation:.2f}"
    wheel = motion.units[1]
    table: dict[str, object] = {"from": roles.angles, "unit": wheel.name}
    if wheel.name.startswith("counts"):
        table["counts_per_turn"] = float(f"{2.0 * math.pi / wheel.factor:g}")
    if motion.wrap is not None:
        table["wrap"] = motion.wrap
    if motion.largest_speed is not None:
        table["largest_speed"] = float(f"{motion.largest_speed:.4g}")
    own: _Entry = ("speed" if roles.of_speeds else "angle", table, wheel.reason)
    made: _Entry = ("speed", {"derivative_of": "angle"}, "")
    return [
        ("order", frame.order, tested.evidence if tested else "as in the file: nothing tests it"),
        ("sign", frame.signs, shown if tested else "as in the file"),
        *([("angle", {"integral_of": "speed"}, ""), own] if roles.of_speeds else [own, made]),
    ]


def _input_entries(proposal: Proposal, robot: Robot) -> list[_Entry]:
    names, drive, order = proposal.roles.commands, proposal.drive, proposal.frame.order
    if not names:
        return []
    # by the file's wheels, as `order` in [wheels] applies to the motors, too
    columns, signs = list(names), [1] * len(names)
    assigned = drive.assigned if drive else None
    if assigned is not None:
        for j, wheel in enumerate(
            assigned.wheels
        ):  # command j of the log that was compared is number order[j]
            columns[order[wheel] - 1], signs[order[wheel] - 1] = names[order[j] - 1], assigned.signs[j]
    kind, scale = (drive.kind, drive.scale) if drive else ("torque", 1.0)
    entries = _kind_entries(kind or "torque", scale, robot)
    if drive and kind is None:
        entries[0] = ("kind", "torque", "not stated")
        for other, (other_scale, _) in drive.ratios.items():
            lines = [f"#   {_line(one)}" for one in _kind_entries(other, other_scale, robot)]
            alternative = f"# if it is a {other}, these lines in place of the three above:"
            entries += [(line, None, "") for line in (alternative, *lines)]
    if any(one.key == "[input] zero" for one in proposal.questions):
        entries += [("# zero = ..  # the number that stands for no command", None, "")]
        entries += [("# direction = [..]", None, "")]
    delay, reason = 0.0, ""
    if drive:
        delay = round(drive.delay, 4) if drive.delay > CLEAR_DELAY * drive.delay_error else 0.0
        shown = f"{1e3 * drive.delay:.0f} ms, standard error {1e3 * drive.delay_error:.0f} ms"
        reason = f"by the wheels' accelerations {shown}"
    return [
        *entries,
        ("from", columns, ""),
        ("sign", signs, assigned.evidence if assigned else "nothing tests it"),
        ("delay", delay, reason),
    ]


def _kind_entries(kind: InputKind, scale: float, robot: Robot) -> list[_Entry]:
    """Return the entries of [input] that depend on the kind of the command."""
    drive, source = robot.drive, "from the robot file"
    entries: list[_Entry] = [("kind", kind, ""), ("scale", scale, "")]
    motor: list[_Entry] = [
        ("torque_constant", drive.torque_constant, source),
        ("gear_ratio", drive.gear_ratio, source),
    ]
    if kind in ("torque", "current"):
        return entries + (motor if kind == "current" else [])
    band = "dead_band = 0.0  # what the firmware adds; not stated, it counts as less dry friction"
    stall = drive.gear_ratio * drive.torque_constant * drive.supply_voltage / drive.torque_limit
    return [
        *entries,
        (f"# {band}", None, "") if kind == "duty" else ("dead_band", 0.0, "a voltage has none"),
        ("supply_voltage", drive.supply_voltage, source),
        *motor,
        ("back_emf_constant", 1.0 / drive.speed_constant, f"{source}: 1 / speed constant"),
        ("resistance", float(f"{stall:.6g}"), "assumed: full duty at standstill gives the torque limit"),
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
    one, frame = found.proposal, found.proposal.frame
    roles, tested, drive = one.roles, one.tested, one.drive
    without = " (without torques)" if one.what == "balancing" and not roles.commands else ""
    lines = [
        f"{one.file.name}: {one.what}, {np.ptp(one.base.t):.0f} s; usable for {_USES[one.what]}{without}.",
        f"time       {roles.time} [{one.base.time.name}]: {one.base.time.reason}",
    ]
    if one.lean is not None:
        lines.append(f"lean       {', '.join(roles.attitude)} [{one.lean.name}]: {one.lean.reason}")
    if one.motion is not None:
        wheel = one.motion.units[1]
        lines.append(f"wheels     {', '.join(roles.angles)} [{wheel.name}]: {wheel.reason}")
    if tested is not None:
        lines.append(f"order      {list(frame.order)}, signs {list(frame.signs)}: {tested.evidence}")
        error = "" if tested.phase_error is None else f" +- {math.degrees(tested.phase_error):.1f}"
        turn, measured = math.degrees(frame.turn), f"{math.degrees(frame.measured_turn):.1f}{error}"
        words = f"turned by {turn:.1f} deg (measured {measured}); wheel 1 is where the robot file has it"
        lines.append(f"IMU        {words}")
    if drive is not None:
        words = f"{', '.join(roles.commands)}: {drive.kind or 'kind not stated'} x {drive.scale:.6g}"
        if math.isfinite(drive.ratio):
            words += f", {drive.ratio:.2f} times the torques that the motion needs"
        lines.append(f"commands   {words}")
    if drive is not None and drive.assigned is not None:
        wheels, signs, order = drive.assigned.wheels, drive.assigned.signs, frame.order
        by_file = sorted(range(len(order)), key=lambda j: order[j])
        words = f"wheels {[wheels[j] + 1 for j in by_file]}, signs {[signs[j] for j in by_file]}"
        lines.append(f"           for {words}: {drive.assigned.evidence}")
    lines += [f"cannot determine: {question.text}" for question in one.questions]
    told = [f"{finding.severity}: {finding.text}" for finding in found.findings]
    room = MOST_LINES - len(lines) - 1
    lines += told[:room]
    if len(told) > room:
        lines.append(f"{len(told) - room} more in the report.")
    return lines
