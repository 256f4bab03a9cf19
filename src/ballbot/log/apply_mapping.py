"""A foreign table turned into a log's columns, as a `LogMapping` says.

The order is: scale, carry wheel angles on across resets, find when the rows were sampled, shift and resample, turn an
IMU's angles into Ballbot's, differentiate, make torques, keep the spans asked for. Delays are undone: a sensor's value
that reached the log `delay` late describes the time t - delay, and a command logged at t acts at t + delay, held until
the next. Rows at the ends for which a delayed column then has no value are cut off. Rows at even intervals get sensors
read between the file's rows, and each command's mean over the time to the next row, so that its impulse is kept.

An IMU gives R_world_imu = Rz(yaw) Ry(pitch) Rx(roll), the aerospace order; Ballbot's angles are those of
R_world_body = Rx(theta) Ry(phi) Rz(psi). An IMU whose x axis stands at an angle `turn` from the robot's, towards the
left, has R_world_body = R_world_imu Rz(-turn). Ballbot's lean angles are about axes of the world, roll and pitch about
axes that turn with the heading: they are the same only while the heading is zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import rows_between
from ballbot.errors import InputError, suggest
from ballbot.log.columns import mark_missing, numbered_names
from ballbot.log.mapping import Attitude, DutyInput, LogMapping, MotorInput, Source
from ballbot.log.sampling_times import new_messages, sampling_times


def from_roll_pitch_yaw(angles: NDArray[np.float64], *, turn: float = 0.0) -> NDArray[np.float64]:
    """Return theta, phi, psi (N, 3) [rad], psi without jumps.

    Parameters
    ----------
    angles : ndarray (N, 3)
        Roll, pitch and yaw [rad]; NaN goes through.
    turn : float
        Angle of the IMU's x axis from the robot's, towards the left [rad].
    """
    roll, pitch, yaw = angles.T
    c_r, s_r, c_p, s_p = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    c_y, s_y = np.cos(yaw), np.sin(yaw)
    # columns of R_world_imu
    x = np.stack([c_y * c_p, s_y * c_p, -s_p])
    y = np.stack([c_y * s_p * s_r - s_y * c_r, s_y * s_p * s_r + c_y * c_r, c_p * s_r])
    z = np.stack([c_y * s_p * c_r + s_y * s_r, s_y * s_p * c_r - c_y * s_r, c_p * c_r])
    x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    theta, phi = np.arctan2(-z[1], z[2]), np.arcsin(np.clip(z[0], -1.0, 1.0))
    psi = np.arctan2(-y[0], x[0])
    known = np.isfinite(psi)
    psi[known] = np.unwrap(psi[known])
    return np.column_stack([theta, phi, psi])


#: [s] by which rounding may move a delayed row past the one it belongs to
_ROUNDING = 1e-9
_ATTITUDE_NAMES = ("theta", "phi", "psi")

Columns = dict[str, NDArray[np.float64]]


def apply_mapping(
    mapping: LogMapping, table: Mapping[str, NDArray[np.float64]], *, even_from: float | None = None
) -> Columns:
    """Return the log's columns (N,) from the file's.

    Parameters
    ----------
    mapping : LogMapping
        What comes from where.
    table : mapping of str to (M,) array
        The file's columns by the file's names.
    even_from : float, optional
        A time from which rows at even intervals are counted, where not from the table's first [s].

    Returns
    -------
    dict of str to (N,) array
        In Ballbot's names and units; rows at the ends are cut where a delay asks for it.

    Raises
    ------
    InputError
        Where the file lacks a column that the mapping names, its time does not increase, or nothing is left.
    """
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # what a scale makes of a cell may be beyond all measure
        columns = _applied(mapping, table, even_from)
    return {name: values if name == "t" else mark_missing(values) for name, values in columns.items()}


def _applied(
    mapping: LogMapping, table: Mapping[str, NDArray[np.float64]], even_from: float | None
) -> Columns:
    t = row_times(mapping, table)
    raw = {name: _scaled(name, source, table) for name, source in mapping.columns.items()}
    if mapping.largest_speed is not None:
        raw |= {name: without_resets(t, raw[name], mapping.largest_speed) for name in _wheel_angles(raw)}
    sampled = _sampled(mapping, t, raw)
    even = mapping.timing.sample_time
    count = len(mapping.columns) + len(mapping.derivatives) + 10
    rows = t if even is None else _even_rows(t, even, t[0] if even_from is None else even_from, columns=count)
    columns: Columns = {"t": rows}
    shift = not np.array_equal(rows, sampled)
    for name, source in mapping.columns.items():
        if name != "t":
            columns[name] = _measured_at(rows, sampled, raw[name], source.delay, shift=shift)
    if mapping.attitude is not None:
        columns |= _attitude(mapping.attitude, table, rows, sampled, shift=shift)
    if mapping.motors is not None:
        columns |= _commands(mapping.motors, table, t, rows, even=even is not None)
    columns = _cut(columns, t, *_delays(mapping))
    for name, origin in mapping.derivatives.items():
        if origin not in columns:
            raise InputError(f"The mapping differentiates {origin}, which it does not provide.")
        columns[name] = _derivative(columns["t"], columns[origin], origin)
    if mapping.motors is not None:
        columns |= _torques(mapping.motors, columns)
    return _kept(columns, mapping.timing.keep)


def without_resets(
    t: NDArray[np.float64], angle: NDArray[np.float64], largest_speed: float
) -> NDArray[np.float64]:
    """Return an encoder's angle (N,) without the steps that are too fast for the wheel: resets and overflows.

    Parameters
    ----------
    t, angle : ndarray (N,)
        [s], [rad].
    largest_speed : float
        Above what the wheel can do [rad/s].
    """
    steps = np.diff(angle)
    if not steps.size:
        return angle
    # three usual intervals: a late row is no reset
    allowed = largest_speed * np.maximum(np.diff(t), 3.0 * np.median(np.diff(t)))
    steps[np.abs(steps) > allowed] = 0.0
    return angle[0] + np.concatenate(([0.0], np.cumsum(steps)))


def row_times(mapping: LogMapping, table: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the times of the file's rows (N,) by the file's own clock [s].

    Raises
    ------
    InputError
        Where they do not increase.
    """
    t = _scaled("t", mapping.columns["t"], table)
    lost = np.flatnonzero(~np.isfinite(t))
    if lost.size:
        raise InputError(f"The time is missing or not finite at row {lost[0] + 1}; every row needs its time.")
    wrong = np.flatnonzero(~(np.diff(t) > 0.0))
    if wrong.size:
        raise InputError(
            f"Time does not increase at row {wrong[0] + 2} (t = "
            f"{t[wrong[0] + 1]:.9g} s). Sort the rows or split the log."
        )
    return t


def sensor_delay(mapping: LogMapping) -> float:
    """Return how long after a moment the last of the sensors reports it [s]."""
    mark_missing, _ = _delays(mapping)
    return max(mark_missing)


def _even_rows(
    t: NDArray[np.float64], interval: float, counted_from: float, *, columns: int
) -> NDArray[np.float64]:
    """Return the times within the table's that lie whole intervals from `counted_from`; refuse too many."""
    rows_between(float(t[-1] - t[0]), interval, columns=columns, source="By the mapping's t, the file")
    # a part of an interval more at either end, so that a row that rounding moved is kept
    first = math.ceil((t[0] - counted_from) / interval - 1e-6)
    last = math.floor((t[-1] - counted_from) / interval + 1e-6)
    return counted_from + interval * np.arange(first, last + 1)


def _scaled(name: str, source: Source, table: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    if source.column not in table:
        hint = suggest(source.column, table, otherwise="it has")
        raise InputError(
            f"The mapping takes {name} from the column {source.column!r}, which does not exist; {hint}"
        )
    return mark_missing(source.factor * table[source.column] + source.offset)


def _wheel_angles(columns: Columns) -> tuple[str, ...]:
    return numbered_names(columns, prefix="wheel") if "wheel1" in columns else ()


def _sampled(mapping: LogMapping, t: NDArray[np.float64], raw: Columns) -> NDArray[np.float64]:
    """Return when the rows' sensors were read (N,)."""
    if not mapping.timing.repair:
        return t
    names = _wheel_angles(raw)
    if len(names) < 2:
        raise InputError("[time] repair needs the angles of at least two wheels.")
    angles = np.column_stack([raw[name] for name in names])
    if not np.isfinite(angles).all():
        raise InputError("[time] repair needs wheel angles without missing values.")
    return sampling_times(t, angles)


def _measured_at(
    rows: NDArray[np.float64],
    sampled: NDArray[np.float64],
    values: NDArray[np.float64],
    delay: float,
    *,
    shift: bool,
) -> NDArray[np.float64]:
    """Return what a sensor will have reported `delay` after the rows' times (linear in between)."""
    if not (shift or delay):
        return values
    first = new_messages(sampled) if shift else slice(None)
    return np.interp(rows + delay, sampled[first], values[first])


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
        if place == 2:
            values = np.unwrap(values)
        angles[:, place] = _measured_at(rows, sampled, values, source.delay, shift=shift)
    turned = from_roll_pitch_yaw(angles, turn=attitude.turn)
    return dict(zip(_ATTITUDE_NAMES, turned.T, strict=True))


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
        acting = motors.drive.acting(_scaled(f"u{i}", source, table))
        columns[f"u{i}"] = (
            _mean_acting(t, rows, acting, source.delay) if even else _acting_at(t, acting, source.delay)
        )
    return columns


def _acting_at(t: NDArray[np.float64], values: NDArray[np.float64], delay: float) -> NDArray[np.float64]:
    """Return the command that acts at t: the last one logged at t - delay or before."""
    if not delay:
        return values
    latest = np.searchsorted(t, t - delay + _ROUNDING, side="right") - 1
    return values[np.maximum(latest, 0)]


def _mean_acting(
    t: NDArray[np.float64], rows: NDArray[np.float64], values: NDArray[np.float64], delay: float
) -> NDArray[np.float64]:
    """Return the mean of the command that acts from each row to the next."""
    impulse = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(t))))
    step = rows[1] - rows[0] if len(rows) > 1 else 1.0
    edges = np.append(rows, rows[-1] + step) - delay
    return np.diff(np.interp(edges, t, impulse)) / step


def _delays(mapping: LogMapping) -> tuple[list[float], list[float]]:
    """Return the delays of what is measured and of what is commanded."""
    mark_missing = [source.delay for source in mapping.columns.values()]
    mark_missing += [source.delay for source in mapping.attitude.sources] if mapping.attitude else []
    return mark_missing, [source.delay for source in mapping.motors.sources] if mapping.motors else []


def _cut(
    columns: Columns, t: NDArray[np.float64], mark_missing: list[float], commanded: list[float]
) -> Columns:
    """Return the rows for which every delayed column had a value in the file, whose times are t."""
    rows = columns["t"]
    ahead = [*mark_missing, *(-delay for delay in commanded)]
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
