"""A mapping proposed for a foreign log, with the evidence for it.

The steps: names or values say which columns there are; intervals and names the unit of the time; encoders when rows
were sampled; the response of the lean to the wheels the units and the frame; the torques that the motion needs what the
commands are. Rates come from a gyro if there is one: lean accelerations from differences of angles are mostly noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.log.checks.stuck_encoders import StuckEncoder
from ballbot.log.checks.torques import DELAY_EXPLAINED, DELAY_MARGIN, LARGEST_DELAY, response_delay
from ballbot.log.columns import Columns
from ballbot.log.formats import read_foreign_table
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.mapping import (
    Attitude,
    LogMapping,
    MotorInput,
    Source,
    Timing,
    TorqueInput,
)
from ballbot.log.mapping_inference.drive import DriveEvidence, drive_evidence
from ballbot.log.mapping_inference.file_signals import GyroTest, Raw, Signals, filled
from ballbot.log.mapping_inference.frame import Frame, HeadingTest, frame_of
from ballbot.log.mapping_inference.measured import (
    AssumedUnits,
    Measured,
    TimingRepair,
    settled_units,
    stuck_in,
)
from ballbot.log.mapping_inference.placement import LeanTest
from ballbot.log.mapping_inference.recognition import recognise
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.tolerances import (
    Delay,
    command_delay,
    lean_delay,
    missed_between_rows,
)
from ballbot.log.mapping_inference.units import Scale
from ballbot.log.mapping_inference.wheel_response import (
    COMMAND_WIDTH,
    WIDER,
    CommandTest,
    command_test,
)
from ballbot.log.row_order import repeated_rows, rows_in_order
from ballbot.log.signals import new_messages, row_spans, smooth
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What a foreign log seems to be; `ballbot.log.mapping_inference.report` writes its mapping."""

    table: ForeignTable
    roles: Roles
    by_data: bool  #: whether the columns were recognised by their values
    rows: tuple[int, int] | None  #: first and last row to take, from 1; None for all
    unordered: bool  #: whether some of these rows are out of order, and left out
    time: Scale
    wheel: Scale
    largest_speed: float | None  #: [rad/s], if an encoder was reset
    lean: Scale | None  #: unit of roll
    pitch_factor: float  #: what turns the pitch into the roll's unit
    heading_unit: Scale | None  #: None without a yaw
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
    #: size of the torques that the controller commands between the rows, over that of all torques
    missed: float = 0.0
    #: duty that the firmware adds, as the user says; None if it is not known
    dead_band: float | None = None

    @property
    def attitude_factors(self) -> tuple[float, ...]:
        """What turns roll, pitch and, if there is one, yaw into rad."""
        lean = self.lean.factor if self.lean else 1.0
        factors = lean, lean * self.pitch_factor, self.heading_unit.factor if self.heading_unit else lean
        return factors[: len(self.roles.attitude)]

    @property
    def added_duty(self) -> float | None:
        """The firmware's dead band that the mapping states: as given, or as the motion shows it; None if none is."""
        undone = self.drive.undone_dead_band if self.drive else None
        if self.dead_band is not None or undone is None or self.drive is None or undone.value == 0.0:
            return self.dead_band
        return float(f"{undone.value * self.drive.duty_of_size:.2g}")

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
        counted as less dry friction, or, where that matters and the motion shows one, the expected one is undone.

    Raises
    ------
    InputError
        If the file is no table, or neither its names nor its numbers show the time and the wheels' angles.
    """
    found = recognise(path, read_foreign_table(path, names=columns), robot)
    table, roles, time = found.table, found.roles, found.time
    first, last = found.rows
    whole = (first, last) == (0, len(table.columns[roles.time or ""]))
    cut = taken_rows(table, roles, time, (first, last), unordered=found.unordered)
    raw = Raw.of(cut, roles, time)
    units, measured, heading = settled_units(raw, AssumedUnits.assumed(raw, roles, robot), robot)
    stuck = stuck_in(raw, units, measured)
    if stuck:  # what they say meanwhile is wrong
        units, measured, heading = settled_units(raw, units, robot, stuck)
    signals, tested = measured.signals, measured.lean_test
    frame = frame_of(robot, tested, heading, measured.gyro)
    usable = tested.balancing if tested else signals.usable
    # by then all wheels count the same way round
    commands = _test_commands(signals, measured.angles * np.asarray(frame.signs), measured.sampled, usable)
    lean, late = _delays(raw, measured, usable, commands)
    proposal = Proposal(
        table=table,
        roles=roles,
        by_data=found.by_data,
        rows=None if whole else (first + 1, last),
        unordered=found.unordered,
        time=time,
        wheel=units.wheel,
        largest_speed=measured.largest_speed,
        lean=units.lean,
        pitch_factor=raw.pitch_factor,
        heading_unit=units.heading,
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
    drive = _drive(proposal, cut, raw.commands, robot)
    interval, sample_time = float(np.median(np.diff(raw.t))), robot.sensors.sample_time
    missed = missed_between_rows(signals, usable, drive.braked, interval=interval, sample_time=sample_time)
    return replace(proposal, drive=drive, missed=missed)


def _drive(proposal: Proposal, cut: Columns, commands: NDArray[np.float64], robot: Robot) -> DriveEvidence:
    """Return what the commands (M, n) of a proposal, of whose rows `cut` is the file, are."""
    roles, frame = proposal.roles, proposal.frame
    reading = roles.reading(roles.commands)
    mapping = log_mapping(proposal, delay=proposal.command_delay.applied)
    expected = [
        (frame.order.index(wheel), frame.signs[wheel - 1]) for wheel in range(1, len(frame.order) + 1)
    ]
    # a hole in one column does not keep the commands' effect from showing
    whole_table = {name: values if name == roles.time else filled(values) for name, values in cut.items()}
    return drive_evidence(
        mapping,
        whole_table,
        commands,
        robot,
        reading=reading,
        expected=expected,
        full_duties=None if roles.zero is None else roles.zero.full_scales,
    )


def taken_rows(
    table: ForeignTable, roles: Roles, time: Scale, rows: tuple[int, int | None], *, unordered: bool
) -> Columns:
    """Return a file's columns with the rows to take, of first and end: once each, and in order if some are not."""
    name = roles.time or ""
    cut = {column: values[slice(*rows)] for column, values in table.columns.items()}
    return rows_in_order(cut, time.factor * cut[name], repeated=repeated_rows(cut, name), unordered=unordered)


def _delays(
    raw: Raw, measured: Measured, usable: NDArray[np.bool_], commands: CommandTest | None
) -> tuple[Delay | None, Delay]:
    """Return the delays of lean and commands, with which the latter respond to the former's noise in time."""
    interval, tested = float(np.median(np.diff(raw.t))), measured.lean_test
    early = max(-(_feedback(raw, interval) or 0.0), 0.0)
    late = command_delay(commands, measured.signals, usable, interval=interval, early=early)
    if tested is None:
        return None, late
    lean = lean_delay(
        tested,
        measured.signals,
        measured.gyro,
        interval=interval,
        early=early - late.applied,
        early_error=late.error,
        of_speeds=raw.speeds is not None,
    )
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
    columns, made = {"t": clock}, dict[str, str]()
    for i, wheel in enumerate(frame.order, start=1):
        factor = frame.signs[wheel - 1] * proposal.wheel.factor
        angle, speed = f"wheel{i}", f"wheel{i}_dot"
        measured, other = (speed, angle) if roles.of_speeds else (angle, speed)
        columns[measured] = Source(column=roles.angles[wheel - 1], factor=factor)
        made[other] = measured
    integrals, derivatives = (made, dict[str, str]()) if roles.of_speeds else ({}, made)
    attitude = _attitude(proposal)
    if attitude is not None and not attitude.rates:
        derivatives |= {f"{name}_dot": name for name in ("theta", "phi", "psi")}
    motors = tuple(
        Source(
            column=name,
            offset=0.0 if roles.zero is None else -roles.zero.value,
            delay=delay,
            direction=direction,
        )
        for name, direction in zip_longest(roles.commands, roles.directions)
    )
    return LogMapping(
        layout=proposal.table.layout,
        columns=columns,
        derivatives=derivatives,
        integrals=integrals,
        motors=MotorInput(sources=motors, drive=TorqueInput()),
        attitude=attitude,
        timing=Timing(repair=timing.worth_it, sample_time=proposal.sample_time, keep=proposal.keep),
        wrap=roles.wrap,
        largest_speed=proposal.largest_speed,
    )


def _attitude(proposal: Proposal) -> Attitude | None:
    roles, frame, gyro = proposal.roles, proposal.frame, proposal.gyro
    if proposal.lean is None:
        return None
    delay = proposal.sensor_delay
    sources = tuple(
        Source(column=name, factor=sign * factor, delay=delay)
        for name, sign, factor in zip(
            roles.attitude, frame.axis_signs, proposal.attitude_factors, strict=False
        )
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
