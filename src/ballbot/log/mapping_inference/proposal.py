"""A mapping proposed for a foreign log, with the evidence for it.

The steps: names or values say which columns there are; intervals and names the unit of the time; encoders when rows
were sampled; the response of the lean to the wheels the units and the frame; the torques that the motion needs what the
commands are. Rates come from a gyro if there is one: lean accelerations from differences of angles are mostly noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.log.checks.stuck_encoders import Balancing, StuckEncoder, stuck_encoders
from ballbot.log.checks.torques import DELAY_EXPLAINED, DELAY_MARGIN, LARGEST_DELAY, response_delay
from ballbot.log.formats import read_foreign_table
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.mapping import (
    Attitude,
    LogMapping,
    MotorInput,
    Source,
    Timing,
    TorqueInput,
    without_repeated_rows,
)
from ballbot.log.mapping_inference.drive import DriveEvidence, drive_evidence
from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.file_signals import GyroTest, Raw, Signals, filled, gyro_of, signals_of
from ballbot.log.mapping_inference.frame import Frame, HeadingTest, frame_of, heading_test
from ballbot.log.mapping_inference.placement import LeanTest, lean_test
from ballbot.log.mapping_inference.recognition import recognise
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.tolerances import Delay, command_delay, lean_delay
from ballbot.log.mapping_inference.units import (
    TURNING_CORRELATION,
    Scale,
    UnitEvidence,
    lean_units,
    paired_units,
    wheel_units,
)
from ballbot.log.mapping_inference.wheel_response import (
    COMMAND_WIDTH,
    WIDER,
    CommandTest,
    command_test,
)
from ballbot.log.signals import (
    REACH,
    new_messages,
    repaired_noise,
    row_spans,
    sampling_times,
    smooth,
    speed_noise,
    without_resets,
)
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit

#: the repair is applied if it leaves less than this fraction of the speed's noise
WORTH_REPAIRING = 0.7
#: rows that this is judged by, a minute at 100 Hz: every wheel is repaired by the others, which takes most of the time
REPAIR_ROWS = 6000
#: times whose intervals differ by less than this part of them need no repair
EVEN_TIMES = 0.01
#: a wheel faster than this many times the drive's own limit was not turning: its encoder was reset
IMPOSSIBLE_SPEED = 3.0
#: filters that the test of the lean tries [s]: the quick robots move at 1 to 3 Hz, and noise of the angles asks for
#: more
LEAN_WIDTHS = (0.05, 0.08, 0.12)


@dataclass(frozen=True, kw_only=True)
class TimingRepair:
    """What the encoders show about the rows' times."""

    before: float | None  #: speed noise by the rows' own times [rad/s]; None if the wheels are too slow
    after: float | None  #: and by those of the encoders, each wheel validated on the others
    worth_it: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What a foreign log seems to be; `ballbot.log.mapping_inference.report` writes its mapping."""

    table: ForeignTable
    roles: Roles
    by_data: bool  #: whether the columns were recognised by their values
    rows: tuple[int, int] | None  #: first and last row to take, from 1; None for all
    time: Scale
    wheel: Scale
    largest_speed: float | None  #: [rad/s], if an encoder was reset
    lean: Scale | None
    gyro: GyroTest | None
    unused_gyro: str  #: why a gyro is not used though its rates fit; empty without a reason of its own
    timing: TimingRepair
    lean_test: LeanTest | None
    heading: HeadingTest | None
    commands: CommandTest | None
    lean_delay: Delay | None  #: of the lean; None if there is none to test
    command_delay: Delay
    frame: Frame
    drive: DriveEvidence | None
    keep: tuple[tuple[float, float], ...] | None  #: spans of balancing [s]; None keeps all
    sample_time: float  #: of even rows [s]
    signals: Signals
    stuck: tuple[StuckEncoder, ...]  #: encoders that hold their angle while their wheels turn
    #: duty that the firmware adds, as the user says; None if it is not known
    dead_band: float | None = None

    @property
    def sensor_delay(self) -> float:
        """Lean later than the wheels [s]; zero if it cannot be told from zero."""
        return 0.0 if self.lean_delay is None else self.lean_delay.applied


def propose(
    path: str | Path, robot: Robot, *, columns: Sequence[str] | None = None, dead_band: float | None = None
) -> Proposal:
    """Read a foreign log and propose how it becomes one of Ballbot's.

    Parameters
    ----------
    path : str or Path
        A table of any format that Ballbot reads, text with or without a header.
    robot : Robot
        Its geometry, encoders and drives.
    columns : sequence of str, optional
        The columns' names, in place of the file's.
    dead_band : float, optional
        Duty that the firmware adds to overcome friction, 0 if it adds none. A log hardly shows it; not given, it is
        counted as less dry friction.

    Raises
    ------
    InputError
        If the file is no table, or neither its names nor its numbers show the time and the wheels' angles.
    """
    found = recognise(path, read_foreign_table(path, names=columns), robot)
    table, roles, time = found.table, found.roles, found.time
    first, last = found.rows
    whole = (first, last) == (0, len(table.columns[roles.time or ""]))
    cut = {name: values[first:last] for name, values in table.columns.items()}
    cut = without_repeated_rows(cut, roles.time or "")
    raw = Raw.of(cut, roles, time)
    units, measured, heading = _settled(raw, _Units.assumed(raw, roles, robot), robot)
    stuck = _stuck(raw, units, measured)
    if stuck:  # what they say meanwhile is wrong
        units, measured, heading = _settled(raw, units, robot, stuck)
    signals, tested = measured.signals, measured.lean_test
    frame = frame_of(robot, tested, heading, measured.gyro)
    usable = tested.balancing if tested else signals.usable
    # by then all wheels count the same way round
    commands = _test_commands(signals, measured.angles * np.asarray(frame.signs), measured.sampled, usable)
    lean, late = _delays(raw, signals, usable, commands, tested)
    proposal = Proposal(
        table=table,
        roles=roles,
        by_data=found.by_data,
        rows=None if whole else (first + 1, last),
        time=time,
        wheel=units.wheel,
        largest_speed=measured.largest_speed,
        lean=units.lean,
        gyro=measured.gyro,
        unused_gyro=measured.unused_gyro,
        timing=measured.timing,
        lean_test=tested,
        heading=heading,
        commands=commands,
        lean_delay=lean,
        command_delay=late,
        frame=frame,
        drive=None,
        keep=_keep(signals, tested),
        sample_time=_sample_time(raw.t),
        signals=signals,
        stuck=stuck,
        dead_band=dead_band,
    )
    if raw.commands is None:
        return proposal
    reading = roles.reading(roles.commands)
    mapping = log_mapping(proposal, delay=proposal.command_delay.applied)
    expected = [
        (frame.order.index(wheel), frame.signs[wheel - 1]) for wheel in range(1, len(frame.order) + 1)
    ]
    # a hole in one column does not keep the commands' effect from showing
    whole_table = {name: values if name == roles.time else filled(values) for name, values in cut.items()}
    drive = drive_evidence(mapping, whole_table, raw.commands, robot, reading=reading, expected=expected)
    return replace(proposal, drive=drive)


def _settled(
    raw: Raw, units: _Units, robot: Robot, stuck: Sequence[StuckEncoder] = ()
) -> tuple[_Units, _Measured, HeadingTest | None]:
    """Return the units that the motion confirms, with what the sensors show with them and with the heading's test."""
    measured = _measured(raw, units, robot, stuck)
    heading = _test_heading(measured.signals, measured.lean_test, robot)
    for _ in range(2):
        changed = units.judged_by(measured.lean_test, heading)
        if changed.factors == units.factors:
            break
        units, measured = changed, _measured(raw, changed, robot, stuck)
        heading = _test_heading(measured.signals, measured.lean_test, robot)
    return units.judged_by(measured.lean_test, heading), measured, heading


def _delays(
    raw: Raw,
    signals: Signals,
    usable: NDArray[np.bool_],
    commands: CommandTest | None,
    tested: LeanTest | None,
) -> tuple[Delay | None, Delay]:
    """Return the delays of lean and commands, with which the latter respond to the former's noise in time."""
    interval = float(np.median(np.diff(raw.t)))
    feedback = _feedback(raw, interval)
    lean = lean_delay(tested, signals) if tested else None
    earliest = 0.0 if feedback is None else -feedback - (lean.applied if lean else 0.0)
    late = command_delay(commands, signals, usable, interval=interval, earliest=earliest)
    if tested and feedback is not None:
        # the check of the log that the mapping makes sees whole rows
        latest = LARGEST_DELAY - 0.5 * interval - feedback - late.applied
        lean = lean_delay(tested, signals, latest=latest)
    return lean, late


def _feedback(raw: Raw, interval: float) -> float | None:
    """Return the lag at which commands respond to the noise of roll and pitch [s]; None if the log does not show it."""
    if raw.attitude is None or raw.commands is None:
        return None
    found = response_delay(raw.attitude[:, :2], raw.commands, interval)
    if found is None or found.explained < DELAY_EXPLAINED or found.lag > LARGEST_DELAY:
        return None
    return found.lag if found.lag >= 0.0 or found.explained > found.at_once + DELAY_MARGIN else None


def log_mapping(proposal: Proposal, *, delay: float) -> LogMapping:
    """Return the mapping of a proposal with the commands as they are in the file, in the file's order."""
    roles, frame, timing = proposal.roles, proposal.frame, proposal.timing
    clock = Source(column=roles.time or "", factor=proposal.time.factor)
    if roles.time_parts:
        clock = Source(column=roles.time_parts[0], nanoseconds=roles.time_parts[1])
    columns = {"t": clock}
    for i, wheel in enumerate(frame.order, start=1):
        factor = frame.signs[wheel - 1] * proposal.wheel.factor
        columns[f"wheel{i}"] = Source(column=roles.angles[wheel - 1], factor=factor)
    derivatives = {f"wheel{i}_dot": f"wheel{i}" for i in range(1, len(frame.order) + 1)}
    attitude = _attitude(proposal)
    if attitude is not None and not attitude.rates:
        derivatives |= {f"{name}_dot": name for name in ("theta", "phi", "psi")}
    motors = tuple(Source(column=name, delay=delay) for name in roles.commands)
    return LogMapping(
        layout=proposal.table.layout,
        columns=columns,
        derivatives=derivatives,
        motors=MotorInput(sources=motors, drive=TorqueInput()),
        attitude=attitude,
        timing=Timing(repair=timing.worth_it, sample_time=proposal.sample_time, keep=proposal.keep),
        largest_speed=proposal.largest_speed,
    )


def _attitude(proposal: Proposal) -> Attitude | None:
    roles, frame, gyro = proposal.roles, proposal.frame, proposal.gyro
    if proposal.lean is None:
        return None
    delay, factor = proposal.sensor_delay, proposal.lean.factor
    sources = tuple(
        Source(column=name, factor=sign * factor, delay=delay)
        for name, sign in zip(roles.attitude, frame.axis_signs, strict=False)
    )
    rates = ()
    if gyro is not None:
        rates = tuple(
            Source(column=roles.gyro[place], factor=sign * gyro.factor, delay=rates_delay(proposal))
            for place, sign in zip(gyro.order, rates_signs(proposal), strict=True)
        )
    return Attitude(
        sources=sources,
        turn=frame.turn,
        rates=rates,
        quaternion=roles.quaternion,
        upside_down=roles.half_turn is not None,
    )


def rates_signs(proposal: Proposal) -> tuple[int, ...]:
    """Return the signs of the gyro's x, y and z in the frame of the corrected IMU."""
    own = proposal.gyro.signs if proposal.gyro else (1, 1, 1)
    return tuple(sign * axis for sign, axis in zip(own, proposal.frame.axis_signs, strict=True))


def rates_delay(proposal: Proposal) -> float:
    """Return the gyro's delay [s]: the angles' less what they are later than the gyro."""
    lag = proposal.gyro.lag if proposal.gyro else 0.0
    return round(max(proposal.sensor_delay - lag, 0.0), 4)


@dataclass(frozen=True, kw_only=True)
class _Units:
    """The units of lean and wheels, and what else they may be."""

    wheel: Scale
    lean: Scale | None
    wheels: dict[Scale, float]  #: logarithms of weights
    leans: dict[Scale, float]

    @staticmethod
    def assumed(raw: Raw, roles: Roles, robot: Robot) -> _Units:
        """Return the units by name and size."""
        wheel_name, lean_name = roles.reading(roles.angles), roles.reading(roles.attitude)
        wheels = wheel_units(raw.angles, robot, wheel_name.unit if wheel_name else None)
        leans: dict[Scale, float] = {}
        if raw.attitude is not None:
            leans = lean_units(raw.attitude[:, :2], lean_name.unit if lean_name else None)
        return _Units(
            wheel=max(wheels, key=lambda one: wheels[one]),
            lean=max(leans, key=lambda one: leans[one]) if leans else None,
            wheels=wheels,
            leans=leans,
        )

    @property
    def factors(self) -> tuple[float, float]:
        """Factors of wheels and lean."""
        return self.wheel.factor, self.lean.factor if self.lean else 1.0

    def judged_by(self, tested: LeanTest | None, heading: HeadingTest | None) -> _Units:
        """Return the likeliest units, given the response of the lean to the wheels, and the heading's."""
        if self.lean is None:
            # without a lean the wheels' units come from names and steps
            lean = Scale(unit="rad", factor=1.0, reason="")
            nothing = UnitEvidence(assumed=(lean, self.wheel), gain=None, gain_error=0.0, turning=None)
            return replace(self, wheel=paired_units({lean: 0.0}, self.wheels, nothing)[1])
        agree = heading is not None and abs(heading.correlation) > TURNING_CORRELATION and heading.significant
        motion = UnitEvidence(
            assumed=(self.lean, self.wheel),
            gain=tested.placements[0].gain if tested and tested.confidence > 0.5 else None,
            gain_error=tested.gain_error if tested else 0.0,
            turning=abs(heading.gain) if heading and agree else None,
        )
        lean, wheel = paired_units(self.leans, self.wheels, motion)
        return replace(self, lean=lean, wheel=wheel)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Measured:
    """What the sensors show with certain units."""

    angles: NDArray[np.float64]  #: (M, n) of the wheels [rad], continued across resets
    largest_speed: float | None
    sampled: NDArray[np.float64]  #: (M,) [s]
    timing: TimingRepair
    signals: Signals
    gyro: GyroTest | None
    unused_gyro: str
    lean_test: LeanTest | None


def _measured(raw: Raw, units: _Units, robot: Robot, stuck: Sequence[StuckEncoder]) -> _Measured:
    limit = IMPOSSIBLE_SPEED * _speed_limit(robot)
    angles = raw.angles * units.wheel.factor
    carried = np.column_stack([without_resets(raw.t, column, limit) for column in angles.T])
    timing, sampled = _timing(raw.t, carried)
    attitude = None if raw.attitude is None or units.lean is None else raw.attitude * units.lean.factor
    signals = _without(stuck, signals_of(raw, carried, sampled, attitude, width=LEAN_WIDTHS[0]))
    gyro, unused_gyro = gyro_of(raw, signals, sampled, attitude), ""
    if gyro is not None and gyro.confidence < CONFIDENT:
        gyro, unused_gyro = None, gyro.unusable  # the angles are differentiated
    tested = None
    if attitude is not None:
        tests = [
            (seen, lean_test(robot, seen.lean, seen.wheels, seen.heading, seen.usable))
            for width in LEAN_WIDTHS
            for seen in [_without(stuck, signals_of(raw, carried, sampled, attitude, width=width, gyro=gyro))]
            if seen.lean is not None
        ]
        known = [(seen, one) for seen, one in tests if one is not None]
        if known:
            signals, tested = min(known, key=lambda pair: _doubt(pair[1]))
    return _Measured(
        angles=carried,
        largest_speed=None if np.allclose(carried, angles, atol=1e-6) else limit,
        sampled=sampled,
        timing=timing,
        signals=signals,
        gyro=gyro,
        unused_gyro=unused_gyro,
        lean_test=tested,
    )


def _without(stuck: Sequence[StuckEncoder], signals: Signals) -> Signals:
    """Return signals of which the rows near an encoder's hold are not usable."""
    usable, reach = signals.usable.copy(), REACH * LEAN_WIDTHS[-1]
    for one in stuck:
        usable &= (signals.rows < one.start - reach) | (signals.rows > one.end + reach)
    return replace(signals, usable=usable) if stuck else signals


def _stuck(raw: Raw, units: _Units, measured: _Measured) -> tuple[StuckEncoder, ...]:
    """Return the holds of encoders during which the rest of the motion says that their wheels turned."""
    if raw.attitude is None or units.lean is None:
        return ()
    late = measured.lean_test.lag if measured.lean_test else 0.0
    angles = np.column_stack(
        [raw.attitude[:, :2], np.unwrap(raw.attitude[:, 2:] * units.lean.factor, axis=0)]
    )
    angles[:, :2] *= units.lean.factor
    angles = np.column_stack([np.interp(raw.t + late, raw.t, column) for column in angles.T])
    motion = Balancing(
        t=raw.t,
        wheels=measured.angles,
        lean=angles[:, :2],
        heading=angles[:, 2] if angles.shape[1] > 2 else None,
    )
    return tuple(stuck_encoders(motion))


def _doubt(tested: LeanTest) -> float:
    """Return how little a test shows: the error of the phase, more if the placement is in doubt."""
    error = tested.phase_error if tested.phase_error is not None else math.pi
    return error / max(tested.confidence, 0.05)


def _speed_limit(robot: Robot) -> float:
    drive = robot.drive
    return wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )


def _timing(t: NDArray[np.float64], angles: NDArray[np.float64]) -> tuple[TimingRepair, NDArray[np.float64]]:
    judged = slice(0, REPAIR_ROWS)
    before = speed_noise(t[judged], angles[judged])
    steps = np.diff(t[judged])
    # a loop that keeps its time to a hundredth of a row reads its sensors in time, too
    kept = float(np.ptp(steps)) < EVEN_TIMES * float(np.median(steps))
    after = repaired_noise(t[judged], angles[judged]) if before is not None and not kept else None
    worth_it = before is not None and after is not None and after < WORTH_REPAIRING * before
    repair = TimingRepair(before=before, after=after, worth_it=worth_it)
    return repair, sampling_times(t, angles) if worth_it else t


def _test_heading(signals: Signals, tested: LeanTest | None, robot: Robot) -> HeadingTest | None:
    if signals.heading is None or tested is None:
        return None
    return heading_test(robot, signals.wheels, signals.heading, tested)


def _test_commands(
    signals: Signals,
    angles: NDArray[np.float64],
    sampled: NDArray[np.float64],
    usable: NDArray[np.bool_],
) -> CommandTest | None:
    if signals.commands is None:
        return None
    kept = new_messages(sampled)
    for width in (COMMAND_WIDTH, WIDER):
        moved = smooth(signals.rows, sampled[kept], angles[kept], width=width)
        found = command_test(signals.rows, moved, signals.commands, usable, width=width)
        if found is not None:
            return found
    return None


def _keep(signals: Signals, tested: LeanTest | None) -> tuple[tuple[float, float], ...] | None:
    if tested is None:
        return None
    kept = row_spans(signals.rows, signals.usable & ~tested.pushed)
    return kept or None


def _sample_time(t: NDArray[np.float64]) -> float:
    """Return an even interval near the rows' own: 5 ms or a multiple, 1 ms if rows come faster."""
    usual = float(np.median(np.diff(t)))
    return max(0.005 * int(usual / 0.005 + 0.1), 0.001)
