"""Mapping files: how a foreign log becomes one of Ballbot's, in TOML.

An example with everything in it::

    [file]                        # the text table; may be left out for CSV with a header
    separator = "blanks"          # comma (default), semicolon, tab, blanks
    decimal = "comma"             # 0,5 is a half; "point" (default)
    missing = ["NA"]              # marks of a missing value, beside an empty cell and nan
    header_lines = 1              # lines before the first row, the last of them with the names
    names = ["i", "t_now"]        # the columns' names, if the header has none or wrong ones
    damaged_rows = "drop"         # skip rows of another width or with words; "refuse" (default)
    repeated_rows = "drop"        # rows that repeat the row before, its time too, are one; "refuse" (default)
    unordered_rows = "drop"       # rows out of order: the longest series of rows in which time increases is kept;
                                  # "refuse" (default)
    rows = [1, 5000]              # first and last row to take, from 1; may be left out

    [time]                        # may be left out
    repair = true                 # estimate from the encoders when each row was sampled (message by message)
    sample_time = 0.01            # [s], rows at even intervals: sensors interpolated, commands averaged
    keep = [[2.0, 57.5]]          # [s], intervals of the file's clock to keep

    [columns]
    t = { from = "t_now", unit = "ms" }   # of two columns: { from = "stamp.sec", nanoseconds = "stamp.nanosec" }
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
    speed = { derivative_of = "angle" }   # or { from = [..], unit = "rpm" }
    # angle may be { integral_of = "speed" }, if the file has speeds alone

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
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)

from ballbot.errors import InputError, suggest
from ballbot.file_formats import take_format
from ballbot.files import LARGEST_SETTINGS, parse_toml, read_text
from ballbot.findings import Finding, Place
from ballbot.log.columns import KNOWN_NAMES, MAX_WHEELS, check_column_names, factor_to, unit_of
from ballbot.log.formats.text import TextLayout
from ballbot.log.imu_angles import QUATERNION_ANGLES
from ballbot.log.mapping import (
    Attitude,
    CurrentInput,
    DutyInput,
    LogMapping,
    MotorInput,
    Source,
    Timing,
    TorqueInput,
)
from ballbot.schema import validate_table

_SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "blanks": None}
Sign = Literal[1, -1]
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class FileTable:
    """[file]: the layout of the text."""

    separator: Literal["comma", "semicolon", "tab", "blanks"] = "comma"
    decimal: Literal["point", "comma"] = "point"
    missing: tuple[str, ...] = ()
    header_lines: NonNegativeInt = 1
    names: tuple[str, ...] | None = None
    damaged_rows: Literal["refuse", "drop"] = "refuse"
    repeated_rows: Literal["refuse", "drop"] = "refuse"
    unordered_rows: Literal["refuse", "drop"] = "refuse"
    rows: tuple[PositiveInt, PositiveInt] | None = None


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
    """[attitude]: roll, pitch and yaw of an IMU, or its quaternion w, x, y, z."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=2, max_length=4)]
    unit: str | tuple[str, ...] | None = None
    sign: Sign | tuple[Sign, ...] = 1
    turn: FiniteFloat = 0.0
    upside_down: bool = False
    delay: FiniteFloat = 0.0
    rates: RatesTable | None = None


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
    nanoseconds: str | None = None


@dataclass(frozen=True, kw_only=True)
class SpeedTable:
    """`speed` of [wheels]: a column of the file for each wheel, or the derivative of the angles."""

    sources: Annotated[tuple[str, ...], Field(alias="from", max_length=MAX_WHEELS)] = ()
    derivative_of: Literal["angle"] | None = None
    unit: str | None = None
    counts_per_turn: PositiveFloat | None = None
    scale: FiniteFloat = 1.0
    delay: FiniteFloat = 0.0


@dataclass(frozen=True, kw_only=True)
class AngleTable:
    """`angle` of [wheels]: a column of the file for each wheel, or the integral of the speeds."""

    sources: Annotated[tuple[str, ...], Field(alias="from", max_length=MAX_WHEELS)] = ()
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
    angle: AngleTable = AngleTable()
    speed: SpeedTable = SpeedTable()


@dataclass(frozen=True, kw_only=True)
class MotorsTable:
    """The keys of every kind of [input]."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=1, max_length=MAX_WHEELS)]
    sign: Sign | tuple[Sign, ...] = 1
    scale: FiniteFloat = 1.0
    zero: FiniteFloat | tuple[FiniteFloat, ...] = 0.0
    direction: tuple[str, ...] = ()
    delay: FiniteFloat = 0.0


@dataclass(frozen=True, kw_only=True)
class TorqueTable(MotorsTable, TorqueInput):
    """[input] of kind torque [N m at the wheel]."""

    kind: Literal["torque"]
    unit: str | None = None


@dataclass(frozen=True, kw_only=True)
class CurrentTable(MotorsTable, CurrentInput):
    """[input] of kind current [A]."""

    kind: Literal["current"]


@dataclass(frozen=True, kw_only=True)
class DutyTable(MotorsTable, DutyInput):
    """[input] of kind duty [-1..1], or of the same by its older name pwm."""

    kind: Literal["duty", "pwm"]


@dataclass(frozen=True, kw_only=True)
class VoltageTable(MotorsTable, DutyInput):
    """[input] of kind voltage [V]: a duty of the supply's."""

    kind: Literal["voltage"]


InputTable = TorqueTable | CurrentTable | VoltageTable | DutyTable


def _column_table(value: object) -> object:
    return {"from": value} if isinstance(value, str) else value


@dataclass(frozen=True, kw_only=True)
class MappingTable:
    """A whole mapping file."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # also of the tables in it

    complete: bool = True
    file: FileTable = FileTable()
    time: Timing = field(default_factory=Timing)
    columns: dict[str, Annotated[ColumnTable, BeforeValidator(_column_table)]]
    attitude: AttitudeTable | None = None
    wheels: WheelsTable = WheelsTable()
    input: Annotated[InputTable, Field(discriminator="kind")] | None = None


def read_mapping(path: str | Path) -> LogMapping:
    """Read a mapping file.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or does not describe a log; the sentence names the key and
        its allowed values.
    """
    return parse_mapping(read_text(path, largest=LARGEST_SETTINGS), source=str(path))


def parse_mapping(text: str, *, source: str) -> LogMapping:
    """Return the mapping that the text of a mapping file describes; errors name its `source`.

    Raises
    ------
    InputError
        As `read_mapping`.
    """
    tree = parse_toml(text, source=source)
    try:
        return _mapping(validate_table(MappingTable, take_format(tree, "mapping"), of="a mapping file"))
    except InputError as error:
        raise InputError(f"{source}: {error}{'' if str(error).endswith(('.', '?')) else '.'}") from None


def dead_band_findings(mappings: Iterable[str | Path | None]) -> tuple[Finding, ...]:
    """Return a warning for each mapping file of duties that does not state the firmware's dead band.

    Raises
    ------
    InputError
        If a file cannot be read or is no mapping.
    """
    found = []
    for mapping in mappings:
        motors = read_mapping(mapping).motors if mapping else None
        if motors is None or not isinstance(motors.drive, DutyInput) or motors.drive.dead_band is not None:
            continue
        sentence = (
            "The commands are duties, and no dead band is stated: a duty that the firmware adds counts as less dry "
            "friction. Friction identified from this log includes the firmware's part, and holds for logs that are "
            "read the same way. For the wheels' own friction state dead_band in [input], 0 if the firmware adds none."
        )
        found.append(
            Finding(code="dead-band", severity="warning", text=sentence, where=Place(file=str(mapping)))
        )
    return tuple(found)


def _mapping(table: MappingTable) -> LogMapping:
    if not table.complete:
        raise InputError(
            'the mapping is not complete; fill in the lines with "cannot determine", then remove complete = false'
        )
    for start, end in table.time.keep or ():
        if not end > start:
            raise InputError(
                f"[time] keep has the interval [{start:g}, {end:g}]; write the earlier time first"
            )
    wheels = table.wheels
    columns = {name: _source(name, entry) for name, entry in table.columns.items() if not entry.derivative_of}
    derivatives = {name: one.derivative_of for name, one in table.columns.items() if one.derivative_of}
    for name in derivatives:
        _check_name(name)
        _check_alone(f"[columns] {name}", table.columns[name], "derivative_of")
    columns |= _wheel_sources("angle", wheels.angle, wheels) | _wheel_sources("speed", wheels.speed, wheels)
    integrals: dict[str, str] = {}
    if wheels.speed.derivative_of:
        _check_derived("speed", wheels.speed, "derivative", "angle", wheels.angle)
        derivatives |= {f"wheel{i}_dot": f"wheel{i}" for i in range(1, len(wheels.angle.sources) + 1)}
    if wheels.angle.integral_of:
        _check_derived("angle", wheels.angle, "integral", "speed", wheels.speed)
        integrals = {f"wheel{i}": f"wheel{i}_dot" for i in range(1, len(wheels.speed.sources) + 1)}
    if "t" not in columns:
        raise InputError('[columns] lacks t, the time: t = { from = "..", unit = "s" }')
    attitude = None if table.attitude is None else _attitude(table.attitude, columns)
    made = {*columns, *(("theta", "phi", "psi") if attitude else ())}
    for name, origin in derivatives.items():
        if origin not in made:
            raise InputError(f"{name} is the derivative of {origin!r}, which the mapping does not provide")
    return LogMapping(
        layout=_layout(table.file),
        columns=columns,
        derivatives=derivatives,
        integrals=integrals,
        motors=None if table.input is None else _motors(table.input, wheels),
        attitude=attitude,
        timing=table.time,
        wrap=wheels.angle.wrap,
        largest_speed=wheels.angle.largest_speed,
        drop_repeated=table.file.repeated_rows == "drop",
        drop_unordered=table.file.unordered_rows == "drop",
    )


def _attitude(table: AttitudeTable, columns: dict[str, Source]) -> Attitude:
    both = [name for name in ("theta", "phi", "psi") if name in columns]
    if both:
        raise InputError(f"[columns] has {both[0]}, which [attitude] provides; remove one of them")
    quaternion = table.sources if len(table.sources) == len(QUATERNION_ANGLES) + 1 else ()
    if quaternion and table.unit is not None:
        raise InputError(
            f"[attitude] takes four columns, a quaternion w, x, y, z, which has no unit; remove unit = {table.unit!r}"
        )
    angles = QUATERNION_ANGLES if quaternion else table.sources
    units = _each("[attitude] unit", table.unit, angles)
    signs = _each("[attitude] sign", table.sign, angles)
    factors = [
        s * _unit_factor("[attitude]", "theta", unit, None) for s, unit in zip(signs, units, strict=True)
    ]
    rates: tuple[Source, ...] = ()
    if table.rates is not None:
        one, where = table.rates, "[attitude] rates"
        factor = one.scale * _unit_factor(where, "gyro_x", one.unit, None)
        turned = [sign * factor for sign in _each(f"{where} sign", one.sign, one.sources)]
        rates = _sources(one.sources, turned, one.delay)
    return Attitude(
        sources=_sources(angles, factors, table.delay),
        turn=math.radians(table.turn),
        rates=rates,
        quaternion=quaternion,
        upside_down=table.upside_down,
    )


def _sources(columns: Sequence[str], factors: Sequence[float], delay: float) -> tuple[Source, ...]:
    pairs = zip(columns, factors, strict=True)
    return tuple(Source(column=column, factor=factor, delay=delay) for column, factor in pairs)


def _check_alone(where: str, entry: ColumnTable | AngleTable | SpeedTable, key: str) -> None:
    others = [one.name for one in fields(entry) if getattr(entry, one.name) != one.default]
    keys = ["from" if name in ("source", "sources") else name for name in others if name != key]
    if keys:
        raise InputError(f"{where} has {key}, which allows no other key, but also has {', '.join(keys)}")


def _check_derived(
    name: str, entry: AngleTable | SpeedTable, kind: str, other: str, origin: AngleTable | SpeedTable
) -> None:
    _check_alone(f"[wheels] {name}", entry, f"{kind}_of")
    if not origin.sources:
        raise InputError(f"[wheels] {name} is the {kind} of {other}, which [wheels] lacks")


def _check_name(name: str) -> None:
    if name in KNOWN_NAMES and not (name.startswith("u") and name[1:].isdigit()):
        return
    if name in KNOWN_NAMES:
        raise InputError(f"[columns] has {name}; map torques in [input], which names their kind")
    hint = suggest(name, KNOWN_NAMES, otherwise="the names are")
    raise InputError(f"[columns] has {name}, which is not a column of a log; {hint}")


def _source(name: str, entry: ColumnTable) -> Source:
    _check_name(name)
    if entry.source is None:
        raise InputError(
            f'[columns] {name} needs from = "..", the column of the file, or derivative_of = ".."'
        )
    if name == "t" and entry.delay:
        raise InputError("[columns] t cannot have a delay; give the delay to the columns that are delayed")
    if name != "t" and entry.nanoseconds is not None:
        raise InputError(f"[columns] {name} has nanoseconds; only t may have them")
    unit = _unit_factor(f"[columns] {name}", name, entry.unit, entry.counts_per_turn)
    return Source(
        column=entry.source,
        factor=entry.sign * entry.scale * unit,
        offset=entry.offset,
        delay=entry.delay,
        nanoseconds=entry.nanoseconds,
    )


def _unit_factor(where: str, name: str, given: str | None, counts_per_turn: float | None) -> float:
    unit = unit_of(name)
    if given is None or unit is None:
        return 1.0
    try:
        return factor_to(unit, given, counts_per_turn=counts_per_turn)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _wheel_sources(name: str, entry: AngleTable | SpeedTable, wheels: WheelsTable) -> dict[str, Source]:
    if not entry.sources:
        if entry == type(entry)() or (
            entry.derivative_of if isinstance(entry, SpeedTable) else entry.integral_of
        ):
            return {}
        raise InputError(f"[wheels] {name} needs from = [..], the columns of the file")
    suffix = "_dot" if name == "speed" else ""
    factor = entry.scale * _unit_factor(
        f"[wheels] {name}", f"wheel1{suffix}", entry.unit, entry.counts_per_turn
    )
    signs = _each("[wheels] sign", wheels.sign, entry.sources)
    found = _sources(entry.sources, [sign * factor for sign in signs], entry.delay)
    return {f"wheel{i}{suffix}": found[k] for i, k in enumerate(_order(wheels, len(found)), start=1)}


def _order(wheels: WheelsTable, count: int) -> list[int]:
    """Return, for Ballbot's wheels in turn, the place (from 0) in the file's lists."""
    order = wheels.order or tuple(range(1, count + 1))
    if sorted(order) != list(range(1, count + 1)):
        raise InputError(
            f"[wheels] order is {list(order)}; it must contain each number from 1 to {count} once"
        )
    return [place - 1 for place in order]


def _each(where: str, given: T | tuple[T, ...], columns: Sequence[str]) -> tuple[T, ...]:
    """Return a value for each of these columns, where one may be given for all."""
    values = given if isinstance(given, tuple) else (given,) * len(columns)
    if len(values) != len(columns):
        raise InputError(f"{where} has {len(values)} values; it needs one for each of {len(columns)} columns")
    return values


def _motors(table: InputTable, wheels: WheelsTable) -> MotorInput:
    unit = _unit_factor("[input]", "u1", table.unit, None) if isinstance(table, TorqueTable) else 1.0
    if isinstance(table, VoltageTable):
        unit = 1.0 / table.supply_voltage
    factors = [sign * table.scale * unit for sign in _each("[input] sign", table.sign, table.sources)]
    zeros = _each("[input] zero", table.zero, table.sources)
    directions = _each("[input] direction", table.direction or None, table.sources)
    sources = tuple(
        Source(
            column=table.sources[k],
            factor=factors[k],
            offset=-zeros[k] * factors[k] if zeros[k] else 0.0,
            delay=table.delay,
            direction=directions[k],
        )
        for k in _order(wheels, len(table.sources))
    )
    # the drive's own part of the table
    kind = next(kind for kind in (TorqueInput, CurrentInput, DutyInput) if isinstance(table, kind))
    return MotorInput(
        sources=sources, drive=kind(**{one.name: getattr(table, one.name) for one in fields(kind)})
    )


def _layout(table: FileTable) -> TextLayout:
    if table.header_lines == 0 and table.names is None:
        raise InputError(
            "[file] has header_lines = 0 and therefore needs names = [..], the names of the columns"
        )
    if table.decimal == "comma" and table.separator == "comma":
        raise InputError('[file] decimal = "comma" needs another separator, such as "semicolon"')
    if table.names is not None and len(set(table.names)) < len(table.names):
        raise InputError("[file] names contains a name twice")
    check_column_names(table.names or (), source="[file] names")
    return TextLayout(
        separator=_SEPARATORS[table.separator],
        decimal_comma=table.decimal == "comma",
        missing=table.missing,
        header_lines=table.header_lines,
        names=table.names,
        drop_damaged=table.damaged_rows == "drop",
        rows=table.rows,
    )
