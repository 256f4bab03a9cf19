"""A proposal reported: its findings, the mapping file with the reasons as comments, and the log that it makes.

The log is checked against the robot's equations (`ballbot.log.checks`) before anyone relies on it: a mapping that
makes a log with torques of the wrong sign is refused, whatever the confidence of its conclusions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.log.checks import check
from ballbot.log.checks.kinematics import disturbance_findings
from ballbot.log.checks.stuck_encoders import stuck_findings
from ballbot.log.columns import FACTORS
from ballbot.log.log import Log
from ballbot.log.mapping import apply_mapping
from ballbot.log.mapping_file import parse_mapping
from ballbot.log.mapping_inference.command_conclusions import possible_commands
from ballbot.log.mapping_inference.command_units import OF_THE_MOTOR
from ballbot.log.mapping_inference.conclusions import conclusions_of
from ballbot.log.mapping_inference.evidence import CONFIDENT, Conclusion
from ballbot.log.mapping_inference.mapping_text import mapping_text
from ballbot.log.mapping_inference.proposal import Proposal, taken_rows
from ballbot.log.mapping_inference.refusal import contradiction, errors_of, refusal_of, too_short
from ballbot.log.mapping_inference.tolerances import APPLIED, EXPLAINED_FOR_DELAY
from ballbot.log.pose import with_odometry
from ballbot.log.signals import INTERVAL, LONGEST_HOLE, fallen_rows, local_fit
from ballbot.robot import Robot
from ballbot.summary import counted

#: the turn of the IMU is certain if its standard error is below this [rad]
CLEAR_PHASE = np.deg2rad(5.0)
#: gains relative to the robot's within which units and geometry are accepted
GAIN_RANGE = (0.5, 2.0)
#: a logged speed that differs so much from its angle's rate [rad/s] is a glitch
GLITCH = 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """All that a proposal comes to."""

    proposal: Proposal
    conclusions: tuple[Conclusion, ...]
    findings: tuple[Finding, ...]
    text: str  #: the mapping file
    log: Log | None  #: made by the mapping; None if something is undetermined
    refusal: str  #: why the mapping cannot be used as it is: one sentence; empty if it can

    @property
    def undetermined(self) -> tuple[Conclusion, ...]:
        """The conclusions below the confidence that is enough."""
        return tuple(one for one in self.conclusions if not one.determined)


def evaluate(proposal: Proposal, robot: Robot, *, file: Path, out: Path | None = None) -> Evaluation:
    """Return a proposal's findings, its mapping file, and the log that it makes; `out` is the folder that gets them."""
    conclusions, findings = conclusions_of(proposal), findings_of(proposal)
    text = mapping_text(proposal, robot, file=file)
    mapping = str(out / "mapping.toml") if out else "the mapping file"
    log, refusal = None, refusal_of(proposal, conclusions, mapping)
    if not refusal:
        try:
            parsed = parse_mapping(text, source=mapping)
            log = Log(apply_mapping(parsed, _rows_of(proposal)))
            log = with_odometry(log, robot) if proposal.roles.attitude else log
        except InputError as error:
            refusal = f"the mapping makes no log: {error}"
    if log is not None:
        wrong = errors_of(check(log, robot=robot))
        findings = by_severity((*findings, *wrong))
        refusal = contradiction(wrong, mapping)
    return Evaluation(
        proposal=proposal, conclusions=conclusions, findings=findings, text=text, log=log, refusal=refusal
    )


def _rows_of(proposal: Proposal) -> dict[str, NDArray[np.float64]]:
    first, last = proposal.rows or (1, None)
    return taken_rows(
        proposal.table, proposal.roles, proposal.time, (first - 1, last), unordered=proposal.unordered
    )


def findings_of(proposal: Proposal) -> tuple[Finding, ...]:
    """Return the findings on a proposal, warnings first."""
    found = [
        *[_finding("note", "file", note) for note in proposal.table.notes],
        *_rows(proposal),
        *_missing(proposal),
        *_roles(proposal),
        *_contradictions(proposal),
        *_encoders(proposal),
        *stuck_findings(proposal.stuck, names=proposal.roles.angles),
        *_timing(proposal),
        *_placement(proposal),
        *_lean_delay(proposal),
        *_heading(proposal),
        *_episodes(proposal),
        *_gyro(proposal),
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
        "Time does not always increase, or jumps by more than 10 s, as if runs were joined: "
        f"rows {first} to {last} are the longest run."
    )
    return [_finding("warning", "time", sentence)]


def _missing(proposal: Proposal) -> list[Finding]:
    """Return how many cells of the columns that are used are missing."""
    roles, columns = proposal.roles, _rows_of(proposal)
    names = (*roles.attitude, *roles.angles, *roles.commands, *roles.gyro)
    holes = {name: int((~np.isfinite(columns[name])).sum()) for name in names if name in columns}
    incomplete = tuple(name for name, count in holes.items() if count)
    if not incomplete:
        return []
    sentence = (
        f"{sum(holes.values())} cells of {', '.join(incomplete)} are missing; they are filled between values "
        f"{LONGEST_HOLE:g} s apart or less."
    )
    return [_finding("warning", "missing", sentence, incomplete)]


def _roles(proposal: Proposal) -> list[Finding]:
    roles, found = proposal.roles, []
    if proposal.by_data:
        sentence = (
            f"The columns are recognised by their values: {roles.time} is the time, "
            f"{', '.join(roles.attitude)} roll{', pitch and yaw' if len(roles.attitude) > 2 else ' and pitch'}, "
            f"{', '.join(roles.angles)} "
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
    elif not roles.commands:
        found.append(_no_commands(proposal))
    return found


def _no_commands(proposal: Proposal) -> Finding:
    """Return that there are no commands, with the unused columns that may be."""
    names = possible_commands(proposal)
    if not names:
        sentence = "The log has no commands of the motors, and so no torques."
        return _finding("note", "columns", sentence)
    sentence = (
        "No column is recognised as a command of a motor, so that the log will have no torques. The columns "
        f"{', '.join(names)} are unused: if they are commands, rename them u1, u2 and so on."
    )
    return _finding("warning", "columns", sentence, names)


def _contradictions(proposal: Proposal) -> list[Finding]:
    """Return a warning for every name that the numbers contradict."""
    roles, found = proposal.roles, []
    if proposal.by_data:
        return []
    drive = proposal.drive
    pairs = [
        ((roles.time or "",), proposal.time.unit),
        (roles.angles, proposal.wheel.unit),
        (roles.attitude, proposal.lean.unit if proposal.lean else None),
        (roles.attitude[2:], proposal.heading_unit.unit if proposal.heading_unit else None),
        (roles.gyro, proposal.gyro.unit if proposal.gyro else None),
        (
            roles.commands,
            drive.unit.unit.removesuffix(OF_THE_MOTOR) if drive and drive.unit.kind != "duty" else None,
        ),
    ]
    for names, unit in pairs:
        reading = roles.reading(names)
        named = reading.unit if reading else None
        if named is not None and unit is not None and named not in (unit, "%", "rps"):
            sentence = f"The name of {names[0]} has the unit {named}, but its numbers fit {unit}."
            found.append(_finding("warning", "contradiction", sentence, names))
    command = roles.reading(roles.commands)
    named_kind = command.input_kind if command else None
    if drive and named_kind is not None and drive.unit.kind != named_kind:
        name, kind = roles.commands[0], drive.unit.kind
        sentence = f"The name of {name} is that of a {named_kind}, but its numbers fit a {kind}."
        found.append(_finding("warning", "contradiction", sentence, roles.commands))
    return found


def _encoders(proposal: Proposal) -> list[Finding]:
    found = []
    if proposal.largest_speed is not None:
        sentence = (
            "A wheel angle jumps by more than the wheel can turn: its encoder was reset, or starts again after a turn; "
            "the angle is continued."
        )
        found.append(_finding("warning", "reset", sentence, proposal.roles.angles))
    found += _glitches(proposal)
    return found


def _glitches(proposal: Proposal) -> list[Finding]:
    """Return a warning if logged speeds contradict the rates of their angles."""
    names = proposal.roles.speeds
    if not names:
        return []
    columns = _rows_of(proposal)
    angles = np.column_stack([columns[name] for name in proposal.roles.angles]) * proposal.wheel.factor
    logged = np.column_stack([columns[name] for name in names])
    _, speeds = local_fit(columns[proposal.roles.time or ""] * proposal.time.factor, angles, rows=3)
    reading = proposal.roles.reading(names)
    logged *= _speed_factor(reading.unit if reading else None, logged, speeds)
    wrong = int((np.abs(logged - speeds) > GLITCH).any(axis=1).sum())
    if not wrong:
        return []
    sentence = (
        f"The logged speeds {', '.join(names)} differ much from the rates of "
        f"their angles in {counted(wrong, 'row')}; the angles are differentiated instead."
    )
    return [_finding("warning", "glitch", sentence, names)]


def _speed_factor(named: str | None, logged: NDArray[np.float64], speeds: NDArray[np.float64]) -> float:
    """Return what turns logged speeds into rad/s: the unit in their name, or that which fits the angles' rates best."""
    factors = FACTORS["rad/s"]
    if named in factors:
        return factors[named]
    known = np.isfinite(speeds) & np.isfinite(logged)
    sizes = [float(np.abs(one[known]).sum()) for one in (speeds, logged)]
    if min(sizes) <= 0.0:
        return 1.0
    return min(factors.values(), key=lambda one: abs(math.log(sizes[0] / (one * sizes[1]))))


def _timing(proposal: Proposal) -> list[Finding]:
    timing = proposal.timing
    if proposal.roles.of_speeds:
        return []
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
        short = too_short(proposal)
        sentence = f"The log does not show where the wheels are{f': {short}' if short else ''}."
        return [_finding("warning", "wheels", sentence)]
    best, found = tested.placements[0], []
    if tested.confidence < CONFIDENT:
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
            "The log is a mirror image of the robot: the order of the wheels is reversed, or one axis of the IMU "
            f"(roll or pitch); the turning of the heading speaks for {_mirror_words(proposal)}."
        )
        found.append(_finding("note", "wheels", sentence))
    for wheel in best.reversed_wheels:
        sentence = f"Wheel {wheel} of the file counts in the opposite direction to the others."
        found.append(_finding("note", "wheels", sentence))
    return found


#: a lean that seems later than this [s], and than its standard error, is worth a note
NOTED_LAG = 0.01


def _lean_delay(proposal: Proposal) -> list[Finding]:
    """Return a note if the lean seems late and no delay is corrected."""
    tested, late = proposal.lean_test, proposal.lean_delay
    if tested is None or late is None or late.measured or not tested.lag > NOTED_LAG + tested.lag_error:
        return []
    sentence = (
        f"The lean seems to lag behind the wheels by {1e3 * tested.lag:.0f} ms. Play in the gears and noise can cause "
        "this as well as a delay, so it is not corrected: if the IMU's data sheet gives a delay, write it in "
        "[attitude] delay."
    )
    return [_finding("note", "timing", sentence, proposal.roles.attitude)]


def _mirror_words(proposal: Proposal) -> str:
    return "an axis of the IMU" if -1 in proposal.frame.axis_signs else "the order of the wheels"


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


def _gyro(proposal: Proposal) -> list[Finding]:
    if not proposal.roles.gyro or proposal.gyro is not None or not proposal.roles.attitude:
        return []
    why = proposal.unused_gyro or "it does not follow the rates of the angles clearly enough"
    remedy = (
        "Subtract its mean at rest from the columns."
        if proposal.unused_gyro
        else "Name its axes, unit and signs in [attitude] rates if you know them."
    )
    gyro = ", ".join(proposal.roles.gyro)
    sentence = f"The gyro ({gyro}) is not used: {why}. The angles are differentiated. {remedy}"
    return [_finding("warning", "columns", sentence)]


def _commands(proposal: Proposal) -> list[Finding]:
    tested = proposal.commands
    if tested is None:
        assigned = proposal.drive.assigned if proposal.drive else None
        if not proposal.roles.commands or (assigned is not None and assigned.confidence >= CONFIDENT):
            return []
        names, short = ", ".join(proposal.roles.commands), too_short(proposal)
        sentence = f"The log does not show what {names} do to the wheels; check their meaning."
        if short:
            sentence = f"The log does not show what {names} do to the wheels: {short}."
        return [_finding("warning", "commands", sentence)]
    found, assigned = [], proposal.drive.assigned if proposal.drive else None
    if assigned is not None and assigned.wheels != tuple(range(len(assigned.wheels))):
        own = [wheel + 1 for wheel in assigned.wheels]
        sentence = f"The commands are numbered differently from the robot's wheels: they drive wheels {own}."
        found.append(_finding("note", "commands", sentence))
    if assigned is not None and len(set(assigned.signs)) > 1:
        sentence = f"The signs of the commands differ between wheels: {list(assigned.signs)}."
        found.append(_finding("warning", "commands", sentence))
    if any(one.name == "dead band" and not one.determined for one in conclusions_of(proposal)):
        sentence = (
            "The wheels often turn against their duties, or coast, so that a dead band would not act as less dry "
            "friction: give the duty that the firmware adds with --dead-band, 0 if it adds none."
        )
        found.append(_finding("warning", "dead-band", sentence))
    # a delay that is not believed is not applied; none below zero is, though it may be seen
    early = tested.delay < -APPLIED * tested.delay_error and tested.explained >= EXPLAINED_FOR_DELAY
    delay = round(1e3 * (tested.delay if early else proposal.command_delay.applied))
    delays = [f"Commands are logged {-delay} ms after the motors respond"] if delay < 0 else []
    delays += [f"Motors respond {delay} ms after the command"] if delay > 0 else []
    late = round(1e3 * proposal.sensor_delay)
    delays += [f"{'the' if delays else 'The'} lean is logged {late} ms late"] if late > 0 else []
    sentence = " ".join([f"{', '.join(delays)}."] * bool(delays) + _assumed(proposal))
    if sentence:
        found.append(_finding("note", "drive", sentence))
    return found


#: a resistance is said to differ by the motion from so many standard errors on
SAID_ERRORS = 1.5


def _assumed(proposal: Proposal) -> list[str]:
    """Return sentences on what the mapping takes from the robot file for the motors."""
    drive = proposal.drive
    if drive is None or drive.unit.kind == "torque":
        return []
    ratio = drive.torque_ratio
    if drive.unit.kind == "current":
        said = ["The torque constant is the robot file's; it is not measured."]
        if ratio is not None:
            said.append(
                f"By the motion and the robot file's masses the torques are {1.0 / ratio[0]:.2f} times as large "
                f"(standard error {100.0 * ratio[1]:.0f} %), a gear's losses included."
            )
        return said
    said = ["Torque constant and winding resistance are assumed."]
    if proposal.dead_band is None and proposal.added_duty is not None:
        said.append(
            f"A dead band of {proposal.added_duty:.2g} is undone, the expected one by the motion: write the firmware's "
            "in the mapping, 0 if it adds none."
        )
    if ratio is not None and abs(math.log(ratio[0])) > SAID_ERRORS * ratio[1]:
        said.append(
            f"The motion gives {ratio[0] * drive.resistance:.3g} ohm in place of {drive.resistance:.3g} (standard "
            f"error {100.0 * ratio[1]:.0f} %): write the data sheet's in the mapping."
        )
    return [*said, "A free-wheel sweep gives their ratios, a data sheet the scale."]
