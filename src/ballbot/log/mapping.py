"""Mapping files: how a foreign log becomes one of Ballbot's, in TOML.

An example with everything in it::

    [file]                        # the text table; may be left out for CSV with a header
    separator = "blanks"          # comma (default), semicolon, tab, blanks
    decimal = "comma"             # 0,5 is a half, in quotes beside commas; "point" (default)
    missing = ["NA"]              # marks of a missing value, beside an empty cell and nan
    header_lines = 1              # lines before the first row, the last of them with the names
    names = ["i", "t_now"]        # the columns' names, if the header has none or wrong ones
    damaged_rows = "drop"         # skip rows of another width or with words; "refuse" (default)
    unordered_rows = "drop"       # rows out of order: the longest series of rows in which time increases is kept;
                                  # "refuse" (default)
    rows = [1, 5000]              # first and last row to take, from 1; may be left out

    [time]                        # may be left out
    repair = true                 # estimate from the encoders when each row was sampled (message by message)
    sample_time = 0.01            # [s], rows at even intervals: sensors interpolated, commands averaged
    keep = [[2.0, 57.5]]          # [s], intervals of the file's clock to keep

    [columns]
    t = { from = "t_now", unit = "ms" }
    x = { from = "pos_x", unit = "mm", sign = -1, offset = 0.01, delay = 0.016 }
    y = "pos_y"                   # short for { from = "pos_y" }: Ballbot's unit and sign
    x_dot = { derivative_of = "x" }

    [attitude]                    # instead of theta, phi and psi in [columns]: an IMU's roll, pitch, yaw
    from = ["theta_x", "theta_y", "theta_z"]   # yaw may be left out; four columns are a quaternion w, x, y, z
    unit = "deg"                  # one for all, or a list
    sign = [1, 1, 1]              # one for all, or a list
    turn = 30.0                   # [deg], of the IMU's x axis from the robot's, towards the left
    upside_down = false           # true if the IMU hangs upside down: its roll is then near half a turn
    delay = 0.016
    rates = { from = ["gx", "gy", "gz"], unit = "deg/s" }   # its gyro; may have scale, sign and delay

    [wheels]
    order = [1, 3, 2]             # Ballbot's wheels 1, 2, 3 are the 1st, 3rd and 2nd of each list here
    sign = [1, 1, -1]             # of angle and speed, for the file's wheels in the file's order
    angle = { from = ["enc_1", "enc_2", "enc_3"], unit = "counts", counts_per_turn = 4480 }
    # angle may have wrap = 4096, in the file's numbers: an encoder that begins again after so many is continued
    # angle may have largest_speed = 40.0 [rad/s]: faster steps are encoder resets, across which it continues
    # speed = { from = [..], unit = "rpm" }; without it, the speed is the derivative of the angle
    # and without an angle, that is the integral of the speed

    [input]
    kind = "duty"                 # torque, current, voltage or duty
    from = ["u1", "u2", "u3"]     # in the file's order; [wheels] order applies
    sign = -1                     # one for all, or a list
    scale = 1.0                   # factor that makes the full duty 1 (or converts to A, or N m)
    zero = 0.0                    # number that stands for no command, such as 128 or 1500; one for all, or a list
    # direction = ["d1", "d2", "d3"] if the commands are magnitudes: forward where it is above zero, else backward
    delay = 0.012                 # [s] from the log's time to the motor
    supply_voltage = 11.1         # [V]
    torque_constant = 0.01        # [N m/A], motor side
    back_emf_constant = 0.01      # [V s/rad], motor side
    resistance = 2.0              # [ohm]
    gear_ratio = 70.0
    dead_band = 0.0314            # duty that the firmware adds in the duty's direction; not stated, less dry friction
    duty_limit = 1.0              # the largest duty that reaches the motor; 1 by default

A current needs torque_constant, gear_ratio and, if it is not 1, efficiency.

Each of Ballbot's columns comes from one of the file's, times a factor (unit, scale, sign) plus an offset, or is the
derivative of another of Ballbot's columns or, of a wheel's angle, the integral of its speed, or comes with others from
an IMU's roll, pitch and yaw. The motors' columns become wheel torques [N m].

Symbols: n gear ratio, k_t torque constant [N m/A], k_e back-EMF constant [V s/rad], R winding resistance [ohm], all on
the motor's side; i current [A], V supply voltage [V], d duty (-1..1), w wheel speed seen by the encoder [rad/s].

The steps of the application, in order: scale, continue wheel angles across resets or integrate their speeds, estimate
when the rows were sampled, shift and resample, convert an IMU's angles into Ballbot's, differentiate, compute torques,
keep the intervals of the mapping. Delays are undone: a sensor's value that reached the log `delay` late describes the
time t - delay, and a command logged at t acts at t + delay, held until the next. Rows at the ends for which a delayed
column has no value are cut off. Rows at even intervals get sensors interpolated between the file's rows, and each
command's mean over the time to the next row, so that its impulse is kept. For that, missing cells between known ones
that are near in time (`without_holes`) are filled; rows in longer holes stay without a value.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    PositiveFloat,
)

from ballbot.arrays import rows_between
from ballbot.errors import InputError, suggest
from ballbot.file_formats import take_format
from ballbot.files import LARGEST_SETTINGS, parse_toml, read_text
from ballbot.findings import Finding, Place, note
from ballbot.log.columns import (
    ATTITUDE_NAMES,
    KNOWN_NAMES,
    MAX_WHEELS,
    Columns,
    Floats,
    check_column_names,
    factor_to,
    mark_missing,
    numbered_names,
    torque_names,
    unit_of,
    wheel_angle_names,
)
from ballbot.log.formats.text import OWN_LAYOUT, TextLayout
from ballbot.log.imu_angles import (
    QUATERNION_ANGLES,
    about_body_axes,
    angle_rates_of,
    from_roll_pitch_yaw,
    integral_of,
    less_half_a_turn,
    quaternion_angles,
    yaw_ahead,
)
from ballbot.log.row_order import check_time, increasing_rows, later_runs, rows_with_times
from ballbot.log.signals import new_messages, sampling_times, unwrapped, without_holes, without_resets
from ballbot.log.wrapping import continuous_headings
from ballbot.schema import validate_table

Table = Mapping[str, Floats]  #: a file's columns (M,) by the file's names
Sign = Literal[1, -1]
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class TimeTable:
    """[time]: the times of the log's rows."""

    repair: bool = False
    sample_time: PositiveFloat | None = None
    keep: tuple[tuple[FiniteFloat, FiniteFloat], ...] | None = None


@dataclass(frozen=True, kw_only=True)
class ColumnTable:
    """An entry of [columns]."""

    source: Annotated[str | None, Field(alias="from")] = None
    derivative_of: str | None = None
    unit: str | None = None
    counts_per_turn: PositiveFloat | None = None
    scale: FiniteFloat = 1.0
    sign: Sign = 1
    offset: FiniteFloat = 0.0
    delay: FiniteFloat = 0.0


@dataclass(frozen=True, kw_only=True)
class RatesTable:
    """`rates` of [attitude]: the gyro of the IMU."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=3, max_length=3)]
    unit: str | None = None
    scale: FiniteFloat = 1.0
    sign: Sign | tuple[Sign, ...] = 1
    delay: FiniteFloat = 0.0


@dataclass(frozen=True, kw_only=True)
class AttitudeTable:
    """[attitude]: roll, pitch and yaw of an IMU, or its quaternion w, x, y, z.

    Without a yaw, the heading is the integral of the gyro's rate about z, to first order of the lean, and drifts.
    Without a gyro, too, the log has none, and its theta and phi are those of a heading that stays zero.
    """

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=2, max_length=4)]
    unit: str | tuple[str, ...] | None = None
    sign: Sign | tuple[Sign, ...] = 1
    turn: FiniteFloat = 0.0
    upside_down: bool = False
    delay: FiniteFloat = 0.0
    rates: RatesTable | None = None

    @property
    def quaternion(self) -> tuple[str, ...]:
        """The file's columns of a quaternion's w, x, y and z; empty if the file has angles."""
        return self.sources if len(self.sources) > len(QUATERNION_ANGLES) else ()

    @property
    def has_heading(self) -> bool:
        """Whether a sensor gives the heading; else the wheels do (`ballbot.log.pose`)."""
        return len(self.sources) > 2 or self.rates is not None


@dataclass(frozen=True, kw_only=True)
class WheelTable:
    """`angle` or `speed` of [wheels]: a column of the file for each wheel; without these it is made of the other."""

    sources: Annotated[tuple[str, ...], Field(alias="from", max_length=MAX_WHEELS)] = ()
    derivative_of: Literal["angle"] | None = None
    integral_of: Literal["speed"] | None = None
    unit: str | None = None
    counts_per_turn: PositiveFloat | None = None
    scale: FiniteFloat = 1.0
    delay: FiniteFloat = 0.0
    wrap: PositiveFloat | None = None
    largest_speed: PositiveFloat | None = None


@dataclass(frozen=True, kw_only=True)
class WheelsTable:
    """[wheels]."""

    order: tuple[int, ...] | None = None
    sign: Sign | tuple[Sign, ...] = 1
    angle: WheelTable = WheelTable()
    speed: WheelTable = WheelTable()


@dataclass(frozen=True, kw_only=True)
class MotorsTable:
    """The keys of every kind of [input]; each kind has `torque`, u [N m] of the file's scaled numbers."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=1, max_length=MAX_WHEELS)]
    sign: Sign | tuple[Sign, ...] = 1
    scale: FiniteFloat = 1.0
    zero: FiniteFloat | tuple[FiniteFloat, ...] = 0.0
    direction: tuple[str, ...] = ()
    delay: FiniteFloat = 0.0


@dataclass(frozen=True, kw_only=True)
class TorqueTable(MotorsTable):
    """[input] of kind torque [N m at the wheel]."""

    kind: Literal["torque"]
    unit: str | None = None

    def torque(self, value: Floats, _wheel_speed: Floats) -> Floats:
        """Return u [N m] = the value itself."""
        return value


@dataclass(frozen=True, kw_only=True)
class CurrentTable(MotorsTable):
    """[input] of kind current [A]."""

    kind: Literal["current"]
    torque_constant: PositiveFloat
    gear_ratio: PositiveFloat
    efficiency: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0

    def torque(self, value: Floats, _wheel_speed: Floats) -> Floats:
        """Return u [N m] = n k_t efficiency i."""
        return self.gear_ratio * self.torque_constant * self.efficiency * value


@dataclass(frozen=True, kw_only=True)
class DutyTable(MotorsTable):
    """[input] of kind duty [-1..1], pwm by its older name, or voltage [V], which is a duty of the supply's.

    The motor is brushed or field-oriented and on a stiff supply; inductance is neglected. Without a dead band the log
    is read as if there were none, and dry friction identified from it is less by this duty's torque.
    """

    kind: Literal["voltage", "duty", "pwm"]
    supply_voltage: PositiveFloat
    torque_constant: PositiveFloat
    back_emf_constant: PositiveFloat
    resistance: PositiveFloat
    gear_ratio: PositiveFloat
    dead_band: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    duty_limit: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0

    @property
    def back_emf(self) -> float:
        """Damping n^2 k_t k_e / R by the back-EMF [N m s/rad], at the wheel."""
        return self.gear_ratio**2 * self.torque_constant * self.back_emf_constant / self.resistance

    def acting(self, value: Floats) -> Floats:
        """Return the duty at the motor: d + dead_band sgn(d), within the limit."""
        added = (self.dead_band or 0.0) * np.sign(value)
        return np.clip(value + added, -self.duty_limit, self.duty_limit)

    def torque(self, value: Floats, wheel_speed: Floats) -> Floats:
        """Return u [N m] = n k_t (d V - k_e n w) / R of the duty d at the motor."""
        back_emf = self.back_emf_constant * self.gear_ratio * wheel_speed
        current = (value * self.supply_voltage - back_emf) / self.resistance
        return self.gear_ratio * self.torque_constant * current


InputTable = TorqueTable | CurrentTable | DutyTable


def _column_table(value: object) -> object:
    return {"from": value} if isinstance(value, str) else value


@dataclass(frozen=True, kw_only=True)
class Source:
    """A column of the file: value = factor * cell + offset, in Ballbot's unit."""

    column: str  #: its name in the file
    factor: float = 1.0  #: unit, scale and sign in one
    offset: float = 0.0  #: in Ballbot's unit
    delay: float = 0.0  #: [s]
    direction: str | None = None  #: of a motor's magnitude, the column with its direction


#: in `LogMapping.sources`, an IMU's roll, pitch and yaw, and its angular velocity about its own axes
IMU_NAMES = ("roll", "pitch", "yaw", "imu_rate_x", "imu_rate_y", "imu_rate_z")


@dataclass(frozen=True, kw_only=True)
class LogMapping:
    """How a foreign file becomes a log: the tables of a mapping file, and each of its columns by what it becomes."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # also of the tables in it

    complete: bool = True
    file: TextLayout = OWN_LAYOUT  #: how the file is read if it is a text
    time: TimeTable = TimeTable()
    columns: dict[str, Annotated[ColumnTable, BeforeValidator(_column_table)]]
    attitude: AttitudeTable | None = None
    wheels: WheelsTable = WheelsTable()
    input: Annotated[InputTable, Field(discriminator="kind")] | None = None

    @cached_property
    def sources(self) -> dict[str, Source]:
        """The file's columns by Ballbot's names, t, `IMU_NAMES`, and u1, u2, .. of the commands among them."""
        angle, speed = self.wheels.angle, self.wheels.speed
        found = {name: _source(name, one) for name, one in self.columns.items() if not one.derivative_of}
        for suffix, entry in (("", angle), ("_dot", speed)):
            found |= _wheel_sources(suffix, entry, self.wheels) if entry.sources else {}
        if self.attitude is not None:
            found |= _imu_sources(self.attitude)
        return found if self.input is None else found | _motor_sources(self.input, self.wheels)

    @cached_property
    def derivatives(self) -> dict[str, str]:
        """By Ballbot's name, which of its columns to differentiate."""
        found = {name: one.derivative_of for name, one in self.columns.items() if one.derivative_of}
        given = {*self.sources, *found}
        return found | {f"{name}_dot": name for name in self._wheel_names if f"{name}_dot" not in given}

    @cached_property
    def integrals(self) -> dict[str, str]:
        """By wheel angle, the speed to integrate."""
        return {name: f"{name}_dot" for name in self._wheel_names if name not in self.sources}

    @property
    def _wheel_names(self) -> tuple[str, ...]:
        return wheel_angle_names(len(self.wheels.angle.sources or self.wheels.speed.sources))

    @property
    def used_columns(self) -> set[str] | None:
        """The file's columns that it takes; None if rows with words in any column are left out."""
        if self.file.damaged_rows == "drop":
            return None
        named = {name for one in self.sources.values() for name in (one.column, one.direction) if name}
        return named | set(self.attitude.quaternion if self.attitude else ())

    @property
    def commands(self) -> tuple[str, ...]:
        """u1, u2, .. of the commands that it takes."""
        return torque_names(len(self.input.sources)) if self.input else ()

    @property
    def sensor_delay(self) -> float:
        """The largest delay of the sensors [s]."""
        return max(one.delay for name, one in self.sources.items() if name not in self.commands)


def read_mapping(path: str | Path | LogMapping) -> LogMapping:
    """Read a mapping file, or return a mapping itself; InputError names a key that is wrong and its allowed values."""
    if isinstance(path, LogMapping):
        return path
    if not isinstance(path, str | Path):
        raise InputError(
            f"A mapping is given as an object of type {type(path).__name__}; give the path of a mapping file."
        )
    return parse_mapping(read_text(path, largest=LARGEST_SETTINGS), source=str(path))


def parse_mapping(text: str, *, source: str) -> LogMapping:
    """Return the mapping that the text of a mapping file describes; errors, as of `read_mapping`, name its `source`."""
    tree = parse_toml(text, source=source)
    try:
        mapping = validate_table(LogMapping, take_format(tree, "mapping"), of="a mapping file")
        _check(mapping)
    except InputError as error:
        raise InputError(f"{source}: {error}{'' if str(error).endswith(('.', '?')) else '.'}") from None
    return mapping


def dead_band_findings(mappings: Iterable[str | Path | None]) -> tuple[Finding, ...]:
    """Return a warning for each mapping file of duties that does not state the firmware's dead band."""
    found = []
    for mapping in filter(None, mappings):
        drive = read_mapping(mapping).input
        if isinstance(drive, DutyTable) and drive.dead_band is None:
            sentence = (
                "The commands are duties, and no dead band is stated: friction identified from this log is less by the "
                "duty that the firmware adds, and holds for logs that are read the same way. For the wheels' own "
                "friction state dead_band in [input], 0 if the firmware adds none."
            )
            place = Place(file=str(mapping))
            found.append(Finding(code="dead-band", severity="warning", text=sentence, where=place))
    return tuple(found)


def _check(mapping: LogMapping) -> None:
    """Raise InputError if a mapping is not complete, or entries contradict each other."""
    file, angle, speed = mapping.file, mapping.wheels.angle, mapping.wheels.speed
    if not mapping.complete:
        raise InputError(
            'the mapping is not complete; fill in the lines with "cannot determine", then remove complete = false'
        )
    if file.header_lines == 0 and file.names is None:
        raise InputError("[file] has header_lines = 0 and therefore needs names = [..] of the columns")
    if file.names is not None and len(set(file.names)) < len(file.names):
        raise InputError("[file] names contains a name twice")
    check_column_names(file.names or (), source="[file] names")
    for start, end in mapping.time.keep or ():
        if not end > start:
            raise InputError(f"[time] keep has [{start:g}, {end:g}]; write the earlier time first")
    for name, entry, other in (("angle", angle, speed), ("speed", speed, angle)):
        made = WheelTable(derivative_of=entry.derivative_of, integral_of=entry.integral_of)
        if not entry.sources and entry != (made if other.sources else WheelTable()):
            raise InputError(f"[wheels] {name} needs from = [..], the columns of the file")
    if speed.wrap or speed.largest_speed:
        raise InputError("[wheels] speed cannot have wrap or largest_speed, which are of angles")
    for name, entry in mapping.columns.items():
        if name not in KNOWN_NAMES:
            hint = suggest(name, KNOWN_NAMES, otherwise="the names are")
            raise InputError(f"[columns] has {name}, which is not a column of a log; {hint}")
        if entry.derivative_of and entry != ColumnTable(derivative_of=entry.derivative_of):
            raise InputError(f"[columns] {name} has derivative_of, which allows no other key")
    if "t" not in mapping.sources:
        raise InputError('[columns] lacks t, the time: t = { from = "..", unit = "s" }')
    made = {*mapping.sources, *mapping.integrals}
    if mapping.attitude is not None:
        both = [name for name in ATTITUDE_NAMES if name in made]
        if both:
            raise InputError(f"[columns] has {both[0]}, which [attitude] provides; remove one of them")
        made |= {*ATTITUDE_NAMES}
    for name, origin in mapping.derivatives.items():
        if origin not in made:
            raise InputError(f"{name} is the derivative of {origin!r}, which the mapping does not provide")


def _source(name: str, entry: ColumnTable) -> Source:
    if name[0] == "u":
        raise InputError(f"[columns] has {name}; map torques in [input], which names their kind")
    if entry.source is None:
        raise InputError(f'[columns] {name} needs from = "..", a column of the file, or derivative_of = ".."')
    if name == "t" and entry.delay:
        raise InputError("[columns] t cannot have a delay; give the delay to the columns that are delayed")
    unit = _unit_factor(f"[columns] {name}", name, entry.unit, entry.counts_per_turn)
    return Source(
        column=entry.source,
        factor=entry.sign * entry.scale * unit,
        offset=entry.offset,
        delay=entry.delay,
    )


def _unit_factor(where: str, name: str, given: str | None, counts_per_turn: float | None = None) -> float:
    unit = unit_of(name)
    if given is None or unit is None:
        return 1.0
    try:
        return factor_to(unit, given, counts_per_turn=counts_per_turn)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _series(
    names: Sequence[str], columns: Sequence[str], factors: Sequence[float], delay: float
) -> dict[str, Source]:
    triples = zip(names, columns, factors, strict=False)
    return {name: Source(column=column, factor=factor, delay=delay) for name, column, factor in triples}


def _imu_sources(table: AttitudeTable) -> dict[str, Source]:
    if table.quaternion and table.unit is not None:
        raise InputError(
            "[attitude] takes four columns, a quaternion w, x, y, z, which has no unit; remove it"
        )
    angles, rates, where = table.sources, table.rates, "[attitude] rates"
    angles = QUATERNION_ANGLES if table.quaternion else angles
    units = [_unit_factor("[attitude]", "theta", one) for one in _each("[attitude] unit", table.unit, angles)]
    signs = _each("[attitude] sign", table.sign, angles)
    found = _series(IMU_NAMES, angles, [a * b for a, b in zip(signs, units, strict=True)], table.delay)
    if rates is None:
        return found
    factor = rates.scale * _unit_factor(where, "gyro_x", rates.unit)
    factors = [sign * factor for sign in _each(f"{where} sign", rates.sign, rates.sources)]
    return found | _series(IMU_NAMES[3:], rates.sources, factors, rates.delay)


def _wheel_sources(suffix: str, entry: WheelTable, wheels: WheelsTable) -> dict[str, Source]:
    where = "[wheels] speed" if suffix else "[wheels] angle"
    factor = entry.scale * _unit_factor(where, f"wheel1{suffix}", entry.unit, entry.counts_per_turn)
    signs, order = _each("[wheels] sign", wheels.sign, entry.sources), _order(wheels, len(entry.sources))
    names = [f"wheel{i}{suffix}" for i in range(1, len(order) + 1)]
    return _series(names, [entry.sources[k] for k in order], [signs[k] * factor for k in order], entry.delay)


def _motor_sources(table: InputTable, wheels: WheelsTable) -> dict[str, Source]:
    columns, scale = table.sources, table.scale
    if isinstance(table, TorqueTable):
        scale *= _unit_factor("[input]", "u1", table.unit)
    elif isinstance(table, DutyTable) and table.kind == "voltage":
        scale /= table.supply_voltage
    factors = [sign * scale for sign in _each("[input] sign", table.sign, columns)]
    zeros = _each("[input] zero", table.zero, columns)
    directions = _each("[input] direction", table.direction or None, columns)
    return {
        f"u{i}": Source(
            column=columns[k],
            factor=factors[k],
            offset=-zeros[k] * factors[k] if zeros[k] else 0.0,
            delay=table.delay,
            direction=directions[k],
        )
        for i, k in enumerate(_order(wheels, len(columns)), start=1)
    }


def _order(wheels: WheelsTable, count: int) -> list[int]:
    """Return, for Ballbot's wheels in turn, the place (from 0) in the file's lists."""
    order = wheels.order or tuple(range(1, count + 1))
    if sorted(order) != list(range(1, count + 1)):
        raise InputError(f"[wheels] order is {list(order)}; it must have each number from 1 to {count} once")
    return [place - 1 for place in order]


def _each(where: str, given: T | tuple[T, ...], columns: Sequence[str]) -> tuple[T, ...]:
    """Return a value for each of these columns, where one may be given for all."""
    values = given if isinstance(given, tuple) else (given,) * len(columns)
    if len(values) != len(columns):
        raise InputError(f"{where} has {len(values)} values; it needs one for each of {len(columns)} columns")
    return values


_GYRO_NAMES = ("gyro_x", "gyro_y", "gyro_z")
#: [s] by which rounding may move a delayed row past the one it belongs to
_ROUNDING = 1e-9


def apply_mapping(
    mapping: LogMapping,
    table: Table,
    *,
    even_from: float | None = None,
    changes: list[Finding] | None = None,
) -> Columns:
    """Return the log's columns (N,), in Ballbot's names and units, from the file's (M,) by the file's names.

    Rows at even intervals are counted from `even_from` [s], by default the table's first time. `changes` gets a
    finding for each row or column that is omitted or continued. InputError if the file lacks a
    column that the mapping names, its time does not increase, or no row is left.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a scale may turn a cell into an infinity
        columns = _applied(mapping, table, even_from, [] if changes is None else changes)
    return {name: values if name == "t" else mark_missing(values) for name, values in columns.items()}


def _applied(mapping: LogMapping, table: Table, even_from: float | None, changes: list[Finding]) -> Columns:
    notes = list[str]()
    table = taken_rows(mapping, table, notes)
    t = row_times(mapping, table)
    changes += [note("time", sentence) for sentence in notes]
    raw = _raw_columns(mapping, table, t, changes)
    sampled = _sampled(mapping, t, raw)
    even = mapping.time.sample_time
    count = len(raw) + len(mapping.derivatives) + 10
    rows = t if even is None else _even_rows(t, even, t[0] if even_from is None else even_from, columns=count)
    # even rows get values between the file's, and for its missing cells
    shift = even is not None or mapping.time.repair
    columns: Columns = {"t": rows}
    for name, values in raw.items():
        delay = mapping.sources[mapping.integrals.get(name, name)].delay
        if name not in mapping.commands:
            columns[name] = _measured_at(rows, sampled, values, delay, shift=shift)
        elif even is not None:
            columns[name] = _mean_acting(t, rows, values, delay)
        else:  # the last one logged at t - delay or before
            latest = np.searchsorted(t, t - delay + _ROUNDING, side="right") - 1
            columns[name] = values[np.maximum(latest, 0)] if delay else values
    if mapping.attitude is not None:
        columns = _body_angles(mapping.attitude, columns)
    columns = _cut(mapping, columns, t)
    for name, origin in mapping.derivatives.items():
        if origin == "psi" and mapping.attitude is not None and not mapping.attitude.has_heading:
            continue
        if len(columns["t"]) < 2:
            raise InputError(f"The derivative of {origin} needs at least two rows.")
        columns[name] = np.gradient(columns[origin], columns["t"])
    return _kept(_with_torques(mapping, columns), mapping.time.keep)


def _raw_columns(mapping: LogMapping, table: Table, t: Floats, changes: list[Finding]) -> Columns:
    """Return the file's columns in Ballbot's units, with angles continued and duties as they reach the motors."""
    attitude, angle = mapping.attitude, mapping.wheels.angle
    if attitude is not None and attitude.quaternion:
        parts = [
            _scaled(f"the quaternion's {part}", Source(column=column), table)
            for part, column in zip("wxyz", attitude.quaternion, strict=True)
        ]
        table = {**table, **quaternion_angles(np.column_stack(parts))}
    raw = {name: _scaled(name, source, table) for name, source in mapping.sources.items() if name != "t"}
    wheels = _wheel_angles(raw)
    if angle.wrap is not None:
        for name in wheels:
            raw[name] = unwrapped(raw[name], period=abs(mapping.sources[name].factor) * angle.wrap)
    # before its offset, from the file's own ends of a turn
    offsets = {name: mapping.sources[name].offset for name in ("psi", "ref_psi") if name in raw}
    continued, wraps = continuous_headings({name: raw[name] - offsets[name] for name in offsets}, t)
    raw |= {name: heading + offsets[name] for name, heading in continued.items()}
    changes += wraps
    if angle.largest_speed is not None and wheels:
        carried = without_resets(t, np.column_stack([raw[name] for name in wheels]), angle.largest_speed)
        raw |= dict(zip(wheels, carried.T, strict=True))
    for name, origin in mapping.integrals.items():
        speed = without_holes(t, raw[origin])
        raw[name] = integral_of(t, speed) + 0.0 * speed  # missing where the speed is
    if attitude is not None and attitude.upside_down:
        raw["roll"] = less_half_a_turn(raw["roll"], math.pi)
    if "yaw" in raw:
        raw["yaw"] = unwrapped(raw["yaw"])
    if isinstance(mapping.input, DutyTable):
        raw |= {name: mapping.input.acting(raw[name]) for name in mapping.commands}
    return raw


def row_times(mapping: LogMapping, table: Table) -> Floats:
    """Return the times of the file's rows (N,) by the file's own clock [s]; InputError if they do not increase."""
    t = _scaled("t", mapping.sources["t"], table)
    check_time(t)
    return t


def taken_rows(mapping: LogMapping, table: Table, notes: list[str]) -> Columns:
    """Return a file's table with the rows that a mapping takes, see `rows_with_times`.

    InputError if it would mix the rows of two runs.
    """
    source, layout = mapping.sources["t"], mapping.file
    if source.column in table:  # `row_times` reports a time that is missing
        table = rows_with_times(table, source.column, notes)
    if layout.unordered_rows == "refuse":
        return {**table}
    t = _scaled("t", source, table)
    runs = later_runs(t)
    again = runs[t[runs] < t[runs - 1]]
    if again.size and layout.rows is None:
        raise InputError(f"Time starts again at row {again[0] + 1}; split the log, or give [file] rows.")
    kept = increasing_rows(t)
    return {name: values[kept] for name, values in table.items()}


def _even_rows(t: Floats, interval: float, counted_from: float, *, columns: int) -> Floats:
    """Return the times within the table that are whole intervals from `counted_from`; refuse too many."""
    rows_between(float(t[-1] - t[0]), interval, columns=columns, source="By the mapping's t, the file")
    # a part of an interval more at either end, so that a row that rounding moved is kept
    first = math.ceil((t[0] - counted_from) / interval - 1e-6)
    last = math.floor((t[-1] - counted_from) / interval + 1e-6)
    return counted_from + interval * np.arange(first, last + 1)


def _scaled(name: str, source: Source, table: Table) -> Floats:
    for column in (source.column, source.direction):
        if column is not None and column not in table:
            hint = suggest(column, table, otherwise="it has")
            raise InputError(f"The mapping takes {name} from column {column!r}, which does not exist; {hint}")
    values = mark_missing(source.factor * table[source.column] + source.offset)
    if source.direction is None:
        return values
    direction = table[source.direction]
    return values * np.where(np.isnan(direction), np.nan, np.where(direction > 0.0, 1.0, -1.0))


def _wheel_angles(columns: Columns) -> tuple[str, ...]:
    return numbered_names(columns, prefix="wheel") if "wheel1" in columns else ()


def _sampled(mapping: LogMapping, t: Floats, raw: Columns) -> Floats:
    """Return the times (N,) at which the rows' sensors were read [s]."""
    if not mapping.time.repair:
        return t
    names = _wheel_angles(raw)
    if len(names) < 2:
        raise InputError("[time] repair needs the angles of at least two wheels.")
    angles = np.column_stack([without_holes(t, raw[name]) for name in names])
    if not np.isfinite(angles).all():
        raise InputError("[time] repair needs wheel angles without long holes.")
    return sampling_times(t, angles)


def _body_angles(attitude: AttitudeTable, columns: Columns) -> Columns:
    """Return the columns with the robot's angles and rates in place of its IMU's."""
    imu = [columns[name] for name in IMU_NAMES if name in columns]
    columns = {name: values for name, values in columns.items() if name not in IMU_NAMES}
    gyro = imu[-3:] if attitude.rates is not None else []
    angles = np.column_stack([*imu[:2], np.zeros_like(imu[0])])
    if len(imu) - len(gyro) > 2:
        angles[:, 2] = imu[2]
    elif gyro:
        angles[:, 2] = integral_of(columns["t"], gyro[2])
    else:
        angles[:, 2] = yaw_ahead(angles, math.radians(attitude.turn))
    turned = from_roll_pitch_yaw(angles, turn=math.radians(attitude.turn))
    columns |= dict(zip(ATTITUDE_NAMES, turned.T, strict=True))
    if not attitude.has_heading:
        del columns["psi"]
    if not gyro:
        return columns
    body = about_body_axes(np.column_stack(gyro), math.radians(attitude.turn))
    columns |= dict(zip(_GYRO_NAMES, body.T, strict=True))
    rates = angle_rates_of(turned, body)
    return columns | {f"{name}_dot": rate for name, rate in zip(ATTITUDE_NAMES, rates.T, strict=True)}


def _cut(mapping: LogMapping, columns: Columns, t: Floats) -> Columns:
    """Return the rows for which every delayed column has a value in the file, whose times are t."""
    rows, ahead = columns["t"], [0.0]
    ahead += [-one.delay if name in mapping.commands else one.delay for name, one in mapping.sources.items()]
    kept = (rows + min(ahead) >= t[0] - _ROUNDING) & (rows + max(ahead) <= t[-1] + _ROUNDING)
    if not kept.any():
        raise InputError("The delays in the mapping are longer than the log; give delays in seconds.")
    return {name: values[kept] for name, values in columns.items()}


def _with_torques(mapping: LogMapping, columns: Columns) -> Columns:
    found, drive = {**columns}, mapping.input
    for i, name in enumerate(mapping.commands, start=1):
        speed = columns.get(f"wheel{i}_dot")
        if speed is None and isinstance(drive, DutyTable):
            raise InputError("Torque from a duty needs the speed of the wheel: map [wheels] angle or speed.")
        if drive is not None:
            found[name] = drive.torque(columns[name], np.zeros(1) if speed is None else speed)
    return found


def _kept(columns: Columns, spans: tuple[tuple[float, float], ...] | None) -> Columns:
    if spans is None:
        return columns
    t = columns["t"]
    kept = np.any([(t >= start) & (t < end) for start, end in spans], axis=0)
    if not kept.any():
        raise InputError(f"[time] keep selects no row of the file, which runs from {t[0]:g} to {t[-1]:g} s.")
    return {name: values[kept] for name, values in columns.items()}


def _measured_at(rows: Floats, sampled: Floats, values: Floats, delay: float, *, shift: bool) -> Floats:
    """Return a sensor's values (N,) reported `delay` after the rows' times, interpolated linearly."""
    if not (shift or delay):
        return values
    first = new_messages(sampled) if shift else slice(None)
    return np.interp(rows + delay, sampled[first], without_holes(sampled[first], values[first]))


def _mean_acting(t: Floats, rows: Floats, values: Floats, delay: float) -> Floats:
    """Return the mean of the command that acts from each row to the next; missing where a part of it is."""
    step = rows[1] - rows[0] if len(rows) > 1 else 1.0
    edges = np.append(rows, rows[-1] + step) - delay
    values = without_holes(t, values, held=True)
    known = np.isfinite(values)

    def mean(acting: Floats) -> Floats:
        impulse = np.concatenate(([0.0], np.cumsum(acting[:-1] * np.diff(t))))
        return np.diff(np.interp(edges, t, impulse)) / step

    means = mean(np.where(known, values, 0.0))
    return means if known.all() else np.where(mean((~known).astype(float)) > 1e-9, np.nan, means)
