"""Propose how a foreign log becomes one of Ballbot's: its mapping file, open questions, and the log that it makes.

The user states the kind of the command; columns and units are read from the names. The order and signs of wheels and
commands and the mounting of the IMU are estimated from the motion. All questions are asked at once, in the mapping
file, whose comments are the evidence.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ballbot.errors import InputError, about
from ballbot.file_formats import format_line
from ballbot.findings import Finding, by_severity, error, note, warning
from ballbot.log.checks import check
from ballbot.log.checks.table import judged
from ballbot.log.checks.values import check_copies, is_constant
from ballbot.log.clock import clock_unit, continuous_clock
from ballbot.log.evidence import CONFIDENT
from ballbot.log.formats import read_foreign_table
from ballbot.log.formats.text import OWN_LAYOUT
from ballbot.log.log import Log
from ballbot.log.mapping import DutyTable, InputTable, apply_mapping, parse_mapping
from ballbot.log.mapping_search.commands import (
    KINDS,
    CommandDrive,
    CommandOrder,
    assumed_resistance,
    drive_of,
    likely_dead_band,
    nearest_scale,
    needs_of,
    turned_by,
)
from ballbot.log.mapping_search.motion import (
    Columned,
    SensedMotion,
    Signals,
    Stated,
    Tilts,
    motion_of_file,
)
from ballbot.log.mapping_search.names import ATTITUDE_LOOKS, InputKind, Roles, roles_of, unread_columns
from ballbot.log.placement import EDGE, LEAST_TIME, ROUNDED, LeanTest, SensorFrame, frame_of
from ballbot.log.pose import with_odometry
from ballbot.log.row_order import (
    LONGEST_PAUSE,
    increasing_rows,
    longest_run,
    rows_with_times,
    without_dropouts,
)
from ballbot.log.signals import INTERVAL, MOVING_SPEED, row_spans
from ballbot.log.units import Unit, lean_units
from ballbot.printable import printable_line
from ballbot.robot import Drive, Robot
from ballbot.schema import toml_line
from ballbot.summary import counted

#: standard error of the IMU's turn above which the user is asked [rad]: of four logs of the campaign with an error of 4
#: to 6 degrees one turn is wrong by 15, of 140 with a smaller one none by more than 9; half of it without a heading
CLEAR_TURN = math.radians(4.0)
#: the turn is the angle of the lean's response to the wheels; if its size is this many times the robot's, or the
#: inverse, the turn is asked for, because what changes the size changes the angle. 1.0 to 1.4 on real logs of one robot
CLEAR_GAIN = 1.5
#: size of that response over the robot's beyond which it is another robot
GAIN_RANGE = (0.5, 2.0)
#: the wheels do not explain the lean if the best placement leaves more of its acceleration than this share
HELD = 0.8
#: no robot on a ball leans further than this [rad] in a tenth of the time in which its wheels turn
LARGEST_LEAN = 0.2
#: the largest ratio of torques, in either direction, that friction outside the law explains in a weak motion (2.8 on a
#: real log), and one that is reported: masses and torque constants of robot files are this uncertain
LARGEST_RATIO, NOTABLE_RATIO = 4.0, 1.25
#: least share of the rows in the run that is used: a robot that is started again makes a few runs, a clock that is
#: misread some in every second
LEAST_KEPT = 0.2
#: errors that are faults of the recording under any mapping: they stop the analysis of the log, not the mapping
OF_THE_RECORDING = frozenset(("corrupted", "gap", "held", "jump", "missing", "rows", "spike"))
#: a likely dead band that is not stated, or another full scale, is asked for, or the first reported, if it changes the
#: torques by these shares; of 19 logs with a band the torques are off by 0.7 to 1.1 of that
LARGEST_BAND, NOTABLE_BAND = 0.18, 0.08
#: fewest rows a period of the torques: with fewer, neither the time at which a torque acts nor the back-EMF is known
LEAST_ROWS = 10.0
#: a delay of the commands is written if it is this many standard errors from zero
CLEAR_DELAY = 2.0
What = Literal["balancing", "held by hand", "free wheels", "IMU only"]
#: uses of each kind of log
_USES: dict[What, str] = {
    "balancing": "identify, simulate and validate",
    "held by hand": "nothing but checks of its sensors",
    "free wheels": "identify-driveline",
    "IMU only": "align",
}
#: lines of an answer
MOST_LINES = 30


@dataclass(frozen=True)
class Question:
    """A question that the log and the user's statements leave open."""

    key: str  #: the mapping's entry for the answer: "[input] kind"
    name: str  #: "kind of the command"
    answers: tuple[str, ...]  #: the likeliest first
    evidence: str

    @property
    def text(self) -> str:
        """The question with its alternatives."""
        return f"{self.name} ({' or '.join(self.answers)}): {self.evidence}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """A proposed mapping of a foreign log, with its evidence; `evaluate` adds its file and the log that it makes."""

    base: Columned
    lean: Unit | None
    motion: SensedMotion | None  #: None without wheels
    frame: SensorFrame
    what: What
    keep: tuple[tuple[float, float], ...] | None = None  #: spans of balancing [s]
    drive: CommandDrive | None = None
    questions: tuple[Question, ...] = ()
    findings: tuple[Finding, ...] = ()
    text: str = ""  #: the mapping file
    log: Log | None = None  #: made by the mapping; None if something is open, or it makes none
    refusal: str = ""  #: why the mapping cannot be used as it is: one sentence; empty if it can

    @property
    def roles(self) -> Roles:
        return self.base.roles

    @property
    def robot(self) -> Robot:
        return self.base.robot

    @property
    def tested(self) -> LeanTest | None:
        return self.motion.tested if self.motion else None

    @property
    def faulty(self) -> str:
        """The first error for which no mapping makes a log; empty without one."""
        errors = (item for item in self.findings if item.severity == "error")
        return next((item.text for item in errors if item.code not in OF_THE_RECORDING), "")


def propose(path: str | Path, robot: Robot, stated: Stated | None = None) -> Proposal:
    """Read a foreign log, a table of any format that Ballbot reads, and propose how it becomes one of Ballbot's.

    InputError if the file is no table, or no names say which columns are the time, and the lean or the wheels.
    """
    base, notes = _columned(path, robot, stated or Stated())
    roles = base.roles
    motion = motion_of_file(base) if roles.angles else None
    if motion and roles.commands and roles.attitude and _on_a_stand(base, motion):
        base = replace(base, roles=replace(roles, attitude=(), gyro=(), quaternion=(), half_turn=None))
        motion = motion_of_file(base)
    what = _what(base.roles, motion)
    looks = unread_columns(base.cut, roles)
    if looks:
        listed = (f"{', '.join(names)}{f' ({look})' if look else ''}" for look, names in looks.items())
        names = [name for alike in looks.values() for name in alike]
        notes.append(note("unknown", f"Columns that are not read: {'; '.join(listed)}.", *names))
    if motion is None:
        lean = lean_units(base.raw_attitude[:, :2], roles.unit(roles.attitude))[0]
        frame = frame_of(robot, None)
        return Proposal(base=base, lean=lean, motion=None, frame=frame, what=what, findings=tuple(notes))
    tested, signals, gyro = motion.tested, motion.signals, motion.gyro
    proposal = Proposal(
        base=base,
        what=what,
        motion=motion,
        lean=motion.units[0] if base.roles.attitude else None,
        frame=frame_of(robot, tested, motion.tilts.handedness + (gyro.handedness if gyro else 0.0)),
        keep=(row_spans(signals.rows, signals.usable & ~tested.pushed) if tested else ()) or None,
    )
    if roles.commands:
        try:
            needs = needs_of(mapped(proposal)[0], robot) if base.roles.attitude and tested else None
        except InputError:  # too short, or rows without a value
            needs = None
        proposal = replace(proposal, drive=drive_of(base, motion, proposal.frame, needs))
    questions = () if what == "held by hand" else tuple(_questions(proposal, motion))
    inclined = [] if roles.attitude else [look for look in ATTITUDE_LOOKS if len(looks.get(look, ())) > 1]
    for look in inclined[:1]:
        evidence = f"they look like {look}; name them by --columns if they are the lean"
        answers = f"with the lean in {', '.join(looks[look])}", what
        questions = (Question(_LEAN_KEY, "what the log is", answers, evidence), *questions)
    return replace(proposal, questions=questions, findings=(*notes, *_findings(proposal, motion)))


def _columned(path: str | Path, robot: Robot, stated: Stated) -> tuple[Columned, list[Finding]]:
    """Return the rows of a file that are used, and findings on those that are left out."""
    table, roles = roles_of(path, read_foreign_table(path, names=stated.columns), robot.wheel_count)
    with about(path):
        timed = rows_with_times(table.columns, roles.time, [])[roles.time]
        time = clock_unit(timed, roles.time, roles.unit((roles.time,)))
    clock, _ = continuous_clock(table.columns[roles.time])
    first, last = longest_run(time.factor * clock)
    sentences, layout = list(table.notes), table.layout
    cut = {name: values[first:last] for name, values in table.columns.items()}
    cut = rows_with_times(cut, roles.time, sentences)
    notes = [note("file", sentence) for sentence in sentences]
    # a speed by counts of an encoder is 0 again and again
    cut, lost = without_dropouts(
        cut, (*roles.attitude, *roles.gyro, *(() if roles.of_speeds else roles.angles))
    )
    notes += lost
    if len(roles.attitude) == 3 and not roles.quaternion and is_constant(yaw := cut[roles.attitude[2]]):
        text = (
            f"{roles.attitude[2]} is {np.nanmin(yaw):g} throughout, which shows no heading: it is not used."
        )
        notes.append(warning("constant", text, roles.attitude[2]))
        roles = replace(roles, attitude=roles.attitude[:2])
    ordered = increasing_rows(cut[roles.time])
    if not ordered.all():
        cut = {name: values[ordered] for name, values in cut.items()}
        layout = replace(layout, unordered_rows="drop")
    if len(cut[roles.time]) < LEAST_KEPT * len(timed):
        steps = time.factor * np.diff(clock)
        breaks = np.flatnonzero((steps < 0.0) | (steps > LONGEST_PAUSE))
        row = int(breaks[0]) + 1 if breaks.size else 1
        raise InputError(
            f"{path}: time goes back or pauses {counted(breaks.size, 'time')}, first from {clock[row - 1]:.10g} to "
            f"{clock[row]:.10g} in {roles.time} at row {row + 1}, so that of {len(timed)} rows at most "
            f"{len(cut[roles.time])} are one run. Log one clock, with all digits and leading zeros of a fraction, or "
            "give one run in a file."
        )
    if (first, last) != (0, len(clock)):
        notes.append(warning("time", f"The longest run is rows {first + 1} to {last}; others are left out."))
        layout = replace(layout, rows=(first + 1, last))
    return Columned(Path(path), layout, cut, roles, time, robot, stated), notes


def _what(roles: Roles, motion: SensedMotion | None) -> What:
    if motion is None:
        return "IMU only"
    if not roles.attitude:
        return "free wheels"
    tested, lean = motion.tested, motion.signals.lean
    moving = np.abs(motion.signals.wheels.rate).max(axis=1) > MOVING_SPEED
    if tested is None or lean is None or not moving.any():
        return "balancing"  # or standing: too little motion, which is asked for
    away = np.abs(lean.value - np.median(lean.value, axis=0)).max(axis=1)[moving]
    # a lean whose unit is in doubt is not large
    unit = sum(share for units, share in motion.likely.items() if units[0] == motion.units[0])
    large = unit >= CONFIDENT and np.quantile(away, 0.9) > LARGEST_LEAN
    held = large or tested.placements[0].unexplained > HELD
    return "held by hand" if held else "balancing"


def _on_a_stand(base: Columned, motion: SensedMotion) -> bool:
    """Return whether wheels follow commands that no balancing robot gives: of one sign, or alike."""
    commands = base.stacked(base.roles.commands)
    one_way = not commands.min() < 0.0 < commands.max() or np.allclose(commands, commands[:, :1])
    return bool(one_way and turned_by(base, motion) is not None)


def _questions(proposal: Proposal, motion: SensedMotion) -> Iterator[Question]:
    """Yield everything that the log and its user leave open."""
    own = "[wheels] speed" if proposal.roles.of_speeds else "[wheels] angle"
    for index, (key, name) in enumerate((("[attitude] unit", "lean"), (own, "wheels"))):
        shares: dict[str, float] = {}
        for units, share in motion.likely.items():
            shares[units[index].name] = shares.get(units[index].name, 0.0) + share
        ranked = tuple(sorted(shares, key=lambda unit: -shares[unit])[:3])
        if shares[ranked[0]] < CONFIDENT:
            shown = ", ".join(f"{100.0 * shares[unit]:.0f} %" for unit in ranked)
            yield Question(key, f"unit of the {name}", ranked, f"probabilities {shown}")
    yield from _tilt_questions(proposal, motion.tilts)
    yield from _frame_questions(proposal, motion.signals) if proposal.roles.attitude else ()
    if proposal.drive is not None:
        yield from _scale_questions(proposal.drive)
        yield from _sign_questions(proposal, proposal.drive.assigned) if proposal.tested else ()


def _tilt_questions(proposal: Proposal, tilts: Tilts) -> Iterator[Question]:
    with_yaw = len(proposal.roles.attitude) > 2
    # an IMU that knows no heading seldom gives tilts that do not turn with it
    enough = math.log(CONFIDENT / (1.0 - CONFIDENT)) if with_yaw else 0.0
    if tilts.odds >= enough or tilts.apart < ROUNDED:
        return
    frame, way = proposal.frame, 1 if tilts.sequence == "ZYX" else -1
    words = ("ZYX: they turn with the heading", "XYZ: they are tilts that do not")[::way]
    turn = frame.turn + way * frame.axis_signs[2] * tilts.heading
    other = f"write turn = {math.degrees(turn):.1f}" if with_yaw else "name a column with the yaw"
    differs = f"the lean differs by {math.degrees(tilts.apart):.0f} deg, as the heading turns"
    evidence = f"{differs}; for the second {other}"
    yield Question("[attitude] sequence", "how roll and pitch follow the yaw", words, evidence)


def _frame_questions(proposal: Proposal, signals: Signals) -> Iterator[Question]:
    tested, frame = proposal.tested, proposal.frame
    order = "[wheels] order", "order and signs of the wheels"
    if tested is None:
        seconds = float(signals.usable.sum()) * INTERVAL
        evidence = f"the robot balances and moves for {seconds:.1f} s, and {LEAST_TIME + 2.0 * EDGE:.1f} s are needed"
        yield Question(*order, ("as in the file",), evidence)
        return
    best, other = tested.placements[:2]
    if tested.confidence < CONFIDENT:
        evidence = f"the first fits {tested.margin:.2f} times better than the second"
        yield Question(*order, (best.description, other.description), evidence)
    elif frame.direction < CONFIDENT:
        words = str(list(frame.signs)), str([-sign for sign in frame.signs])
        evidence = "the heading does not show it; with the other signs the IMU is turned by half a turn more"
        yield Question("[wheels] sign", "direction in which all wheels count", words, evidence)
    elif frame.handedness < CONFIDENT:
        words = str(list(frame.axis_signs)), "one axis reversed"
        evidence = f"lean and yaw are of one handedness with a probability of {100.0 * frame.handedness:.0f} % at most"
        yield Question("[attitude] sign", "axes of the IMU", words, evidence)
    # the error does not have that of a heading by the wheels, of a ball that may spin
    turning = tested.heading or frame.direction >= CONFIDENT
    error, clear = tested.phase_error if turning else None, CLEAR_TURN if tested.heading else 0.5 * CLEAR_TURN
    far = not 1.0 / CLEAR_GAIN < best.gain < CLEAR_GAIN
    if error is None or error > clear or far:
        known = "unknown" if error is None else f"known to {math.degrees(error):.0f} deg"
        if far:
            known += f", and the lean responds {best.gain:.2g} times as strongly as this robot's should"
        yield Question("[attitude] turn", "turn of the IMU", (f"{math.degrees(frame.turn):.0f} deg",), known)


def _scale_questions(drive: CommandDrive) -> Iterator[Question]:
    if drive.kind is None:
        shown = "; ".join(
            f"as {kind} the torques are {times:.2g} times those that the motion needs"
            for kind, (_, times) in drive.ratios.items()
            if math.isfinite(times)
        )
        shown = f"state it with --command{shown and f'; {shown}'}"
        yield Question("[input] kind", "kind of the command", KINDS, shown)
    elif drive.scales:
        name = "full scale of the duty" if drive.kind == "duty" else f"unit of the {drive.kind}"
        known = zip(drive.scales, drive.misfits, strict=True)
        listed = ", ".join(f"{scale}: {times:.3g}" for scale, times in known if math.isfinite(times))
        shown = f"times the torques that the motion needs, {listed}" if listed else "too little motion"
        yield Question("[input] scale", name, drive.scales, shown)
    elif math.isfinite(drive.ratio) and not 1.0 / LARGEST_RATIO < drive.ratio < LARGEST_RATIO:
        evidence = f"as it is stated the torques are {drive.ratio:.2g} times those that the motion needs"
        yield Question("[input] scale", "kind and scale of the command", (drive.kind, "another"), evidence)


def _sign_questions(proposal: Proposal, assigned: CommandOrder | None) -> Iterator[Question]:
    values = np.array([proposal.base.cut[name] for name in proposal.roles.commands])
    if not np.nanmin(values) < 0.0:
        words = f"zero = {np.nanmedian(values):.4g}", "direction = [..], columns with their directions"
        # magnitudes are small most often, and commands about an offset reach neither end
        low, high = np.nanquantile(values, [0.0, 1.0])
        if np.mean(values < low + 0.1 * (high - low)) > 3.0 * np.mean(values > high - 0.1 * (high - low)):
            words = words[1], "zero = .., the number that stands for no command"
        evidence = f"they stay between {np.nanmin(values):g} and {np.nanmax(values):g}"
        yield Question("[input] zero", "sign of the commands", words, evidence)
    elif assigned is None or assigned.confidence < CONFIDENT:
        words, evidence = ("as numbered",), "too little motion"
        if assigned is not None:
            words = assigned.description, assigned.next_best
            explained = f"the first explains {100.0 * assigned.explained:.0f} %"
            evidence = f"{explained}, {assigned.advantage:.1f} standard errors better"
        yield Question("[input] sign", "order and signs of the commands", words, evidence)


def _findings(proposal: Proposal, motion: SensedMotion) -> Iterator[Finding]:
    """Yield findings that the mapping does not correct."""
    roles, tested, cut = proposal.roles, motion.tested, proposal.base.cut
    if proposal.what != "free wheels":
        yield from _sensor_faults(proposal, motion)
    used = [name for name in (*roles.attitude, *roles.angles, *roles.commands, *roles.gyro) if name in cut]
    holes = sum(int((~np.isfinite(cut[name])).sum()) for name in used)
    if holes:
        yield warning("missing", f"{holes} cells are missing; short gaps are filled.")
    if motion.largest_speed is not None or motion.wrap is not None:
        sentence = "A wheel angle jumps by more than a wheel can turn, at a reset or a full counter: it is continued."
        yield warning("reset", sentence, *roles.angles)
    if (frozen := proposal.base.frozen).any():
        t = proposal.base.t
        seconds, first = float(np.median(np.diff(t))) * float(frozen.sum()), float(t[np.argmax(frozen)])
        sentence = (
            f"The lean repeats one value for {seconds:.2g} s, first at t = {first:.6g} s: it froze; left out."
        )
        yield warning("stuck", sentence, *roles.attitude[:2], time=first)
    if roles.gyro and motion.gyro is None and roles.attitude:
        sentence = f"The gyro ({', '.join(roles.gyro)}) does not follow the angles, whose rates are used."
        yield warning("columns", sentence, *roles.gyro)
    if not roles.commands:
        sentence = "No column is named as a motor's command. If there are any, name them u1, .. by --columns."
        yield warning("columns", sentence)
    if tested is not None:
        if seconds := float(tested.pushed.sum()) * INTERVAL:
            sentence = f"For {seconds:.1f} s something other than the wheels moves the robot; left out."
            yield warning("hands", sentence)
        if tested.lag > 0.01 + tested.lag_error:
            seems = f"The lean seems {1e3 * tested.lag:.0f} ms late, as play makes it, too"
            yield note("timing", f"{seems}: write [attitude] delay if the IMU has one.", *roles.attitude)
    if proposal.drive is not None:
        yield from _torque_finding(proposal.drive, proposal.robot.drive, roles.commands)


def _sensor_faults(proposal: Proposal, motion: SensedMotion) -> Iterator[Finding]:
    """Yield the errors of a balancing robot's columns that no sensor gives."""
    roles, cut, tested = proposal.roles, proposal.base.cut, motion.tested
    for group in (roles.angles, () if roles.quaternion else roles.attitude[:2], roles.gyro, roles.commands):
        yield from check_copies(cut, group)
    for name in (*roles.angles, *roles.attitude[:2]):
        if is_constant(cut[name]):
            text = f"{name} is {np.nanmin(cut[name]):g} throughout, as if its sensor or cable were dead."
            yield error("constant", text, name)
    if (tested is None or tested.confidence < CONFIDENT) and not roles.of_speeds:
        sums = dict(zip(roles.angles, np.cumsum(proposal.base.stacked(roles.angles), axis=0).T, strict=True))
        summed = motion_of_file(replace(proposal.base, cut={**cut, **sums})).tested
        if summed and summed.confidence >= CONFIDENT:
            text = (
                f"{', '.join(roles.angles)} do not turn as the robot moves, but their running sums do: they are "
                "changes from row to row. Write their sums into the file, or log the counts themselves."
            )
            yield error("columns", text, *roles.angles)


def _torque_finding(drive: CommandDrive, motor: Drive, columns: Sequence[str]) -> Iterator[Finding]:
    """Yield a warning on torques that are not those that the motion needs, with the motor that would give them."""
    volts, ratio = drive.kind in ("voltage", "duty"), drive.ratio
    stated = bool(motor.resistance) or not volts
    if not math.isfinite(ratio) or (stated and 1.0 / NOTABLE_RATIO < ratio < NOTABLE_RATIO):
        return
    sentence = f"The torques are {ratio:.2f} times those that the motion and the robot's masses need"
    if drive.kind != "torque":
        resistance = f"a resistance of {ratio * assumed_resistance(motor):.3g} ohm or " if volts else ""
        constant = f"a torque constant of {1e3 * motor.torque_constant / ratio:.3g} mN m/A"
        sentence += f": {resistance}{constant} in the robot file would make them agree"
    yield warning("scale", f"{sentence}. Friction identified from this log scales with them.", *columns)


def evaluate(proposal: Proposal) -> Proposal:
    """Return a proposal with its mapping file, the log that it makes, and whether that agrees with the robot."""
    robot, findings, log, refusal = proposal.robot, list(proposal.findings), None, _refusal(proposal)
    drive = None
    if not refusal:
        try:
            log, drive = mapped(proposal)
        except InputError as error:
            refusal = f"the mapping makes no log: {error}"
    if log is not None:
        errors = [error for error in check(log, robot=robot) if error.severity == "error"]
        wrong = [error.text for error in errors if error.code not in OF_THE_RECORDING]
        findings += errors
        refusal = f"the log contradicts the robot {robot.name}: {wrong[0]}" if wrong else _too_coarse(log)
        if isinstance(drive, DutyTable):
            unstated, remarks = _unstated(proposal, log, drive)
            findings += remarks
            if unstated and not refusal:
                proposal, log = replace(proposal, questions=(*proposal.questions, *unstated)), None
                refusal = _refusal(proposal)
    if proposal.tested is not None:
        disturbance = proposal.tested.disturbance
        findings += judged("disturbance", [], disturbance, times=disturbance)
    text = mapping_text(proposal)
    return replace(proposal, findings=by_severity(findings), text=text, log=log, refusal=refusal)


def mapped(proposal: Proposal) -> tuple[Log, InputTable | None]:
    """Return the log that a proposal makes, and its [input]; without a drive the commands are taken for torques."""
    text = mapping_text(replace(proposal, questions=()))
    mapping = parse_mapping(text, source="the mapping")
    log = Log(apply_mapping(mapping, proposal.base.cut, robot=proposal.robot))
    return (with_odometry(log, proposal.robot) if proposal.roles.attitude else log), mapping.input


def _unstated(proposal: Proposal, log: Log, drive: DutyTable) -> tuple[list[Question], list[Finding]]:
    """Return what is asked of the duty because it would change the torques of a log, and what is reported."""
    band, by_band = likely_dead_band(log, proposal.robot, drive)
    scale, by_scale = nearest_scale(proposal.base, log, drive)
    answers = f"{band:.2g}", "0, if the firmware adds none"
    evidence = (
        f"{band:.2g} of full duty that the firmware adds would change the torques by {100.0 * by_band:.0f} % of their "
        "size, because wheels turn against their duties"
    )
    asked, reported = [], []
    if by_band > LARGEST_BAND:
        asked.append(Question(_BAND_KEY, "dead band of the firmware", answers, evidence))
    elif by_band > NOTABLE_BAND:
        reported.append(warning("dead-band", f"No dead band is stated: {evidence}."))
    if by_scale > LARGEST_BAND:
        evidence = f"by {scale} the torques are {100.0 * by_scale:.0f} % of their size apart"
        answers = f"{1.0 / drive.scale:.0f}", scale
        asked.append(Question("[input] scale", "full scale of the duty", answers, evidence))
    return asked, reported


def _too_coarse(log: Log) -> str:
    """Return why the rows of a log are too far apart for its torques; empty if they are not.

    The period is that of a sine with the torques' covariances over one and two rows: noise that differs from row to
    row has none.
    """
    u = log.torques - log.torques.mean(axis=0) if "u1" in log else np.zeros((3, 1))
    once, twice = (float(np.vdot(u[k:], u[:-k])) for k in (1, 2))
    ratio = twice / once if once > 0.0 else 1.0
    cosine = 0.25 * (ratio + math.sqrt(ratio * ratio + 8.0))  # of a row's part of the period
    if cosine >= math.cos(2.0 * math.pi / LEAST_ROWS):
        return ""
    rows = 2.0 * math.pi / math.acos(cosine)
    return (
        f"the torques have a row every {1e3 * log.sample_time:.3g} ms, {rows:.2g} a period, which are too few to show "
        "when they act. Log every control period."
    )


def _refusal(proposal: Proposal) -> str:
    """Return why a proposal makes no log of the robot; empty if it makes one."""
    if proposal.faulty:
        return proposal.faulty
    if proposal.what == "IMU only":
        return (
            "it has no wheel angles, and shows no friction: with a mapping file it is usable for `ballbot align`; for "
            "everything else, log the encoders too."
        )
    if proposal.what == "held by hand":
        return (
            "the wheels do not explain how the robot leans: it is held by hand, stands on a bench, or is not this "
            "robot. Record it while it balances, with every wheel's angle."
        )
    tested = proposal.tested
    gain = tested.placements[0].gain if tested and tested.confidence >= CONFIDENT else 1.0
    if proposal.what == "balancing" and not GAIN_RANGE[0] < gain < GAIN_RANGE[1]:
        return (
            f"the log contradicts the robot {proposal.robot.name}: the lean responds to the wheels {gain:.3g} times as "
            "strongly as this robot's should: a unit, the counts per turn, a radius or the height of the centre of "
            "mass is another."
        )
    names = ", ".join(f"{question.name} ({question.key})" for question in proposal.questions)
    return f"cannot determine: {names}; the lines to fill in are in the mapping file." if names else ""


#: keys of the questions for columns that may be the lean, and for an unstated dead band
_LEAN_KEY = "[attitude] from"
_BAND_KEY = "[input] dead_band"


def mapping_text(proposal: Proposal) -> str:
    """Return the TOML of the mapping (see `ballbot.log.mapping`) that a proposal describes."""
    file = printable_line(proposal.base.path.name)
    lines = [
        f"# {file} as a log of the robot {proposal.robot.name}, by `ballbot check-log`.",
        format_line("mapping"),
    ]
    if proposal.questions:
        reason = "answer the lines with cannot determine, then remove this line"
        lines.append(toml_line("complete", False, reason))
    elif proposal.faulty:
        lines.append(toml_line("complete", False, "columns are faulty: `ballbot check-log` names them"))
    asked = {question.key: question.text for question in proposal.questions}
    tables = {
        **_recording_lines(proposal),
        "[attitude]": _attitude_lines(proposal),
        "[wheels]": _wheel_lines(proposal),
        "[input]": _input_lines(proposal),
    }
    for table, entries in tables.items():
        lines += ["", table] if entries else []
        for line in filter(None, entries):
            question = asked.get(f"{table} {line.removeprefix('# ').partition(' =')[0]}")
            lines += [printable_line(f"# cannot determine: {question}")] if question else []
            lines.append(line)
    return "\n".join(lines) + "\n"


def _line(key: str, value: object, reason: str = "") -> str:
    """Return the line of an entry with its reason; empty for None, as lines that are left out are."""
    return "" if value is None else toml_line(key, value, reason)


def _recording_lines(proposal: Proposal) -> dict[str, list[str]]:
    """Return the lines of the tables on the file, its times and its columns."""
    base, roles, motion = proposal.base, proposal.roles, proposal.motion
    layout = [
        _line(key, value, "time starts again outside these rows" if key == "rows" else "")
        for key, value in vars(base.layout).items()
        if value != getattr(OWN_LAYOUT, key)
    ]
    noise, reason = motion.noise if motion else None, ""
    if noise:
        reason = f"noise of the wheel speeds {noise[0]:.2g} rad/s; with the times that the encoders give {noise[1]:.2g}"
    # an even interval near the rows' own: 5 ms or a multiple, 1 ms if rows come faster
    interval = max(0.005 * int(float(np.median(np.diff(base.t))) / 0.005 + 0.1), 0.001)
    spans = [(round(start, 3), round(end, 3)) for start, end in proposal.keep or ()]
    times = [
        _line("repair", bool(noise) or None, reason),
        _line("sample_time", float(f"{interval:g}")),
        _line("keep", spans or None, "balancing: neither at rest nor fallen nor held by hand"),
    ]
    time: object = roles.time if base.time.name == "s" else {"from": roles.time, "unit": base.time.name}
    derived = ("theta", "phi", "psi") if roles.attitude and (motion is None or motion.gyro is None) else ()
    rates = [_line(f"{name}_dot", {"derivative_of": name}) for name in derived]
    return {"[file]": layout, "[time]": times, "[columns]": [_line("t", time, base.time.reason), *rates]}


def _attitude_lines(proposal: Proposal) -> list[str]:
    roles, frame, tested, lean = proposal.roles, proposal.frame, proposal.tested, proposal.lean
    gyro = proposal.motion.gyro if proposal.motion else None
    if lean is None:
        asked = [question for question in proposal.questions if question.key == _LEAN_KEY]
        return ["# from = [..]  # roll and pitch, and a yaw; or a quaternion w, x, y, z"] * len(asked)
    units = proposal.base.angle_units(lean.name)
    unit = units[0] if len(set(units)) == 1 else units
    lines = [_line("from", roles.attitude), _line("unit", unit, lean.reason)]
    if roles.quaternion:
        lines = [_line("from", roles.quaternion, "a quaternion w, x, y, z")]
    lines.append(_line("upside_down", roles.half_turn and True, "the roll stays near half a turn"))
    if -1 in frame.axis_signs or any(question.key == "[attitude] sign" for question in proposal.questions):
        lines.append(_line("sign", frame.axis_signs[: len(roles.attitude)], "of roll, pitch and yaw"))
    sequence = proposal.motion.tilts.sequence if proposal.motion else "ZYX"
    if sequence == "XYZ" or any(question.key == "[attitude] sequence" for question in proposal.questions):
        lines.append(_line("sequence", sequence, "roll and pitch turn with the heading, ZYX, or do not, XYZ"))
    if tested is not None:
        error = "" if tested.phase_error is None else f" +- {math.degrees(tested.phase_error):.1f}"
        reason = f"measured {math.degrees(frame.measured_turn):.1f}{error}"
        lines.append(_line("turn", round(math.degrees(frame.turn), 1), reason))
    if gyro is not None:
        signs = [sign * axis for sign, axis in zip(gyro.signs, frame.axis_signs, strict=True)]
        rates = {"from": [roles.gyro[axis] for axis in gyro.order], "unit": gyro.unit, "sign": signs}
        shown = ", ".join(f"{correlation:.2f}" for correlation in gyro.correlations)
        lines.append(_line("rates", rates, f"correlations with the rates of the angles {shown}"))
    return lines


def _wheel_lines(proposal: Proposal) -> list[str]:
    roles, frame, tested, motion = proposal.roles, proposal.frame, proposal.tested, proposal.motion
    if motion is None:
        return []
    placed, shown = "as in the file: nothing tests it", "as in the file"
    if tested:
        placed = f"the next best order or signs fit {tested.margin:.1f} times worse"
        shown = "with the smaller turn of the IMU; a log that turns its heading would show it"
    if tested and tested.heading:
        shown = f"the wheels' sum and the heading's rate correlate by {tested.heading.correlation:.2f}"
    wheel, limit = motion.units[1], motion.largest_speed
    counts = float(f"{2.0 * math.pi / wheel.factor:g}") if wheel.name.startswith("counts") else None
    table = {
        "from": roles.angles,
        "unit": wheel.name,
        "counts_per_turn": counts,
        "wrap": motion.wrap,
        "largest_speed": None if limit is None else float(f"{limit:.4g}"),
    }
    given = {key: value for key, value in table.items() if value is not None}
    return [
        _line("order", frame.order, placed),
        _line("sign", frame.signs, shown),
        _line("speed" if roles.of_speeds else "angle", given, wheel.reason),
    ]


def _input_lines(proposal: Proposal) -> list[str]:
    names, drive, order = proposal.roles.commands, proposal.drive, proposal.frame.order
    if not names:
        return []
    columns, signs, evidence = list(names), [1] * len(names), "nothing tests it"
    if drive and drive.assigned:
        # command j of the log that was compared is number order[j], by which [wheels] order takes the motors, too
        better = f"{drive.assigned.advantage:.1f} standard errors better than any other order or signs"
        evidence = f"the motion explains {100.0 * drive.assigned.explained:.0f} % of them, {better}"
        for j, (wheel, sign) in enumerate(zip(drive.assigned.wheels, drive.assigned.signs, strict=True)):
            columns[order[wheel] - 1], signs[order[wheel] - 1] = names[order[j] - 1], sign
    kind, scale, ratio = (drive.kind, drive.scale, drive.ratio) if drive else (None, 1.0, math.nan)
    known = f"{ratio:.2f} times the torques that the motion needs" if math.isfinite(ratio) else ""
    lines = [_line("kind", kind or "torque"), _line("scale", scale, known), *_motor_lines(proposal, kind)]
    if any(question.key == "[input] zero" for question in proposal.questions):
        lines += ["# zero = ..  # the number that stands for no command", "# direction = [..]"]
    delay, reason = 0.0, ""
    if drive and math.isfinite(drive.delay_error):
        delay = round(drive.delay, 4) if drive.delay > CLEAR_DELAY * drive.delay_error else 0.0
        reason = f"by the wheels' accelerations {1e3 * drive.delay:.0f} +- {1e3 * drive.delay_error:.0f} ms"
    return [*lines, _line("from", columns), _line("sign", signs, evidence), _line("delay", delay, reason)]


def _motor_lines(proposal: Proposal, kind: InputKind | None) -> list[str]:
    """Return the lines of [input] on the motors, which a command of this kind needs."""
    drive, source = proposal.robot.drive, "from the robot file"
    motor = [_line(key, getattr(drive, key), source) for key in ("torque_constant", "gear_ratio")]
    if kind not in ("voltage", "duty"):
        return motor if kind == "current" else []
    dead_band = "# dead_band = 0.0  # what the firmware adds; not stated, it counts as less dry friction"
    if kind == "voltage":
        dead_band = _line("dead_band", 0.0, "a voltage has none")
    for question in proposal.questions:
        if question.key == _BAND_KEY:
            dead_band = _line(
                "dead_band", float(question.answers[0]), "an estimate; 0 if the firmware adds none"
            )
    return [
        dead_band,
        _line("supply_voltage", drive.supply_voltage, source),
        *motor,
        _line("back_emf_constant", 1.0 / drive.speed_constant, f"{source}: 1 / speed constant"),
    ]


def answer_lines(proposal: Proposal) -> list[str]:
    """Return the kind of log, the unusual lines of its mapping and the open questions, at most `MOST_LINES` lines."""
    without = " (without torques)" if proposal.what == "balancing" and not proposal.roles.commands else ""
    name, seconds = proposal.base.path.name, f"{np.ptp(proposal.base.t):.0f} s"
    use = "not usable" if proposal.faulty else f"usable for {_USES[proposal.what]}{without}"
    use += ", once the questions are answered" if proposal.questions else ""
    lines = [f"{name}: {proposal.what}, {seconds}; {use}."]
    if any(question.key == _LEAN_KEY for question in proposal.questions):
        lines = [f"{name}: {seconds}; columns that may be the lean are not read."]
    shown = proposal.text.partition("\n\n[columns]")[2].splitlines()
    usual = "derivative_of", "from the robot file"
    lines += [line for line in shown if line and line[0] != "#" and not any(text in line for text in usual)]
    lines += [f"cannot determine: {question.text}" for question in proposal.questions]
    lines += [f"{finding.severity}: {finding.text}" for finding in proposal.findings]
    more = len(lines) - MOST_LINES
    return lines if more <= 0 else [*lines[: MOST_LINES - 1], f"{more + 1} more in the report."]
