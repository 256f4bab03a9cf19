"""How a foreign table becomes a log: the mapping as values, and its application.

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
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, PositiveFloat

from ballbot.arrays import rows_between
from ballbot.errors import InputError, suggest
from ballbot.findings import Finding, note
from ballbot.log.columns import Columns, direction_sign, mark_missing, numbered_names
from ballbot.log.formats.text import TextLayout
from ballbot.log.imu_angles import (
    about_body_axes,
    angle_rates_of,
    from_roll_pitch_yaw,
    integral_of,
    less_half_a_turn,
    quaternion_angles,
    yaw_ahead,
)
from ballbot.log.row_order import check_time, later_runs, repeated_rows, rows_in_order, rows_with_times
from ballbot.log.signals import new_messages, sampling_times, unwrapped, without_holes, without_resets
from ballbot.log.wrapping import continuous_clock, continuous_headings


@dataclass(frozen=True, kw_only=True)
class TorqueInput:
    """The log has wheel torques."""

    def torque(self, value: NDArray[np.float64], _wheel_speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return u [N m] = the value itself."""
        return value


@dataclass(frozen=True, kw_only=True)
class CurrentInput:
    """The log has motor currents."""

    torque_constant: PositiveFloat  #: k_t [N m/A]
    gear_ratio: PositiveFloat  #: n [-]
    efficiency: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0  #: of the gear

    def torque(self, value: NDArray[np.float64], _wheel_speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return u [N m] = n k_t efficiency i."""
        return self.gear_ratio * self.torque_constant * self.efficiency * value


@dataclass(frozen=True, kw_only=True)
class DutyInput:
    """The log has PWM duties of a brushed or field-oriented motor on a stiff supply; inductance is neglected."""

    supply_voltage: PositiveFloat  #: V [V]
    torque_constant: PositiveFloat  #: k_t [N m/A]
    back_emf_constant: PositiveFloat  #: k_e [V s/rad]
    resistance: PositiveFloat  #: R [ohm]
    gear_ratio: PositiveFloat  #: n [-]
    #: duty that the firmware adds, in the duty's direction, to overcome friction; None if unknown: the log is then read
    #: as if there were none, and dry friction identified from it is less by this duty's torque
    dead_band: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    duty_limit: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0  #: the largest duty that reaches the motor

    def acting(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the duty at the motor: d + dead_band sgn(d), within the limit."""
        added = (self.dead_band or 0.0) * np.sign(value)
        return np.clip(value + added, -self.duty_limit, self.duty_limit)

    def torque(self, value: NDArray[np.float64], wheel_speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return u [N m] = n k_t (d V - k_e n w) / R of the duty d at the motor."""
        back_emf = self.back_emf_constant * self.gear_ratio * wheel_speed
        current = (value * self.supply_voltage - back_emf) / self.resistance
        return self.gear_ratio * self.torque_constant * current


DriveInput = TorqueInput | CurrentInput | DutyInput


@dataclass(frozen=True, kw_only=True)
class Source:
    """A column of the file: value = factor * cell + offset, in Ballbot's unit."""

    column: str  #: its name in the file
    factor: float = 1.0  #: unit, scale and sign in one
    offset: float = 0.0  #: in Ballbot's unit
    delay: float = 0.0  #: [s]
    nanoseconds: str | None = None  #: of a time: the column with the nanoseconds that its seconds lack
    direction: str | None = None  #: of a motor's magnitude: the column that is above zero where it is forward


@dataclass(frozen=True, kw_only=True)
class MotorInput:
    """The motors' columns of the file, one for each wheel in Ballbot's order, and their kind."""

    sources: tuple[Source, ...]
    drive: DriveInput


@dataclass(frozen=True, kw_only=True)
class Attitude:
    """Roll, pitch and, if the file has it, yaw of an IMU."""

    #: columns of the file; `QUATERNION_ANGLES` if they are made of a `quaternion`
    #: without a yaw, the heading is the integral of the gyro's rate about z, to first order of the lean, and drifts;
    #: without a gyro, the log has none, and its theta and phi are those of a heading that stays zero
    sources: tuple[Source, ...]
    turn: float = 0.0  #: angle of the IMU's x axis from the robot's, towards the left [rad]
    #: angular velocity about the IMU's x, y and z axes; if empty, the angles are differentiated
    rates: tuple[Source, ...] = ()
    quaternion: tuple[str, ...] = ()  #: the file's columns of its w, x, y and z
    #: whether the IMU hangs upside down, turned about its x axis; its `rates` are taken as the file has them
    upside_down: bool = False

    @property
    def has_heading(self) -> bool:
        """Whether a sensor gives the heading; else the wheels do (`ballbot.log.pose`)."""
        return len(self.sources) > 2 or bool(self.rates)


@dataclass(frozen=True, kw_only=True)
class Timing:
    """[time] of a mapping file: the times of the log's rows."""

    #: whether the times of sampling are estimated from the encoders; see `sampling_times`
    repair: bool = False
    sample_time: PositiveFloat | None = None  #: of rows at even intervals [s]; None keeps the file's rows
    #: intervals of the file's clock to keep [s]; None keeps all
    keep: tuple[tuple[FiniteFloat, FiniteFloat], ...] | None = None


@dataclass(frozen=True, kw_only=True)
class LogMapping:
    """How a foreign file becomes a log; see `ballbot.log.mapping_file` for its TOML form."""

    layout: TextLayout
    columns: Mapping[str, Source]  #: by Ballbot's name, t among them
    derivatives: Mapping[str, str]  #: by Ballbot's name, which of Ballbot's columns to differentiate
    integrals: Mapping[str, str] = field(default_factory=dict)  #: by wheel angle, the speed to integrate
    motors: MotorInput | None = None
    attitude: Attitude | None = None
    timing: Timing = Timing()
    #: in the file's numbers; a wheel angle begins again after so many and is continued
    wrap: float | None = None
    #: [rad/s]; a wheel angle that changes faster was reset and is continued from there
    largest_speed: float | None = None
    drop_repeated: bool = False  #: whether rows that repeat the row before are one
    drop_unordered: bool = False  #: whether rows out of order are left out

    @property
    def used_columns(self) -> set[str] | None:
        """The file's columns that it takes; None if rows with words in any column are left out."""
        if self.layout.drop_damaged:
            return None
        sources = [*self.columns.values(), *(self.motors.sources if self.motors else ())]
        quaternion: tuple[str, ...] = ()
        if self.attitude is not None:
            sources += [*self.attitude.sources, *self.attitude.rates]
            quaternion = self.attitude.quaternion
        names = (name for one in sources for name in (one.column, one.nanoseconds, one.direction))
        return {*quaternion, *(name for name in names if name is not None)}


_ATTITUDE_NAMES = ("theta", "phi", "psi")
_GYRO_NAMES = ("gyro_x", "gyro_y", "gyro_z")


def apply_mapping(
    mapping: LogMapping,
    table: Mapping[str, NDArray[np.float64]],
    *,
    even_from: float | None = None,
    changes: list[Finding] | None = None,
) -> Columns:
    """Return the log's columns (N,) from the file's.

    Parameters
    ----------
    mapping : LogMapping
    table : mapping of str to (M,) array
        The file's columns by the file's names.
    even_from : float, optional
        A time from which rows at even intervals are counted [s]; the table's first if not given.
    changes : list of Finding, optional
        Findings on what is left out or continued are added to it.

    Returns
    -------
    dict of str to (N,) array
        In Ballbot's names and units; rows at the ends are cut if a delay requires it.

    Raises
    ------
    InputError
        If the file lacks a column that the mapping names, its time does not increase, or no row is left.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a scale may turn a cell into an infinity
        columns = _applied(mapping, table, even_from, [] if changes is None else changes)
    return {name: values if name == "t" else mark_missing(values) for name, values in columns.items()}


def _applied(
    mapping: LogMapping,
    table: Mapping[str, NDArray[np.float64]],
    even_from: float | None,
    changes: list[Finding],
) -> Columns:
    clock, notes = mapping.columns["t"].column, list[str]()
    table = whole_rows(mapping, table)
    if clock in table:
        table = rows_with_times(table, clock, notes)
    t = row_times(mapping, table)
    changes += [note("time", sentence) for sentence in notes]
    if mapping.attitude is not None and mapping.attitude.quaternion:
        parts = [
            _scaled(f"the quaternion's {part}", Source(column=column), table)
            for part, column in zip("wxyz", mapping.attitude.quaternion, strict=True)
        ]
        table = {**table, **quaternion_angles(np.column_stack(parts))}
    raw = {name: _scaled(name, source, table) for name, source in mapping.columns.items()}
    if mapping.wrap is not None:
        periods = {name: abs(mapping.columns[name].factor) * mapping.wrap for name in _wheel_angles(raw)}
        raw |= {name: unwrapped(raw[name], period=period) for name, period in periods.items()}
    # before its offset, from the file's own ends of a turn
    offsets = {name: mapping.columns[name].offset for name in ("psi", "ref_psi") if name in raw}
    continued, wraps = continuous_headings({name: raw[name] - offsets[name] for name in offsets}, t)
    raw |= {name: heading + offsets[name] for name, heading in continued.items()}
    changes += wraps
    names = _wheel_angles(raw)
    if mapping.largest_speed is not None and names:
        carried = without_resets(t, np.column_stack([raw[name] for name in names]), mapping.largest_speed)
        raw |= dict(zip(names, carried.T, strict=True))
    raw |= {name: _integral(t, raw[origin]) for name, origin in mapping.integrals.items()}
    sampled = _sampled(mapping, t, raw)
    even = mapping.timing.sample_time
    count = len(raw) + len(mapping.derivatives) + 10
    rows = t if even is None else _even_rows(t, even, t[0] if even_from is None else even_from, columns=count)
    columns: Columns = {"t": rows}
    # even rows get values between the file's, and for its missing cells
    shift = even is not None or mapping.timing.repair
    for name in raw:
        if name != "t":
            delay = mapping.columns[mapping.integrals.get(name, name)].delay
            columns[name] = _measured_at(rows, sampled, raw[name], delay, shift=shift)
    if mapping.attitude is not None:
        columns |= _attitude(mapping.attitude, table, rows, sampled, shift=shift)
    if mapping.motors is not None:
        columns |= _commands(mapping.motors, table, t, rows, even=even is not None)
    columns = _cut(columns, t, *_delays(mapping))
    for name, origin in mapping.derivatives.items():
        if origin == "psi" and mapping.attitude is not None and not mapping.attitude.has_heading:
            continue
        if origin not in columns:
            raise InputError(f"The mapping differentiates {origin}, which it does not provide.")
        columns[name] = _derivative(columns["t"], columns[origin], origin)
    if mapping.motors is not None:
        columns |= _torques(mapping.motors, columns)
    return _kept(columns, mapping.timing.keep)


def row_times(mapping: LogMapping, table: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the times of the file's rows (N,) by the file's own clock [s].

    Raises
    ------
    InputError
        If they do not increase.
    """
    t = _clock(mapping.columns["t"], table)
    check_time(t)
    return t


def whole_rows(mapping: LogMapping, table: Mapping[str, NDArray[np.float64]]) -> Columns:
    """Return a file's table with the rows that a mapping takes.

    Raises
    ------
    InputError
        If rows out of order are to be left out, and are those of another run.
    """
    source = mapping.columns["t"]
    if source.column not in table or not (mapping.drop_repeated or mapping.drop_unordered):
        return {**table}  # `row_times` reports a time that is missing
    t = _clock(source, table)
    repeated = repeated_rows(table, source.column) & mapping.drop_repeated
    if mapping.drop_unordered and mapping.layout.rows is None:
        runs = later_runs(t, repeated)
        again = runs[t[runs] < t[runs - 1]]
        if again.size:
            raise InputError(
                f"Time starts again at row {again[0] + 1}; split the log, or give `rows` in [file]."
            )
    return rows_in_order(table, t, repeated=repeated, unordered=mapping.drop_unordered)


def _clock(source: Source, table: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the times of all rows (N,) by the file's own clock [s], continued where it begins again."""
    if source.column in table:
        table = {**table, source.column: continuous_clock(table[source.column])[0]}
    t = _scaled("t", source, table)
    if source.nanoseconds is None:
        return t
    return t + _scaled("the nanoseconds", Source(column=source.nanoseconds, factor=1e-9), table)


def sensor_delay(mapping: LogMapping) -> float:
    """Return the largest delay of the sensors [s]."""
    measured, _ = _delays(mapping)
    return max(measured)


def _even_rows(
    t: NDArray[np.float64], interval: float, counted_from: float, *, columns: int
) -> NDArray[np.float64]:
    """Return the times within the table that are whole intervals from `counted_from`; refuse too many."""
    rows_between(float(t[-1] - t[0]), interval, columns=columns, source="By the mapping's t, the file")
    # a part of an interval more at either end, so that a row that rounding moved is kept
    first = math.ceil((t[0] - counted_from) / interval - 1e-6)
    last = math.floor((t[-1] - counted_from) / interval + 1e-6)
    return counted_from + interval * np.arange(first, last + 1)


def _scaled(name: str, source: Source, table: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    for column in (source.column, source.direction):
        if column is not None and column not in table:
            hint = suggest(column, table, otherwise="it has")
            raise InputError(
                f"The mapping takes {name} from the column {column!r}, which does not exist; {hint}"
            )
    values = mark_missing(source.factor * table[source.column] + source.offset)
    return values if source.direction is None else values * direction_sign(table[source.direction])


def _integral(t: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the integral (N,) of a wheel's speed, missing where the speed is, but in short holes."""
    speed = without_holes(t, speed)
    return integral_of(t, speed) + 0.0 * speed


def _wheel_angles(columns: Columns) -> tuple[str, ...]:
    return numbered_names(columns, prefix="wheel") if "wheel1" in columns else ()


def _sampled(mapping: LogMapping, t: NDArray[np.float64], raw: Columns) -> NDArray[np.float64]:
    """Return the times (N,) at which the rows' sensors were read [s]."""
    if not mapping.timing.repair:
        return t
    names = _wheel_angles(raw)
    if len(names) < 2:
        raise InputError("[time] repair needs the angles of at least two wheels.")
    angles = np.column_stack([without_holes(t, raw[name]) for name in names])
    if not np.isfinite(angles).all():
        raise InputError("[time] repair needs wheel angles without long holes.")
    return sampling_times(t, angles)


def _attitude(
    attitude: Attitude,
    table: Mapping[str, NDArray[np.float64]],
    rows: NDArray[np.float64],
    sampled: NDArray[np.float64],
    *,
    shift: bool,
) -> Columns:
    angles = np.zeros((len(rows), 3))
    for place, source in enumerate(attitude.sources):
        values = _scaled(_ATTITUDE_NAMES[place], source, table)
        if place == 0 and attitude.upside_down:
            values = less_half_a_turn(values, math.pi)
        if place == 2:
            values = unwrapped(values)
        angles[:, place] = _measured_at(rows, sampled, values, source.delay, shift=shift)
    measured = [
        _measured_at(rows, sampled, _scaled(name, source, table), source.delay, shift=shift)
        for name, source in zip(_GYRO_NAMES, attitude.rates, strict=bool(attitude.rates))
    ]
    if len(attitude.sources) == 2:
        angles[:, 2] = integral_of(rows, measured[2]) if measured else yaw_ahead(angles, attitude.turn)
    turned = from_roll_pitch_yaw(angles, turn=attitude.turn)
    columns: Columns = dict(zip(_ATTITUDE_NAMES, turned.T, strict=True))
    if not attitude.has_heading:
        del columns["psi"]
    if not measured:
        return columns
    body = about_body_axes(np.column_stack(measured), attitude.turn)
    columns |= dict(zip(_GYRO_NAMES, body.T, strict=True))
    rates = angle_rates_of(turned, body)
    return columns | {f"{name}_dot": rate for name, rate in zip(_ATTITUDE_NAMES, rates.T, strict=True)}


def _commands(
    motors: MotorInput,
    table: Mapping[str, NDArray[np.float64]],
    t: NDArray[np.float64],
    rows: NDArray[np.float64],
    *,
    even: bool,
) -> Columns:
    columns: Columns = {}
    for i, source in enumerate(motors.sources, start=1):
        acting = _scaled(f"u{i}", source, table)
        if isinstance(motors.drive, DutyInput):
            acting = motors.drive.acting(acting)
        columns[f"u{i}"] = (
            _mean_acting(t, rows, acting, source.delay) if even else _acting_at(t, acting, source.delay)
        )
    return columns


def _delays(mapping: LogMapping) -> tuple[list[float], list[float]]:
    """Return the delays of the sensors and of the commands [s]."""
    measured = [source.delay for source in mapping.columns.values()]
    if mapping.attitude:
        measured += [source.delay for source in (*mapping.attitude.sources, *mapping.attitude.rates)]
    return measured, [source.delay for source in mapping.motors.sources] if mapping.motors else []


def _cut(columns: Columns, t: NDArray[np.float64], measured: list[float], commanded: list[float]) -> Columns:
    """Return the rows for which every delayed column has a value in the file, whose times are t."""
    rows = columns["t"]
    ahead = [*measured, *(-delay for delay in commanded)]
    kept = (rows + min(ahead) >= t[0] - _ROUNDING) & (rows + max(ahead) <= t[-1] + _ROUNDING)
    if not kept.any():
        raise InputError("The delays in the mapping are longer than the log; give delays in seconds.")
    return {name: values[kept] for name, values in columns.items()}


def _derivative(t: NDArray[np.float64], values: NDArray[np.float64], origin: str) -> NDArray[np.float64]:
    if len(t) < 2:
        raise InputError(f"The derivative of {origin} needs at least two rows.")
    return np.gradient(values, t)


def _torques(motors: MotorInput, columns: Columns) -> Columns:
    torques: Columns = {}
    for i in range(1, len(motors.sources) + 1):
        speed = columns.get(f"wheel{i}_dot")
        if speed is None and isinstance(motors.drive, DutyInput):
            raise InputError(
                f"Torque from a PWM duty needs the speed of the wheel: map the column wheel{i}_dot."
            )
        command = columns[f"u{i}"]
        torques[f"u{i}"] = motors.drive.torque(command, np.zeros_like(command) if speed is None else speed)
    return torques


def _kept(columns: Columns, spans: tuple[tuple[float, float], ...] | None) -> Columns:
    if spans is None:
        return columns
    t = columns["t"]
    kept = np.zeros(len(t), dtype=np.bool_)
    for start, end in spans:
        kept |= (t >= start) & (t < end)
    if not kept.any():
        raise InputError(f"[time] keep selects no row of the file, which runs from {t[0]:g} to {t[-1]:g} s.")
    return {name: values[kept] for name, values in columns.items()}


#: [s] by which rounding may move a delayed row past the one it belongs to
_ROUNDING = 1e-9


def _measured_at(
    rows: NDArray[np.float64],
    sampled: NDArray[np.float64],
    values: NDArray[np.float64],
    delay: float,
    *,
    shift: bool,
) -> NDArray[np.float64]:
    """Return a sensor's values (N,) reported `delay` after the rows' times, interpolated linearly."""
    if not (shift or delay):
        return values
    first = new_messages(sampled) if shift else slice(None)
    return np.interp(rows + delay, sampled[first], without_holes(sampled[first], values[first]))


def _acting_at(t: NDArray[np.float64], values: NDArray[np.float64], delay: float) -> NDArray[np.float64]:
    """Return the command that acts at t: the last one logged at t - delay or before."""
    if not delay:
        return values
    latest = np.searchsorted(t, t - delay + _ROUNDING, side="right") - 1
    return values[np.maximum(latest, 0)]


def _mean_acting(
    t: NDArray[np.float64], rows: NDArray[np.float64], values: NDArray[np.float64], delay: float
) -> NDArray[np.float64]:
    """Return the mean of the command that acts from each row to the next; missing where a part of it is."""
    step = rows[1] - rows[0] if len(rows) > 1 else 1.0
    edges = np.append(rows, rows[-1] + step) - delay
    values = without_holes(t, values, held=True)
    known = np.isfinite(values)

    def mean(acting: NDArray[np.float64]) -> NDArray[np.float64]:
        impulse = np.concatenate(([0.0], np.cumsum(acting[:-1] * np.diff(t))))
        return np.diff(np.interp(edges, t, impulse)) / step

    means = mean(np.where(known, values, 0.0))
    return means if known.all() else np.where(mean((~known).astype(float)) > 1e-9, np.nan, means)
