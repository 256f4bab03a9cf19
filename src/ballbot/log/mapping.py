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
    sequence = "ZYX"              # roll and pitch turn with the heading (default); "XYZ": they are tilts that do not
    turn = 30.0                   # [deg], of the IMU's x axis from the robot's, towards the left
    upside_down = false           # true if the IMU hangs upside down: its roll is then near half a turn
    delay = 0.016
    rates = { from = ["gx", "gy", "gz"], unit = "deg/s" }   # its gyro; may have scale, sign, delay

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
    gear_ratio = 70.0
    dead_band = 0.0314            # duty that the firmware adds in the duty's direction; not stated, less dry friction
    duty_limit = 1.0              # the largest duty that reaches the motor; 1 by default

The resistance of the motors, which a duty or a voltage needs, is the robot file's. A current needs torque_constant,
gear_ratio and, if it is not 1, efficiency.

A column of the log is a column of the file times a factor (unit, scale, sign) plus an offset, the derivative of another
column of the log, the integral of a wheel's speed, or a part of an IMU's attitude. The motors' columns become wheel
torques [N m].

Symbols: n gear ratio, k_t torque constant [N m/A], k_e back-EMF constant [V s/rad], R winding resistance [ohm], all on
the motor's side; i current [A], V supply voltage [V], d duty (-1..1), w wheel speed seen by the encoder [rad/s].

The steps of `apply_mapping`, in order: clear failed readings (`without_dropouts`), scale, continue wheel angles across
resets or integrate their speeds, estimate when the rows were sampled, shift and resample, convert an IMU's angles,
differentiate, compute torques, keep intervals. Delays are removed: a sensor's value that reached the log `delay` late
describes the time t - delay, and a command logged at t acts at t + delay and is held until the next. Rows for which a
delayed column has no value are cut off. At even intervals, sensors are interpolated between the file's rows, and a
command is its mean over the time to the next row, so that its impulse is kept; short holes (`without_holes`) are
filled, rows in longer ones have no value.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field, FiniteFloat, PositiveFloat

from ballbot.arrays import Floats, rows_between
from ballbot.errors import InputError, about, check_known, suggest
from ballbot.file_formats import take_format
from ballbot.files import LARGEST_SETTINGS, parse_toml, read_text
from ballbot.findings import Finding, note, warning
from ballbot.log.columns import (
    ATTITUDE_NAMES,
    KNOWN_NAMES,
    MAX_WHEELS,
    MOCAP_NAMES,
    Columns,
    check_column_names,
    factor_to,
    mark_missing,
    numbered_names,
    torque_names,
    unit_of,
    wheel_angle_names,
    wheel_speed_names,
)
from ballbot.log.formats.text import OWN_LAYOUT, TextLayout
from ballbot.log.imu_angles import (
    QUATERNION_ANGLES,
    AngleSequence,
    body_motion,
    integral_of,
    quaternion_angles,
    within_half_a_turn,
)
from ballbot.log.row_order import check_time, increasing_rows, later_runs, rows_with_times, without_dropouts
from ballbot.log.signals import new_messages, sampling_times, unwrapped, without_holes, without_resets
from ballbot.log.wrapping import TURNED, continuous_headings
from ballbot.robot import RobotLike, as_robot
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
class SeriesTable:
    """Columns of one kind: the axes of an IMU, the wheels, the motors."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=1, max_length=MAX_WHEELS)]
    scale: FiniteFloat = 1.0
    delay: FiniteFloat = 0.0


@dataclass(frozen=True, kw_only=True)
class RatesTable(SeriesTable):
    """`rates` of [attitude]: the gyro of the IMU."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=3, max_length=3)]
    unit: str | None = None
    sign: Sign | tuple[Sign, ...] = 1


@dataclass(frozen=True, kw_only=True)
class AttitudeTable(SeriesTable):
    """[attitude]: roll, pitch and yaw of an IMU, or its quaternion w, x, y, z.

    Without a yaw, the heading is the integral of the gyro's rate about z, to first order of the lean, and drifts.
    Without a yaw and a gyro the log has no heading, and theta and phi are those of a heading that stays zero.
    """

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=2, max_length=4)]
    unit: str | tuple[str, ...] | None = None
    sign: Sign | tuple[Sign, ...] = 1
    sequence: AngleSequence = "ZYX"
    turn: FiniteFloat = 0.0
    upside_down: bool = False
    rates: RatesTable | None = None

    @property
    def quaternion(self) -> tuple[str, ...]:
        """The file's columns of a quaternion's w, x, y and z; empty if the file has angles."""
        return self.sources if len(self.sources) > len(QUATERNION_ANGLES) else ()


@dataclass(frozen=True, kw_only=True)
class WheelTable(SeriesTable):
    """`angle` or `speed` of [wheels]: a column of the file for each wheel; without any it follows from the other."""

    sources: Annotated[tuple[str, ...], Field(alias="from", max_length=MAX_WHEELS)] = ()
    derivative_of: Literal["angle"] | None = None
    integral_of: Literal["speed"] | None = None
    unit: str | None = None
    counts_per_turn: PositiveFloat | None = None
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
class MotorsTable(SeriesTable):
    """The keys of every kind of [input]; `torque` of each kind converts the file's scaled numbers to u [N m]."""

    sign: Sign | tuple[Sign, ...] = 1
    zero: FiniteFloat | tuple[FiniteFloat, ...] = 0.0
    direction: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class TorqueTable(MotorsTable):
    """[input] of kind torque [N m at the wheel]."""

    kind: Literal["torque"]
    unit: str | None = None

    def torque(self, value: Floats, _wheel_speed: Floats, _resistance: float) -> Floats:
        """Return u [N m] = the value itself."""
        return value


@dataclass(frozen=True, kw_only=True)
class CurrentTable(MotorsTable):
    """[input] of kind current [A]."""

    kind: Literal["current"]
    torque_constant: PositiveFloat
    gear_ratio: PositiveFloat
    efficiency: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0

    def torque(self, value: Floats, _wheel_speed: Floats, _resistance: float) -> Floats:
        """Return u [N m] = n k_t efficiency i."""
        return self.gear_ratio * self.torque_constant * self.efficiency * value


@dataclass(frozen=True, kw_only=True)
class DutyTable(MotorsTable):
    """[input] of kind duty [-1..1], formerly called pwm, or voltage [V], which is divided by the supply's.

    The motor is brushed or field-oriented and on a stiff supply; inductance is neglected. If the firmware adds a dead
    band that is not stated, dry friction identified from the log is too small by its torque.
    """

    kind: Literal["voltage", "duty", "pwm"]
    supply_voltage: PositiveFloat
    torque_constant: PositiveFloat
    back_emf_constant: PositiveFloat
    gear_ratio: PositiveFloat
    dead_band: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    duty_limit: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0

    def back_emf(self, resistance: float) -> float:
        """Return the damping n^2 k_t k_e / R by the back-EMF [N m s/rad], at the wheel."""
        return self.gear_ratio**2 * self.torque_constant * self.back_emf_constant / resistance

    def acting(self, value: Floats) -> Floats:
        """Return the duty at the motor: d + dead_band sgn(d), within the limit."""
        added = (self.dead_band or 0.0) * np.sign(value)
        return np.clip(value + added, -self.duty_limit, self.duty_limit)

    def torque(self, value: Floats, wheel_speed: Floats, resistance: float) -> Floats:
        """Return u [N m] = n k_t (d V - k_e n w) / R of the duty d at the motor."""
        back_emf = self.back_emf_constant * self.gear_ratio * wheel_speed
        current = (value * self.supply_voltage - back_emf) / resistance
        return self.gear_ratio * self.torque_constant * current


InputTable = TorqueTable | CurrentTable | DutyTable
#: x = "pos_x" is short for x = { from = "pos_x" }
_SHORT = BeforeValidator(lambda value: {"from": value} if isinstance(value, str) else value)


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
    """The tables of a mapping file, and the source of each of the log's columns."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # also of the tables in it

    complete: bool = True
    file: TextLayout = OWN_LAYOUT  #: how the file is read if it is a text
    time: TimeTable = TimeTable()
    columns: dict[str, Annotated[ColumnTable, _SHORT]]
    attitude: AttitudeTable | None = None
    wheels: WheelsTable = WheelsTable()
    input: Annotated[InputTable, Field(discriminator="kind")] | None = None

    @cached_property
    def sources(self) -> dict[str, Source]:
        """The file's columns by Ballbot's names, t, `IMU_NAMES`, and u1, u2, .. of the commands among them."""
        imu, wheels, drive = self.attitude, self.wheels, self.input
        sources = {}
        for name, entry in self.columns.items():
            if entry.source is not None:
                with about(f"[columns] {name}"):
                    unit = factor_to(unit_of(name), entry.unit, counts_per_turn=entry.counts_per_turn)
                factor, offset = entry.sign * entry.scale * unit, entry.offset
                sources[name] = Source(column=entry.source, factor=factor, offset=offset, delay=entry.delay)
        for key, of, kind in (("angle", wheel_angle_names, "rad"), ("speed", wheel_speed_names, "rad/s")):
            series: WheelTable = getattr(wheels, key)
            names, unit = of(len(series.sources)), (kind, series.unit, series.counts_per_turn)
            sources |= _series(f"[wheels] {key}", names, series, wheels.sign, unit, order=wheels.order)
        if imu is not None:
            angles = replace(imu, sources=QUATERNION_ANGLES) if imu.quaternion else imu
            sources |= _series("[attitude]", IMU_NAMES, angles, imu.sign, ("rad", imu.unit, None))
            if (gyro := imu.rates) is not None:
                unit = ("rad/s", gyro.unit, None)
                sources |= _series("[attitude] rates", IMU_NAMES[3:], gyro, gyro.sign, unit)
        if drive is not None:
            unit = ("N m", drive.unit if isinstance(drive, TorqueTable) else None, None)
            if isinstance(drive, DutyTable) and drive.kind == "voltage":
                drive = replace(drive, scale=drive.scale / drive.supply_voltage)
            sources |= _series("[input]", self.commands, drive, drive.sign, unit, order=wheels.order)
        return sources

    @cached_property
    def derivatives(self) -> dict[str, str]:
        """By Ballbot's name, which of its columns to differentiate."""
        derived = {name: entry.derivative_of for name, entry in self.columns.items() if entry.derivative_of}
        given = {*self.sources, *derived}
        return derived | {f"{name}_dot": name for name in self._wheel_names if f"{name}_dot" not in given}

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
        columns = {column for source in self.sources.values() for column in (source.column, source.direction)}
        return {*filter(None, columns), *(self.attitude.quaternion if self.attitude else ())}

    @property
    def commands(self) -> tuple[str, ...]:
        """u1, u2, .. of the commands that it takes."""
        return torque_names(len(self.input.sources)) if self.input else ()


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
        check_column_names(mapping.file.names or (), source="[file] names")
        for sentence in _contradictions(mapping):
            raise InputError(sentence)
    except InputError as error:
        raise InputError(f"{source}: {error}{'' if str(error).endswith(('.', '?')) else '.'}") from None
    return mapping


#: finding on a mapping of duties without a dead band
_NO_DEAD_BAND = (
    "The commands are duties, and no dead band is stated: friction identified from this log is less by the duty that "
    "the firmware adds, and holds for logs that are read the same way. For the wheels' own friction state dead_band in "
    "[input] of the mapping, 0 if the firmware adds none."
)


def _contradictions(mapping: LogMapping) -> Iterator[str]:
    """Yield the missing entries of a mapping, and those that contradict each other."""
    file, angle, speed, imu = mapping.file, mapping.wheels.angle, mapping.wheels.speed, mapping.attitude
    if not mapping.complete:
        yield 'the mapping is not complete; fill in the lines with "cannot determine", then remove complete = false'
    if file.header_lines == 0 and file.names is None:
        yield "[file] has header_lines = 0 and therefore needs names = [..] of the columns"
    if file.names is not None and len(set(file.names)) < len(file.names):
        yield "[file] names contains a name twice"
    for start, end in mapping.time.keep or ():
        if not end > start:
            yield f"[time] keep has [{start:g}, {end:g}]; write the earlier time first"
    for key, entry, other in (("angle", angle, speed), ("speed", speed, angle)):
        made = WheelTable(derivative_of=entry.derivative_of, integral_of=entry.integral_of)
        if not entry.sources and entry != (made if other.sources else WheelTable()):
            yield f"[wheels] {key} needs from = [..], the columns of the file"
    if speed.wrap or speed.largest_speed:
        yield "[wheels] speed cannot have wrap or largest_speed, which are of angles"
    for name, entry in mapping.columns.items():
        if name not in (*KNOWN_NAMES, *MOCAP_NAMES):
            hint = suggest(name, KNOWN_NAMES, otherwise="the names are")
            yield f"[columns] has {name}, which is not a column of a log; {hint}"
        if entry.derivative_of and entry != ColumnTable(derivative_of=entry.derivative_of):
            yield f"[columns] {name} has derivative_of, which allows no other key"
        if name[0] == "u":
            yield f"[columns] has {name}; map torques in [input], which names their kind"
        if not entry.derivative_of and entry.source is None:
            yield f'[columns] {name} needs from = "..", a column of the file, or derivative_of = ".."'
        if name == "t" and entry.delay:
            yield "[columns] t cannot have a delay; give the delay to the columns that are delayed"
    if imu is not None and imu.quaternion and (imu.unit is not None or imu.scale != 1.0):
        yield "[attitude] takes four columns, a quaternion w, x, y, z, which has no unit and no scale; remove it"
    if imu is not None and imu.sequence == "XYZ" and (len(imu.sources) != 3 or imu.upside_down):
        yield '[attitude] sequence = "XYZ" needs roll, pitch and yaw of an IMU that hangs upright'
    if "t" not in mapping.sources:
        yield '[columns] lacks t, the time: t = { from = "..", unit = "s" }'
    made = {*mapping.sources, *mapping.integrals}
    for name in ATTITUDE_NAMES if imu is not None else ():
        if name in made:
            yield f"[columns] has {name}, which [attitude] provides; remove one of them"
        made.add(name)
    for name, origin in mapping.derivatives.items():
        if origin not in made:
            yield f"{name} is the derivative of {origin!r}, which the mapping does not provide"


#: Ballbot's unit, the file's, which may be one for each column, and an encoder's counts in one turn
_Unit = tuple[str, str | tuple[str, ...] | None, float | None]


def _series(
    where: str,
    names: Sequence[str],
    table: SeriesTable,
    sign: Sign | tuple[Sign, ...],
    unit: _Unit,
    *,
    order: tuple[int, ...] | None = None,
) -> dict[str, Source]:
    """Return a table's columns by Ballbot's names, whose `order` counts the file's from 1."""
    count = len(table.sources)
    order = (order if count else None) or tuple(range(1, count + 1))
    if sorted(order) != list(range(1, count + 1)):
        raise InputError(f"[wheels] order is {list(order)}; it must have each number from 1 to {count} once")

    def each(key: str, given: T | tuple[T, ...]) -> tuple[T, ...]:
        values = given if isinstance(given, tuple) else (given,) * count
        if count and len(values) != count:
            raise InputError(
                f"{where}: {key} has {len(values)} values; it needs one for each of {count} columns"
            )
        return values

    zero, direction = (table.zero, table.direction or None) if isinstance(table, MotorsTable) else (0.0, None)
    units, signs, zeros = each("unit", unit[1]), each("sign", sign), each("zero", zero)
    directions, sources = each("direction", direction), {}
    for name, number in zip(names, order, strict=False):
        k = number - 1
        with about(where):
            factor = signs[k] * table.scale * factor_to(unit[0], units[k], counts_per_turn=unit[2])
        source = Source(column=table.sources[k], factor=factor, offset=-zeros[k] * factor, delay=table.delay)
        sources[name] = replace(source, direction=directions[k])
    return sources


#: [s] by which rounding may move a delayed row past the one it belongs to
_ROUNDING = 1e-9


@np.errstate(over="ignore", invalid="ignore")  # a scale may turn a cell into an infinity
def apply_mapping(
    mapping: LogMapping,
    table: Table,
    *,
    robot: RobotLike | None = None,
    changes: list[Finding] | None = None,
) -> Columns:
    """Return the log's columns (N,), in Ballbot's names and units, from the file's (M,) by the file's names.

    `changes` gets a finding for each row or column that is omitted or continued, and on a dead band that is not stated.
    InputError if the file lacks a column that the mapping names, its time does not increase, no row is left, or torques
    come from duties without the `robot` that has the motors' resistance.
    """
    resistance = motor_resistance(mapping, robot)
    changes, notes = [] if changes is None else changes, list[str]()
    if isinstance(mapping.input, DutyTable) and mapping.input.dead_band is None:
        changes.append(warning("dead-band", _NO_DEAD_BAND, *mapping.commands))
    table, t = timed_rows(mapping, table, notes)
    changes += [note("time", sentence) for sentence in notes]
    # zero may be a command, a force, or a speed by counts
    others = ("t", "ref_x", "ref_y", "ref_psi", *mapping.commands)
    sensors = [
        source.column
        for name, source in mapping.sources.items()
        if name not in others and not name.endswith("_dot") and unit_of(name) not in ("N", "N m")
    ]
    table, lost = without_dropouts(table, sensors)
    changes += lost
    columns = _resampled(mapping, t, _raw_columns(mapping, table, t, changes))
    imu, drive = mapping.attitude, mapping.input
    if imu is not None:
        motion = [columns.pop(name) for name in IMU_NAMES if name in columns]
        angles, gyro = (motion[:-3], np.column_stack(motion[-3:])) if imu.rates else (motion, None)
        columns |= body_motion(columns["t"], angles, gyro, math.radians(imu.turn), imu.sequence)
        if len(imu.sources) < 3 and imu.rates is None:  # the wheels give the heading (`ballbot.log.pose`)
            del columns["psi"]
    # rows for which every delayed column has a value in the file
    ahead = [source.delay * (-1 if n in mapping.commands else 1) for n, source in mapping.sources.items()]
    rows = columns["t"]
    kept = (rows + min(ahead) >= t[0] - _ROUNDING) & (rows + max(ahead) <= t[-1] + _ROUNDING)
    if not kept.any():
        raise InputError("The delays in the mapping are longer than the log; give delays in seconds.")
    columns = {name: values[kept] for name, values in columns.items()}
    for name, origin in mapping.derivatives.items():
        if origin in columns:
            if len(columns["t"]) < 2:
                raise InputError(f"The derivative of {origin} needs at least two rows.")
            columns[name] = np.gradient(columns[origin], columns["t"])
    for i, name in enumerate(mapping.commands, start=1):
        speed = columns.get(f"wheel{i}_dot")
        if speed is None and isinstance(drive, DutyTable):
            raise InputError("Torque from a duty needs the speed of the wheel: map [wheels] angle or speed.")
        if drive is not None:
            columns[name] = drive.torque(columns[name], np.zeros(1) if speed is None else speed, resistance)
    t, spans = columns["t"], mapping.time.keep or ((-np.inf, np.inf),)
    kept = np.any([(t >= start) & (t < end) for start, end in spans], axis=0)
    if not kept.any():
        raise InputError(f"[time] keep selects no row of the file, which runs from {t[0]:g} to {t[-1]:g} s.")
    times = columns.pop("t")[kept]
    return {"t": times, **{name: mark_missing(values[kept]) for name, values in columns.items()}}


def motor_resistance(mapping: LogMapping, robot: RobotLike | None) -> float:
    """Return R [ohm] of a robot's motors if a mapping's duties need it, else inf; InputError if it is not known."""
    if not isinstance(mapping.input, DutyTable):
        return math.inf
    if robot is None:
        raise InputError(
            f"Torques from a {mapping.input.kind} need the robot with its motors: give --robot or robot=."
        )
    return as_robot(robot).drive.known_resistance(f"A mapping of a {mapping.input.kind}")


def timed_rows(mapping: LogMapping, table: Table, notes: list[str]) -> tuple[Columns, Floats]:
    """Return the rows of a file's table that a mapping takes, see `rows_with_times`, and their times (N,) [s].

    InputError if the times do not increase, or rows of two runs would be mixed.
    """
    source, layout = mapping.sources["t"], mapping.file
    if source.column in table:  # `_scaled` reports a time that is missing
        table = rows_with_times(table, source.column, notes)
    t = _scaled("t", source, table)
    if layout.unordered_rows == "drop":
        runs = later_runs(t)
        again = runs[t[runs] < t[runs - 1]]
        if again.size and layout.rows is None:
            raise InputError(f"Time starts again at row {again[0] + 1}; split the log, or give [file] rows.")
        kept = increasing_rows(t)
        table, t = {name: values[kept] for name, values in table.items()}, t[kept]
    check_time(t)
    return {**table}, t


def _raw_columns(mapping: LogMapping, table: Table, t: Floats, changes: list[Finding]) -> Columns:
    """Return the file's columns in Ballbot's units, with angles continued and duties as they reach the motors."""
    attitude, angle = mapping.attitude, mapping.wheels.angle
    if attitude is not None and attitude.quaternion:
        named = zip("wxyz", attitude.quaternion, strict=True)
        parts = [_scaled(f"the quaternion's {part}", Source(column=column), table) for part, column in named]
        table = {**table, **quaternion_angles(np.column_stack(parts))}
    raw = {name: _scaled(name, source, table) for name, source in mapping.sources.items() if name != "t"}
    wheels = numbered_names(raw, prefix="wheel")
    if angle.wrap is not None:
        for name in wheels:
            raw[name] = unwrapped(raw[name], period=abs(mapping.sources[name].factor) * angle.wrap)
    # before its offset, from the file's own ends of a turn
    offsets = {name: mapping.sources[name].offset for name in TURNED if name in raw}
    continued, wraps = continuous_headings({name: raw[name] - offsets[name] for name in offsets}, t)
    raw |= {name: heading + offsets[name] for name, heading in continued.items()}
    changes += wraps
    if angle.largest_speed is not None:
        raw |= {name: without_resets(t, raw[name], angle.largest_speed) for name in wheels}
    for name, origin in mapping.integrals.items():
        raw[name] = integral_of(t, without_holes(t, raw[origin]))
    raw |= {name: within_half_a_turn(raw[name], math.pi) for name in IMU_NAMES[:2] if name in raw}
    if attitude is not None and attitude.upside_down:
        raw["roll"] = within_half_a_turn(raw["roll"] - math.pi, math.pi)
    if "yaw" in raw:
        raw["yaw"] = unwrapped(raw["yaw"])
    if isinstance(mapping.input, DutyTable):
        raw |= {name: mapping.input.acting(raw[name]) for name in mapping.commands}
    return raw


def _resampled(mapping: LogMapping, t: Floats, raw: Columns) -> Columns:
    """Return the columns at the log's rows, those of the file or even ones, without their delays."""
    even, rows, sampled = mapping.time.sample_time, t, t
    if even is not None:
        count = len(raw) + len(mapping.derivatives) + 10
        rows_between(float(t[-1] - t[0]), even, columns=count, source="By the mapping's t, the file")
        # a part of an interval more, so that a row that rounding moved is kept
        rows = t[0] + even * np.arange(math.floor((t[-1] - t[0]) / even + 1e-6) + 1)
    if mapping.time.repair:
        names = numbered_names(raw, prefix="wheel")
        if len(names) < 2:
            raise InputError("[time] repair needs the angles of at least two wheels.")
        angles = np.column_stack([without_holes(t, raw[name]) for name in names])
        known = np.flatnonzero(np.isfinite(angles).all(axis=1))  # the first and last rows may lack a value
        if not known.size or len(known) <= np.ptp(known):
            raise InputError("[time] repair needs wheel angles without long holes.")
        sampled = t.copy()
        sampled[known] = sampling_times(t[known], angles[known])
        sampled = np.maximum.accumulate(sampled)
    interpolated = even is not None or mapping.time.repair
    new = new_messages(sampled) if interpolated else np.ones(len(t), dtype=np.bool_)
    columns: Columns = {"t": rows}
    for name, values in raw.items():
        delay = mapping.sources[mapping.integrals.get(name, name)].delay
        if name in mapping.commands and even is not None:
            columns[name] = _mean_acting(t, rows, values, delay)
        elif name in mapping.commands:  # the last one logged at t - delay or before
            latest = np.searchsorted(t, t - delay + _ROUNDING, side="right") - 1
            columns[name] = values[np.maximum(latest, 0)] if delay else values
        elif interpolated or delay:  # a sensor's value reported `delay` after the row's time
            columns[name] = np.interp(rows + delay, sampled[new], without_holes(sampled[new], values[new]))
        else:
            columns[name] = values
    return columns


def _scaled(name: str, source: Source, table: Table) -> Floats:
    for column in (source.column, source.direction):
        if column is not None:
            sentence = f"The mapping takes {name} from column {column!r}, which does not exist"
            check_known(column, table, sentence, otherwise="it has")
    values = mark_missing(source.factor * table[source.column] + source.offset)
    if source.direction is None:
        return values
    direction = table[source.direction]
    return values * np.where(np.isnan(direction), np.nan, np.where(direction > 0.0, 1.0, -1.0))


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
