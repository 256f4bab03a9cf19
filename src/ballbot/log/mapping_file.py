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
from dataclasses import fields
from pathlib import Path

from ballbot.errors import InputError, suggest
from ballbot.file_formats import take_format
from ballbot.files import LARGEST_SETTINGS, parse_toml, read_text
from ballbot.findings import Finding, Place
from ballbot.log.columns import KNOWN_NAMES, check_column_names, factor_to, unit_of
from ballbot.log.formats.text import TextLayout
from ballbot.log.imu_angles import QUATERNION_ANGLES
from ballbot.log.mapping import (
    Attitude,
    CurrentInput,
    DriveInput,
    DutyInput,
    LogMapping,
    MotorInput,
    Source,
    TorqueInput,
)
from ballbot.log.mapping_tables import (
    AttitudeTable,
    ColumnTable,
    FileTable,
    InputTable,
    MappingTable,
    RatesTable,
    TorqueTable,
    VoltageTable,
    WheelColumnsTable,
    WheelsTable,
)
from ballbot.schema import validate_table

_SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "blanks": None}


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
    _check_intervals(table.time.keep or ())
    columns: dict[str, Source] = {}
    derivatives: dict[str, str] = {}
    for name, entry in table.columns.items():
        _check_name(name)
        if entry.derivative_of is None:
            columns[name] = _source(name, entry)
        else:
            _check_alone(f"[columns] {name}", entry)
            derivatives[name] = entry.derivative_of
    columns |= _wheel_columns(table.wheels)
    derivatives |= _wheel_derivatives(table.wheels)
    integrals = _wheel_integrals(table.wheels)
    if "t" not in columns:
        raise InputError('[columns] lacks t, the time: t = { from = "..", unit = "s" }')
    attitude = None if table.attitude is None else _attitude(table.attitude, columns)
    made = {*columns, *(("theta", "phi", "psi") if attitude else ())}
    for name, origin in derivatives.items():
        if origin not in made:
            raise InputError(f"{name} is the derivative of {origin!r}, which the mapping does not provide")
    motors = None if table.input is None else _motors(table.input, table.wheels)
    return LogMapping(
        layout=_layout(table.file),
        columns=columns,
        derivatives=derivatives,
        integrals=integrals,
        motors=motors,
        attitude=attitude,
        timing=table.time,
        wrap=table.wheels.angle.wrap if table.wheels.angle else None,
        largest_speed=table.wheels.angle.largest_speed if table.wheels.angle else None,
        drop_repeated=table.file.repeated_rows == "drop",
        drop_unordered=table.file.unordered_rows == "drop",
    )


def _check_intervals(keep: Sequence[tuple[float, float]]) -> None:
    for start, end in keep:
        if not end > start:
            raise InputError(
                f"[time] keep has the interval [{start:g}, {end:g}]; write the earlier time first"
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
    units = [table.unit] * len(angles) if table.unit is None or isinstance(table.unit, str) else table.unit
    if len(units) != len(angles):
        raise InputError(
            f"[attitude] unit has {len(units)} values; it needs one, or one for each of the {len(angles)}"
        )
    signs = _signs("[attitude]", table.sign, len(angles), "angles")
    sources = tuple(
        Source(
            column=column, factor=sign * _unit_factor("[attitude]", "theta", unit, None), delay=table.delay
        )
        for column, sign, unit in zip(angles, signs, units, strict=True)
    )
    return Attitude(
        sources=sources,
        turn=math.radians(table.turn),
        rates=_rates(table.rates),
        quaternion=quaternion,
        upside_down=table.upside_down,
    )


def _rates(table: RatesTable | None) -> tuple[Source, ...]:
    if table is None:
        return ()
    where = "[attitude] rates"
    factor = table.scale * _unit_factor(where, "gyro_x", table.unit, None)
    signs = _signs(where, table.sign, len(table.sources), "rates")
    return tuple(
        Source(column=column, factor=sign * factor, delay=table.delay)
        for column, sign in zip(table.sources, signs, strict=True)
    )


def _wheel_columns(wheels: WheelsTable) -> dict[str, Source]:
    columns: dict[str, Source] = {}
    if wheels.angle and not wheels.angle.integral_of:
        columns |= _wheel_sources(wheels.angle, "", wheels)
    if wheels.speed and not wheels.speed.derivative_of:
        for key in ("wrap", "largest_speed", "integral_of"):
            if getattr(wheels.speed, key) is not None:
                raise InputError(f"[wheels] speed has {key}, which only angle may have")
        columns |= _wheel_sources(wheels.speed, "_dot", wheels)
    return columns


def _wheel_derivatives(wheels: WheelsTable) -> dict[str, str]:
    if not (wheels.speed and wheels.speed.derivative_of):
        return {}
    _check_alone("[wheels] speed", wheels.speed)
    if not (wheels.angle and wheels.angle.sources):
        raise InputError("[wheels] speed is the derivative of angle, which [wheels] lacks")
    return {f"wheel{i}_dot": f"wheel{i}" for i in range(1, len(wheels.angle.sources) + 1)}


def _wheel_integrals(wheels: WheelsTable) -> dict[str, str]:
    if not (wheels.angle and wheels.angle.integral_of):
        return {}
    _check_alone("[wheels] angle", wheels.angle, key="integral_of")
    if not (wheels.speed and wheels.speed.sources):
        raise InputError("[wheels] angle is the integral of speed, which [wheels] lacks")
    return {f"wheel{i}": f"wheel{i}_dot" for i in range(1, len(wheels.speed.sources) + 1)}


def _check_alone(where: str, entry: ColumnTable | WheelColumnsTable, *, key: str = "derivative_of") -> None:
    others = [one.name for one in fields(entry) if getattr(entry, one.name) != one.default]
    keys = ["from" if name in ("source", "sources") else name for name in others if name != key]
    if keys:
        raise InputError(f"{where} has {key}, which allows no other key, but also has {', '.join(keys)}")


def _check_name(name: str) -> None:
    if name in KNOWN_NAMES and not (name.startswith("u") and name[1:].isdigit()):
        return
    if name in KNOWN_NAMES:
        raise InputError(f"[columns] has {name}; map torques in [input], which names their kind")
    hint = suggest(name, KNOWN_NAMES, otherwise="the names are")
    raise InputError(f"[columns] has {name}, which is not a column of a log; {hint}")


def _source(name: str, entry: ColumnTable) -> Source:
    if entry.source is None:
        raise InputError(
            f'[columns] {name} needs from = "..", the column of the file, or derivative_of = ".."'
        )
    if name == "t" and entry.delay:
        raise InputError("[columns] t cannot have a delay; give the delay to the columns that are delayed")
    if name != "t" and entry.nanoseconds is not None:
        raise InputError(f"[columns] {name} has nanoseconds; only t may have them")
    factor = (
        entry.sign * entry.scale * _unit_factor(f"[columns] {name}", name, entry.unit, entry.counts_per_turn)
    )
    return Source(
        column=entry.source,
        factor=factor,
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


def _wheel_sources(entry: WheelColumnsTable, suffix: str, wheels: WheelsTable) -> dict[str, Source]:
    where = "[wheels] speed" if suffix else "[wheels] angle"
    if entry.sources is None or entry.derivative_of:
        raise InputError(f"{where} needs from = [..], the columns of the file")
    count = len(entry.sources)
    factor = entry.scale * _unit_factor(where, f"wheel1{suffix}", entry.unit, entry.counts_per_turn)
    signs = _signs("[wheels]", wheels.sign, count)
    return {
        f"wheel{i}{suffix}": Source(column=entry.sources[k], factor=signs[k] * factor, delay=entry.delay)
        for i, k in enumerate(_order(wheels, count), start=1)
    }


def _order(wheels: WheelsTable, count: int) -> list[int]:
    """Return, for Ballbot's wheels in turn, the place (from 0) in the file's lists."""
    order = wheels.order or tuple(range(1, count + 1))
    if sorted(order) != list(range(1, count + 1)):
        raise InputError(
            f"[wheels] order is {list(order)}; it must contain each number from 1 to {count} once"
        )
    return [place - 1 for place in order]


def _signs(where: str, sign: int | Sequence[int], count: int, named: str = "wheels") -> list[int]:
    signs = [sign] * count if isinstance(sign, int) else list(sign)
    if len(signs) != count:
        raise InputError(
            f"{where} sign has {len(signs)} values; it needs one for each of the {count} {named}"
        )
    return signs


def _motors(table: InputTable, wheels: WheelsTable) -> MotorInput:
    count = len(table.sources)
    signs = _signs("[input]", table.sign, count)
    unit = _unit_factor("[input]", "u1", table.unit, None) if isinstance(table, TorqueTable) else 1.0
    if isinstance(table, VoltageTable):
        unit = 1.0 / table.supply_voltage
    zeros = table.zero if isinstance(table.zero, tuple) else (table.zero,) * count
    for key, values in (("zero", zeros), ("direction", table.direction or table.sources)):
        if len(values) != count:
            raise InputError(
                f"[input] {key} has {len(values)} values; it needs one for each of the {count} wheels"
            )
    factors = [sign * table.scale * unit for sign in signs]
    sources = tuple(
        Source(
            column=table.sources[k],
            factor=factors[k],
            offset=-zeros[k] * factors[k] if zeros[k] else 0.0,
            delay=table.delay,
            direction=table.direction[k] if table.direction else None,
        )
        for k in _order(wheels, count)
    )
    return MotorInput(sources=sources, drive=_drive(table))


def _drive(table: DriveInput) -> DriveInput:
    """Return the drive's own part of a table."""
    kind = next(kind for kind in (TorqueInput, CurrentInput, DutyInput) if isinstance(table, kind))
    return kind(**{one.name: getattr(table, one.name) for one in fields(kind)})


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
