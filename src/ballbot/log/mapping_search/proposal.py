"""What a foreign log is, and how it becomes one of Ballbot's: the search, its evidence, and what it leaves to ask.

The user states the kind of the command, names say which columns there are and in which units; the search finds from the
motion the order and signs of wheels and commands and how the IMU sits. Every question is asked at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, Place, Severity
from ballbot.log.checks.lean import motion_of, usable_rows
from ballbot.log.checks.stuck_encoders import Balancing, stuck_encoders, stuck_findings
from ballbot.log.checks.torque_balance import driving_of, gravity_need
from ballbot.log.columns import FACTORS, Columns
from ballbot.log.formats import read_foreign_table
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.imu_angles import integral_of, less_half_a_turn
from ballbot.log.mapping_search.commands import Assignment, Response, assign, command_delay, response
from ballbot.log.mapping_search.evidence import CONFIDENT
from ballbot.log.mapping_search.frame import Frame, HeadingTest, frame_of, heading_test
from ballbot.log.mapping_search.placement import LeanTest, lean_test
from ballbot.log.mapping_search.roles import Roles, roles_of, unused
from ballbot.log.mapping_search.units import (
    MotionGains,
    Unit,
    fastest,
    heading_units,
    lean_units,
    likeliest_units,
    time_unit,
    wheel_units,
)
from ballbot.log.pose import with_odometry
from ballbot.log.row_order import increasing_rows, longest_run, repeated_rows, rows_in_order
from ballbot.log.signals import (
    INTERVAL,
    Smooth,
    balancing_rows,
    even_rows,
    new_messages,
    repaired_noise,
    row_spans,
    sampling_times,
    smooth,
    speed_noise,
    unwrapped,
    without_resets,
)
from ballbot.log.wrapping import clock_note, continuous_clock
from ballbot.robot import Robot

Kind = Literal["torque", "current", "voltage", "duty"]
KINDS: tuple[Kind, ...] = ("torque", "current", "voltage", "duty")
What = Literal["balancing", "held by hand", "free wheels", "IMU only"]


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What the user says of the firmware that wrote the log."""

    command: Kind | None = None
    full_scale: float | None = None  #: the file's number for full duty
    counts_per_turn: float | None = None  #: of a wheel's encoder
    columns: Sequence[str] | None = None  #: names in the file's order


@dataclass(frozen=True, kw_only=True)
class Question:
    """What the log and its user leave open."""

    key: str  #: where the answer stands: "[input] kind", "--columns"
    name: str  #: "kind of the command"
    answers: tuple[str, ...]  #: the likeliest first
    evidence: str

    @property
    def text(self) -> str:
        """The question with its alternatives."""
        return f"{self.name} ({' or '.join(self.answers)}): {self.evidence}"


@dataclass(frozen=True, kw_only=True)
class Gyro:
    """How the columns of a gyro belong to roll, pitch and yaw."""

    order: tuple[int, ...]  #: for x, y, z in turn, the place of its column (from 0) among the gyro's
    signs: tuple[int, ...]
    unit: Unit
    correlations: tuple[float, ...]  #: with the rates of the angles


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What the commands are."""

    assigned: Assignment | None  #: None if the motion cannot be compared with them
    response: Response | None
    kind: Kind | None  #: None if nobody states it
    scale: float  #: what turns the file's number into N m, A, V or a duty
    reason: str
    #: by kind, the likeliest scale and how many times as large as the motion needs the torques then are
    ratios: dict[Kind, tuple[float, float]]
    delay: float  #: [s]
    delay_error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """A file's signals on even rows."""

    rows: NDArray[np.float64]  #: (N,) [s]
    wheels: Smooth
    lean: Smooth | None
    heading: Smooth | None
    usable: NDArray[np.bool_]  #: moving and not fallen


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What a foreign log is; `ballbot.log.mapping_search.text` writes its mapping."""

    file: Path
    table: ForeignTable
    roles: Roles
    cut: Columns  #: the rows that are taken
    rows: tuple[int, int] | None  #: first and last row to take, from 1; None for all
    repeated: bool
    unordered: bool
    time: Unit
    wheel: Unit
    lean: Unit | None
    heading_unit: Unit | None
    gyro: Gyro | None
    noise: (
        tuple[float, float] | None
    )  #: of the speeds, with the file's times and the encoders', if they are repaired
    largest_speed: float | None  #: [rad/s], if an encoder was reset
    wrap: float | None  #: period of the wheel angles in the file's numbers
    tested: LeanTest | None
    heading: HeadingTest | None
    frame: Frame
    drive: Drive | None
    keep: tuple[tuple[float, float], ...] | None  #: spans of balancing [s]
    sample_time: float  #: of even rows [s]
    what: What
    questions: tuple[Question, ...]
    findings: tuple[Finding, ...]
    stated: Stated


#: a wheel faster than this many times the drive's own limit was not turning: its encoder was reset
IMPOSSIBLE_SPEED = 3.0
#: filters that the test of the lean tries [s]
LEAN_WIDTHS = (0.05, 0.12, 0.2)
#: times are repaired if that leaves less than this part of the speed's noise, judged by so many rows
WORTH_REPAIRING, REPAIR_ROWS = 0.7, 6000
#: rows whose intervals differ by less than this part need no repair
EVEN_TIMES = 0.01
#: correlations of a gyro with the rates of the angles from which it is taken, and how far its gain may be off [log]
GYRO_CORRELATION, GYRO_GAIN = 0.75, 0.3
#: standard errors by which a lean about the world's axes must fit better to be asked about, and of the IMU's turn [rad]
WORLD_BETTER, CLEAR_TURN = 1.5, math.radians(8.0)
#: nothing explains the lean if the best placement leaves more of its acceleration
HELD = 0.8
#: an encoder or counter begins again after so many counts
PERIODS = tuple(2.0**bits for bits in (8, 10, 12, 13, 14, 16, 24, 32))
#: full scales of a duty in use; 1023, 1024 and 1000 are one to 3 %, which the largest command tells apart
FULL_SCALES = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 32767.0, 65535.0)
#: a scale is taken by the motion if it is this much [log] nearer than the next one; and the largest ratio of torques,
#: in either direction, that friction which the law lacks explains in a weak motion (2.8 on a real log)
CLEARLY_NEARER, LARGEST_RATIO = 0.5, 4.0
#: a full scale that nobody states must fit the motion this well [log]: others, 400 or 500, are in use, too
FULL_SCALE_FITS = 0.35
#: correlation of a free wheel's speed with its command
FOLLOWED = 0.8
#: kinds are stated by headings with these units
_KIND_OF_UNIT: dict[str, Kind] = {
    "N m": "torque",
    "mN m": "torque",
    "N cm": "torque",
    "A": "current",
    "mA": "current",
    "V": "voltage",
    "mV": "voltage",
    "%": "duty",
}
_SCALES: dict[Kind, dict[str, float]] = {
    "torque": {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2},
    "current": {"A": 1.0, "mA": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "duty": {"%": 0.01},
}


def propose(path: str | Path, robot: Robot, stated: Stated | None = None) -> Proposal:
    """Read a foreign log and propose how it becomes one of Ballbot's.

    Parameters
    ----------
    path : str or Path
        A table of any format that Ballbot reads.
    robot : Robot
        Its geometry, encoders and drives.
    stated : Stated, optional
        What the user says.

    Raises
    ------
    InputError
        If the file is no table, or no names say which columns are the time, and the lean or the wheels.
    """
    stated = stated or Stated()
    table, roles = roles_of(path, read_foreign_table(path, names=stated.columns), robot.wheel_count)
    clock, again = continuous_clock(table.columns[roles.time])
    notes = [_finding("warning", "time", clock_note(roles.time, again), (roles.time,))] if again.size else []
    table = replace(table, columns={**table.columns, roles.time: clock})
    time = time_unit(clock, roles.unit((roles.time,)))
    if time is None:
        raise InputError(
            f"{path}: {roles.time} is no time in s, ms, us or ns by its intervals (median "
            f"{float(np.median(np.diff(clock))):.6g}); write a mapping file with its scale, "
            f'[columns] t = {{ from = "{roles.time}", scale = .. }} in seconds.'
        )
    repeated = repeated_rows(table.columns, roles.time)
    t = time.factor * clock
    first, last = longest_run(t, repeated)
    part = {name: values[first:last] for name, values in table.columns.items()}
    unordered = not bool(increasing_rows(t[first:last][~repeated[first:last]]).all())
    cut = rows_in_order(part, t[first:last], repeated=repeated[first:last], unordered=unordered)
    whole = (first, last) == (0, len(t))
    base = _Base(path=Path(path), cut=cut, roles=roles, time=time, robot=robot, stated=stated)
    motion = _motion(base) if roles.angles else None
    if motion and roles.commands and _what(roles, motion) == "held by hand" and _turned_by(base, motion):
        roles = replace(roles, attitude=(), gyro=(), quaternion=(), half_turn=None)  # of a robot on a stand
        base = replace(base, roles=roles)
        motion = _motion(base)
    frame = frame_of(robot, motion.tested if motion else None, motion.heading if motion else None)
    proposal = Proposal(
        file=Path(path),
        table=table,
        roles=roles,
        cut=cut,
        rows=None if whole else (first + 1, last),
        repeated=bool(repeated.any()),
        unordered=unordered,
        time=time,
        wheel=motion.units[1] if motion else Unit(name="rad", factor=1.0),
        lean=(motion.units[0] if motion else lean_units(base.attitude[:, :2], roles.unit(roles.attitude))[0])
        if roles.attitude
        else None,
        heading_unit=motion.units[2] if motion and len(roles.attitude) > 2 else None,
        gyro=motion.gyro if motion else None,
        noise=motion.noise if motion else None,
        largest_speed=motion.largest_speed if motion else None,
        wrap=motion.wrap if motion else None,
        tested=motion.tested if motion else None,
        heading=motion.heading if motion else None,
        frame=frame,
        drive=None,
        keep=_keep(motion),
        sample_time=_sample_time(base.t),
        what=_what(roles, motion),
        questions=(),
        findings=(),
        stated=stated,
    )
    if motion is not None and roles.commands:
        proposal = replace(proposal, drive=_drive(proposal, base, motion))
    questions = _questions(proposal, motion)
    if whole is False:
        notes.append(
            _finding(
                "warning", "time", f"The longest run is rows {first + 1} to {last}; others are left out."
            )
        )
    findings = (*notes, *_findings(proposal, base, motion))
    return replace(proposal, questions=questions, findings=findings)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Base:
    """The columns that have a role."""

    path: Path
    cut: Columns
    roles: Roles
    time: Unit
    robot: Robot
    stated: Stated

    def stacked(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        return np.column_stack([_filled(self.cut[name]) for name in names])

    @property
    def t(self) -> NDArray[np.float64]:
        return self.cut[self.roles.time] * self.time.factor

    @property
    def attitude(self) -> NDArray[np.float64]:
        """Roll, pitch and, if there is one, yaw (M, 2 or 3) in the roll's unit, upright."""
        values = self.stacked(self.roles.attitude)
        if self.roles.half_turn is not None:
            values[:, 0] = less_half_a_turn(values[:, 0], self.roles.half_turn)
        units, table = [self.roles.unit((name,)) for name in self.roles.attitude[:2]], FACTORS["rad"]
        if units[0] in table and units[1] in table and not self.roles.quaternion:
            values[:, 1] *= table[units[1] or ""] / table[units[0] or ""]
        return values


def _filled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a column with missing values interpolated; counts stay whole numbers."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.where(known, values, 0.0)
    places = np.arange(len(values))
    found = np.interp(places, places[known], values[known])
    return np.round(found) if np.array_equal(values[known], np.round(values[known])) else found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """What the sensors show with the units that the motion supports."""

    units: tuple[Unit, Unit, Unit]  #: of lean, wheels and heading
    likely: dict[tuple[Unit, Unit, Unit], float]
    angles: NDArray[np.float64]  #: (M, n) [rad]
    sampled: NDArray[np.float64]  #: (M,) [s]
    noise: tuple[float, float] | None
    largest_speed: float | None
    wrap: float | None
    signals: Signals
    gyro: Gyro | None
    tested: LeanTest | None
    heading: HeadingTest | None


def _motion(base: _Base) -> _Motion:
    """Return the likeliest units and what the sensors show with them."""
    roles, robot, t = base.roles, base.robot, base.t
    raw, wrap = _continued(base.stacked(roles.angles), of_speeds=roles.of_speeds)
    named = roles.unit(roles.angles)
    wheels = wheel_units(
        t, raw, robot, named, of_speeds=roles.of_speeds, counts_per_turn=base.stated.counts_per_turn
    )
    if roles.of_speeds:
        raw = np.column_stack([integral_of(t, speed) for speed in raw.T])
    none = Unit(name="rad", factor=1.0, named=True)
    leans, headings = [none], [none]
    if roles.attitude:
        leans = [none] if roles.quaternion else lean_units(base.attitude[:, :2], roles.unit(roles.attitude))
    if len(roles.attitude) > 2 and not roles.quaternion:
        headings = heading_units(base.attitude[:, 2], roles.unit(roles.attitude[2:]))
    likely = likeliest_units(leans, wheels, headings, None)
    units = next(iter(likely))
    found = _with_units(base, raw, wrap, units)
    for _ in range(3):
        tested, heading = found.tested, found.heading
        turns = heading is not None and abs(heading.correlation) > 0.9 and heading.confidence >= CONFIDENT
        gains = MotionGains(
            assumed=units,
            gain=tested.gain if tested else None,
            turning=heading.gain if heading and turns else None,
        )
        likely = likeliest_units(leans, wheels, headings, gains)
        if next(iter(likely)) == units:
            break
        units = next(iter(likely))
        found = _with_units(base, raw, wrap, units)
    return replace(found, likely=likely)


def _continued(angles: NDArray[np.float64], *, of_speeds: bool) -> tuple[NDArray[np.float64], float | None]:
    """Return whole-numbered angles (M, n) without the jumps of a full counter, and its period if there is one."""
    whole = bool(np.all(angles == np.round(angles)))
    jump, extent = float(np.abs(np.diff(angles, axis=0)).max(initial=0.0)), float(np.ptp(angles))
    period = next((one for one in PERIODS if 0.6 * one < extent < one + 0.5), None)
    if of_speeds or not whole or period is None or jump < 0.6 * period:
        return angles, None
    return np.column_stack([unwrapped(column, period=period) for column in angles.T]), period


def _with_units(
    base: _Base, raw: NDArray[np.float64], wrap: float | None, units: tuple[Unit, Unit, Unit]
) -> _Motion:
    roles, robot, t = base.roles, base.robot, base.t
    lean, wheel, yaw = units
    angles, limit = raw * wheel.factor, IMPOSSIBLE_SPEED * fastest(robot)
    carried = angles if roles.of_speeds else without_resets(t, angles, limit)
    sampled, noise = (t, None) if roles.of_speeds else _sampled(t, carried)
    attitude = None
    if roles.attitude:
        attitude = base.attitude * np.array([lean.factor, lean.factor, yaw.factor])[: len(roles.attitude)]
    gyro = _gyro(base, sampled, attitude) if attitude is not None and roles.gyro else None
    tried = [_signals(base, carried, sampled, attitude, gyro, width) for width in LEAN_WIDTHS]
    if attitude is not None:
        stuck = stuck_encoders(_balancing(t, carried, attitude))
        near = [(one.start - 1.0, one.end + 1.0) for one in stuck]
        for signals in tried:
            for start, end in near:
                signals.usable[(signals.rows > start) & (signals.rows < end)] = False
    tests = [
        (one, lean_test(robot, one.lean, one.wheels, one.heading, one.usable))
        for one in tried
        if one.lean is not None
    ]
    known = [(one, test) for one, test in tests if test is not None]
    signals, tested = min(known, key=lambda one: _doubt(one[1])) if known else (tried[0], None)
    heading = (
        heading_test(robot, signals.wheels, signals.heading, tested)
        if tested is not None and signals.heading is not None
        else None
    )
    return _Motion(
        units=units,
        likely={},
        angles=carried,
        sampled=sampled,
        noise=noise,
        largest_speed=None if np.allclose(carried, angles, atol=1e-6) else limit,
        wrap=wrap,
        signals=signals,
        gyro=gyro,
        tested=tested,
        heading=heading,
    )


def _balancing(
    t: NDArray[np.float64], angles: NDArray[np.float64], attitude: NDArray[np.float64]
) -> Balancing:
    yaw = np.unwrap(attitude[:, 2]) if attitude.shape[1] > 2 else None
    return Balancing(t=t, wheels=angles, lean=attitude[:, :2], heading=yaw)


def _doubt(tested: LeanTest) -> float:
    """Return how little a test shows: the error of the phase, more if the placement is in doubt."""
    error = tested.phase_error if tested.phase_error is not None else math.pi
    return error / max(tested.confidence, 0.05)


def _sampled(
    t: NDArray[np.float64], angles: NDArray[np.float64]
) -> tuple[NDArray[np.float64], tuple[float, float] | None]:
    """Return when the rows were sampled [s], and the speeds' noise before and after if that was estimated."""
    judged = slice(0, REPAIR_ROWS)
    steps = np.diff(t[judged])
    before = speed_noise(t[judged], angles[judged])
    if before is None or float(np.ptp(steps)) < EVEN_TIMES * float(np.median(steps)):
        return t, None
    after = repaired_noise(t[judged], angles[judged])
    if after is None or after > WORTH_REPAIRING * before:
        return t, None
    return sampling_times(t, angles), (before, after)


def _signals(
    base: _Base,
    angles: NDArray[np.float64],
    sampled: NDArray[np.float64],
    attitude: NDArray[np.float64] | None,
    gyro: Gyro | None,
    width: float,
) -> Signals:
    """Return the signals on even rows; with a gyro, the lean's rates are the gyro's, and the heading without a yaw."""
    rows, kept = even_rows(base.t), new_messages(sampled)
    wheels = smooth(rows, sampled[kept], angles[kept], width=width)
    tilt, heading, commands = None, None, None
    if base.roles.commands:
        latest = np.searchsorted(base.t, rows, side="right") - 1
        commands = base.stacked(base.roles.commands)[np.maximum(latest, 0)]
    if attitude is not None:
        tilt = smooth(rows, sampled[kept], attitude[kept, :2], width=width)
        if attitude.shape[1] > 2:
            heading = smooth(rows, sampled[kept], np.unwrap(attitude[kept, 2:], axis=0), width=width)
    if gyro is not None and tilt is not None:
        rates = base.stacked(base.roles.gyro)[:, list(gyro.order)] * gyro.unit.factor * np.asarray(gyro.signs)
        found = smooth(rows, sampled[kept], rates[kept], width=width)
        tilt = Smooth(value=tilt.value, rate=found.value[:, :2], acceleration=found.rate[:, :2])
        if heading is None:
            turning = found.value[:, 2:]
            heading = Smooth(
                value=INTERVAL * np.cumsum(turning, axis=0), rate=turning, acceleration=found.rate[:, 2:]
            )
    usable = balancing_rows(tilt.value if tilt else None, wheels.rate, commands)
    return Signals(rows=rows, wheels=wheels, lean=tilt, heading=heading, usable=usable)


def _gyro(base: _Base, sampled: NDArray[np.float64], attitude: NDArray[np.float64]) -> Gyro | None:
    """Return which of the 48 ways of a cube a gyro's columns fit the rates of the angles; None if none fits them."""
    rows, kept, with_yaw = even_rows(base.t), new_messages(sampled), attitude.shape[1] > 2
    yaw = np.unwrap(attitude[:, 2]) if with_yaw else np.zeros(len(attitude))
    angles = np.column_stack([attitude[:, :2], yaw])
    gyro = base.stacked(base.roles.gyro)
    best: Gyro | None = None
    for width in (0.05, 0.1, 0.2):
        seen = smooth(rows, sampled[kept], angles[kept], width=width)
        x = smooth(rows, sampled[kept], gyro[kept], width=width).value
        found = _gyro_fit(x, _body_rates(seen), base.roles.unit(base.roles.gyro), with_yaw=with_yaw)
        if found is not None and (best is None or min(found.correlations[:2]) > min(best.correlations[:2])):
            best = found
    return best


def _gyro_fit(
    gyro: NDArray[np.float64], rates: NDArray[np.float64], named: str | None, *, with_yaw: bool
) -> Gyro | None:
    a, b = gyro - gyro.mean(axis=0), rates - rates.mean(axis=0)
    size = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    R = np.divide(a.T @ b, size, out=np.zeros_like(size), where=size > 1e-12)
    axes = (0, 1, 2) if with_yaw else (0, 1)
    order = max(permutations(range(3)), key=lambda p: sum(abs(R[p[axis], axis]) for axis in axes))
    found = [abs(float(R[order[axis], axis])) for axis in axes]
    if min(found[:2]) < GYRO_CORRELATION:
        return None
    signs = [1 if R[order[axis], axis] > 0.0 else -1 for axis in axes]
    if not with_yaw:  # axes of one handedness
        signs.append(signs[0] * signs[1] * (1 if order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1))
    # noise makes a slope too small: least so on the axis that agrees best
    best = int(np.argmax(found))
    gain = float(np.linalg.norm(a[:, order[best]]) / np.linalg.norm(b[:, best]))
    table = FACTORS["rad/s"]
    names = (named,) if named in table else ("rad/s", "deg/s")
    name = min(names, key=lambda one: abs(math.log(gain * table[one or ""]))) or "rad/s"
    if abs(math.log(gain * table[name])) > GYRO_GAIN:
        return None
    unit = Unit(name=name, factor=table[name], named=named is not None)
    return Gyro(order=order, signs=tuple(signs), unit=unit, correlations=tuple(found))


def _body_rates(attitude: Smooth) -> NDArray[np.float64]:
    """Return the angular velocity (N, 3) about the IMU's axes from roll, pitch, yaw and their rates."""
    roll, pitch, _ = attitude.value.T
    roll_dot, pitch_dot, yaw_dot = attitude.rate.T
    return np.column_stack(
        [
            roll_dot - yaw_dot * np.sin(pitch),
            pitch_dot * np.cos(roll) + yaw_dot * np.sin(roll) * np.cos(pitch),
            -pitch_dot * np.sin(roll) + yaw_dot * np.cos(roll) * np.cos(pitch),
        ]
    )


def _what(roles: Roles, motion: _Motion | None) -> What:
    if motion is None:
        return "IMU only"
    if not roles.attitude:
        return "free wheels"
    tested = motion.tested
    return "balancing" if tested is not None and tested.placements[0].unexplained < HELD else "held by hand"


def _keep(motion: _Motion | None) -> tuple[tuple[float, float], ...] | None:
    if motion is None or motion.tested is None:
        return None
    return row_spans(motion.signals.rows, motion.signals.usable & ~motion.tested.pushed) or None


def _sample_time(t: NDArray[np.float64]) -> float:
    """Return an even interval near the rows' own: 5 ms or a multiple, 1 ms if rows come faster."""
    return max(0.005 * int(float(np.median(np.diff(t))) / 0.005 + 0.1), 0.001)


def _drive(proposal: Proposal, base: _Base, motion: _Motion) -> Drive:
    """Return what the commands are: the torques that the motion needs against them, in every order and sign."""
    from ballbot.log.mapping_search.text import raw_log

    roles, frame, robot = base.roles, proposal.frame, base.robot
    assigned, found, log, rows = None, None, None, None
    if roles.attitude and motion.tested is not None:
        try:
            log = with_odometry(raw_log(proposal, robot), robot)
            rows = usable_rows(log, robot)
        except InputError:  # too short, or rows without a value
            log = None
        if log is not None and rows is not None:
            moved = motion_of(log, rows)
            driving = driving_of(log, rows, moved, robot)
            if driving is not None:
                expected = [(wheel, frame.signs[place - 1]) for wheel, place in enumerate(frame.order)]
                assigned = assign(driving, expected)
                found = response(driving, assigned, gravity_need(moved, robot))
    if not roles.attitude:
        assigned = _turned_by(base, motion)
    kind, scale, reason, ratios = _scale_of(base, found, motion)
    delay, error = _delay(base, motion)
    return Drive(
        assigned=assigned,
        response=found,
        kind=kind,
        scale=scale,
        reason=reason,
        ratios=ratios,
        delay=delay,
        delay_error=error,
    )


def _turned_by(base: _Base, motion: _Motion) -> Assignment | None:
    """Return which command turns which free wheel, by their speeds; None if they do not follow the commands."""
    signals = motion.signals
    held = base.stacked(base.roles.commands)
    held = held[np.maximum(np.searchsorted(base.t, signals.rows, side="right") - 1, 0)]
    x, y = (one - one.mean(axis=0) for one in (held, signals.wheels.rate))
    size = np.outer(np.linalg.norm(x, axis=0), np.linalg.norm(y, axis=0))
    R = np.divide(x.T @ y, size, out=np.zeros_like(size), where=size > 1e-12)
    own = tuple(range(len(R)))
    sums = {one: sum(abs(R[j, wheel]) for j, wheel in enumerate(one)) for one in permutations(own)}
    best, other = sorted(sums, key=lambda one: (-round(sums[one], 6), one))[:2]
    alike = np.allclose(held, held[:, :1])
    best = own if alike else best
    if min(abs(R[j, wheel]) for j, wheel in enumerate(best)) < FOLLOWED:
        return None
    return Assignment(
        wheels=best,
        signs=tuple(1 if R[j, wheel] > 0.0 else -1 for j, wheel in enumerate(best)),
        explained=(sums[best] / len(R)) ** 2,
        advantage=math.nan if alike else sums[best] - sums[other],
        next_best="none, all commands are alike" if alike else f"commands for wheels {other}",
        confidence=1.0,
    )


def _delay(base: _Base, motion: _Motion) -> tuple[float, float]:
    commands = base.stacked(base.roles.commands)
    rows, kept = motion.signals.rows, new_messages(motion.sampled)
    held = commands[np.maximum(np.searchsorted(base.t, rows, side="right") - 1, 0)]
    usable = motion.tested.balancing if motion.tested else motion.signals.usable
    if not np.all(held[usable].std(axis=0) > 0.0):
        return math.nan, math.inf
    if np.allclose(held, held[:, :1]):
        held = held[:, :1]
    width = 0.02
    wheels = smooth(rows, motion.sampled[kept], motion.angles[kept], width=width)
    return command_delay(wheels, smooth(rows, rows, held, width=width).value, usable)


def standstill(kind: Kind, robot: Robot) -> float:
    """Return the torque [N m] at standstill of one N m, A, V or full duty: full duty gives the torque limit."""
    drive = robot.drive
    return {
        "torque": 1.0,
        "current": drive.gear_ratio * drive.torque_constant,
        "voltage": drive.torque_limit / drive.supply_voltage,
        "duty": drive.torque_limit,
    }[kind]


def _scale_of(
    base: _Base, found: Response | None, motion: _Motion
) -> tuple[Kind | None, float, str, dict[Kind, tuple[float, float]]]:
    """Return the kind that is stated, its scale and why, and the likeliest scale and ratio of every kind."""
    named = base.roles.unit(base.roles.commands)
    of_unit = _KIND_OF_UNIT.get(named or "")
    kind = base.stated.command or of_unit
    if of_unit is not None and kind != of_unit:
        raise InputError(
            f"{base.path}: the heading of {base.roles.commands[0]} has the unit {named}, which is a {of_unit}; "
            f"--command says {kind}. Correct one of them."
        )
    commands = base.stacked(base.roles.commands)
    largest = float(np.abs(commands).max())
    gain = found.gain if found is not None and math.isfinite(found.gain) else math.nan
    if not base.roles.attitude and largest > 0.0:
        # a free wheel turns at the speed whose back-EMF is the voltage: of a full duty, the supply's
        turned = float(np.abs(motion.signals.wheels.rate).max()) / fastest(base.robot) / largest
        free: dict[Kind, float] = {"duty": 1.0 / turned, "voltage": base.robot.drive.supply_voltage / turned}
        gains = {one: value / standstill(one, base.robot) for one, value in free.items() if turned > 0.0}
    else:
        gains = dict.fromkeys(KINDS, gain)
    ratios: dict[Kind, tuple[float, float]] = {}
    words = ""
    for one in KINDS:
        scales = dict(_SCALES[one])
        if one == "duty":
            fitting = [full for full in FULL_SCALES if largest <= 1.01 * full]
            # no robot balances with a hundredth of its voltage
            fractions = bool(np.any(commands != np.round(commands))) and largest <= 1.01
            scales = {f"{full:g}": 1.0 / full for full in (fitting[:1] if fractions else fitting)}
            if base.stated.full_scale is not None:
                scales = {f"{base.stated.full_scale:g}": 1.0 / base.stated.full_scale}
            elif named == "%":
                scales = {"100": 0.01}
        elif named in scales:
            scales = {named or "": scales[named or ""]}
        if not scales:
            continue
        gain = gains.get(one, math.nan)
        by_motion = {
            name: abs(math.log(max(gain * scale * standstill(one, base.robot), 1e-12)))
            for name, scale in scales.items()
        }
        # without a motion that shows it, the smallest number that holds them all
        ranked = sorted(scales, key=lambda name: by_motion[name] if math.isfinite(gain) else -scales[name])
        scale = scales[ranked[0]]
        ratios[one] = scale, gain * scale * standstill(one, base.robot)
        if one != kind:
            continue
        others = [name for name in ranked[1:] if abs(math.log(scales[name] / scale)) > math.log(1.2)]
        clear = bool(others) and by_motion[others[0]] - by_motion[ranked[0]] > CLEARLY_NEARER
        if others and not (clear and (one != "duty" or by_motion[ranked[0]] < FULL_SCALE_FITS)):
            words = " or ".join([ranked[0], *others[:3]])
    scale, _ = ratios.get(kind, (1.0, math.nan)) if kind else (1.0, math.nan)
    return kind, scale, words, ratios


def _questions(proposal: Proposal, motion: _Motion | None) -> tuple[Question, ...]:
    """Return everything that the log and its user leave open."""
    found = list[Question]()

    def ask(key: str, name: str, answers: Sequence[str], evidence: str) -> None:
        found.append(Question(key=key, name=name, answers=tuple(answers), evidence=evidence))

    roles, tested, frame = proposal.roles, proposal.tested, proposal.frame
    if roles.doubt:
        ask("--columns", "columns", (roles.doubt,), "the names leave it open")
    if motion is None or proposal.what == "held by hand":
        return tuple(found)
    keys = ("[attitude] unit", "[wheels] angle", "[attitude] unit")
    for place, (key, name) in enumerate(zip(keys, ("lean", "wheels", "heading"), strict=True)):
        shares: dict[str, float] = {}
        for units, share in motion.likely.items():
            shares[units[place].name] = shares.get(units[place].name, 0.0) + share
        ranked = sorted(shares, key=lambda one: -shares[one])[:3]
        if shares[ranked[0]] < CONFIDENT:
            shown = ", ".join(f"{100.0 * shares[one]:.0f} %" for one in ranked)
            ask(key, f"unit of the {name}", ranked, f"probabilities {shown}")
    if tested is not None:
        best, other = tested.placements[:2]
        error = tested.phase_error
        if tested.confidence < CONFIDENT:
            evidence = f"the first fits {tested.margin:.2f} times better than the second"
            ask(
                "[wheels] order",
                "order and signs of the wheels",
                (best.description, other.description),
                evidence,
            )
        elif frame.direction < CONFIDENT:
            opposite = str([-sign for sign in frame.signs])
            evidence = (
                "the heading turns too little; with the other signs the IMU is turned by half a turn more"
            )
            ask(
                "[wheels] sign",
                "direction in which all wheels count",
                (str(list(frame.signs)), opposite),
                evidence,
            )
        elif frame.handedness < CONFIDENT:
            evidence = (
                f"the turning of the heading shows it by {abs(tested.same_handedness):.1f} standard errors"
            )
            ask(
                "[attitude] sign",
                "axes of the IMU",
                (str(list(frame.axis_signs)), "one axis reversed"),
                evidence,
            )
        if tested.body_frame < -WORLD_BETTER:
            evidence = f"the world's fit {-tested.body_frame:.1f} standard errors better"
            ask(
                "[attitude] from",
                "axes of the lean",
                ("about the world's axes", "about the IMU's axes"),
                evidence,
            )
        if error is None or error > CLEAR_TURN:
            shown = "unknown" if error is None else f"{math.degrees(error):.0f} deg"
            ask(
                "[attitude] turn",
                "turn of the IMU",
                (f"{math.degrees(frame.turn):.0f} deg",),
                f"known to {shown}",
            )
    if proposal.drive is not None:
        found += _command_questions(proposal, proposal.drive)
    return tuple(found)


def _command_questions(proposal: Proposal, drive: Drive) -> list[Question]:
    found = list[Question]()

    def ask(key: str, name: str, answers: Sequence[str], evidence: str) -> None:
        found.append(Question(key=key, name=name, answers=tuple(answers), evidence=evidence))

    _, ratio = drive.ratios.get(drive.kind, (1.0, math.nan)) if drive.kind else (1.0, math.nan)
    if drive.kind is None:
        shown = [
            f"as {one} the torques are {times:.2g} times those that the motion needs"
            for one, (_, times) in drive.ratios.items()
            if math.isfinite(times)
        ]
        ask("[input] kind", "kind of the command", KINDS, "; ".join(shown) or "say it with --command")
    elif drive.reason:
        name = "full scale of the duty" if drive.kind == "duty" else f"unit of the {drive.kind}"
        ask("[input] scale", name, drive.reason.split(" or "), "the motion does not tell them apart")
    elif math.isfinite(ratio) and not 1.0 / LARGEST_RATIO < ratio < LARGEST_RATIO:
        evidence = f"as it is stated the torques are {ratio:.2g} times those that the motion needs"
        ask("[input] scale", "kind and scale of the command", (drive.kind, "another"), evidence)
    if proposal.tested is None:
        return found
    values = np.column_stack([proposal.cut[name] for name in proposal.roles.commands])
    one = drive.assigned
    if not np.nanmin(values) < 0.0:
        evidence = f"they stay between {np.nanmin(values):g} and {np.nanmax(values):g}"
        answers = f"zero = {np.nanmedian(values):.4g}", "direction = [..], columns with their directions"
        ask("[input] zero", "sign of the commands", answers, evidence)
    elif one is None:
        ask("[input] sign", "order and signs of the commands", ("as numbered",), "too little motion")
    elif one.confidence < CONFIDENT:
        wheels = f"for wheels {[wheel + 1 for wheel in one.wheels]}, signs {list(one.signs)}"
        evidence = (
            f"the first explains {100.0 * one.explained:.0f} %, {one.advantage:.1f} standard errors better"
        )
        ask("[input] sign", "order and signs of the commands", (wheels, one.next_best), evidence)
    return found


def _finding(severity: Severity, code: str, sentence: str, columns: tuple[str, ...] = ()) -> Finding:
    return Finding(severity=severity, code=code, text=sentence, where=Place(columns=columns))


def _findings(proposal: Proposal, base: _Base, motion: _Motion | None) -> list[Finding]:
    """Return what was noticed and not changed."""
    roles, found = proposal.roles, [_finding("note", "file", note) for note in proposal.table.notes]
    used = [
        name for name in (*roles.attitude, *roles.angles, *roles.commands, *roles.gyro) if name in base.cut
    ]
    holes = sum(int((~np.isfinite(base.cut[name])).sum()) for name in used)
    if holes:
        found.append(_finding("warning", "missing", f"{holes} cells are missing; short gaps are filled."))
    if motion is None:
        return found
    if proposal.largest_speed is not None or proposal.wrap is not None:
        sentence = (
            "A wheel angle jumps by more than a wheel can turn: a reset or a full counter; it is continued."
        )
        found.append(_finding("warning", "reset", sentence, roles.angles))
    if roles.attitude and proposal.lean is not None:
        angles = base.attitude * proposal.lean.factor
        if angles.shape[1] > 2 and proposal.heading_unit is not None:
            angles[:, 2] *= proposal.heading_unit.factor / proposal.lean.factor
        found += stuck_findings(
            tuple(stuck_encoders(_balancing(base.t, motion.angles, angles))), names=roles.angles
        )
    if roles.gyro and proposal.gyro is None and roles.attitude:
        sentence = (
            f"The gyro ({', '.join(roles.gyro)}) does not follow the rates of the angles, which are used."
        )
        found.append(_finding("warning", "columns", sentence, roles.gyro))
    if not roles.commands:
        perhaps = unused(proposal.table.columns, roles)
        hint = f" If {', '.join(perhaps)} are, name them u1, u2, .. with --columns." if perhaps else ""
        body = f" {', '.join(roles.body_commands)} are about the body's axes." if roles.body_commands else ""
        sentence = f"No column is a command of a motor, so that the log has no torques.{body}{hint}"
        found.append(_finding("warning", "columns", sentence))
    tested, drive = proposal.tested, proposal.drive
    if tested is not None and tested.pushed.any():
        seconds = float(tested.pushed.sum()) * INTERVAL
        found.append(
            _finding("warning", "hands", f"For {seconds:.1f} s hands or pushes move the robot; left out.")
        )
    if tested is not None and tested.lag > 0.01 + tested.lag_error:
        sentence = (
            f"The lean seems {1e3 * tested.lag:.0f} ms late, as play makes it, too: write [attitude] delay if the "
            "IMU's data sheet gives one."
        )
        found.append(_finding("note", "timing", sentence, roles.attitude))
    if drive is not None and drive.kind is not None:
        _, ratio = drive.ratios.get(drive.kind, (1.0, math.nan))
        if math.isfinite(ratio) and abs(math.log(max(ratio, 1e-12))) > math.log(1.25):
            sentence = (
                f"The torques are {ratio:.2f} times those that the motion and the robot file's masses need."
            )
            found.append(_finding("warning", "scale", sentence, roles.commands))
    return found


def agreement(proposals: Sequence[Proposal]) -> list[tuple[Proposal, str]]:
    """Return the logs of one robot that contradict the others, with what they contradict; the surest comes first."""

    def answer(one: Proposal) -> dict[str, object]:
        found: dict[str, object] = {}
        if one.tested is not None and one.tested.confidence >= CONFIDENT:
            found["wheels"] = one.frame.order
            if one.frame.direction >= CONFIDENT:
                found["signs"] = one.frame.signs
                found["turn"] = round(math.degrees(one.frame.turn) / 30.0) % 12
        if (
            one.drive is not None
            and one.drive.assigned is not None
            and one.drive.assigned.confidence >= CONFIDENT
        ):
            found["commands"] = (one.drive.assigned.wheels, one.drive.assigned.signs)
        return found

    wrong = []
    for one in proposals:
        mine = answer(one)
        for key, value in mine.items():
            votes = [answer(other).get(key) for other in proposals]
            others = [vote for vote in votes if vote is not None and vote != value]
            if len(others) > votes.count(value) or (
                others and one is not proposals[0] and votes.count(value) == 1
            ):
                wrong.append((one, key))
                break
    return wrong
