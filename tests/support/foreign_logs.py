"""Logs as other teams write them, made from recorded ones whose truth is known: names, units, signs, order, delays.

A `Habits` value says how a team writes its logs (`campaigns.mapping_corpus` draws it from a seed), and makes the file's
columns from a log. The IMU is turned about the vertical, may have a reversed axis, and its roll and pitch may be tilts
that do not turn with the heading; the wheels are permuted, with signs of their own; sensors and commands are late; the
commands are torques, currents or duties.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.io
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.log import STATE_NAMES, Log
from ballbot.log.mapping_search.commands import assumed_resistance
from ballbot.robot import Robot

Floats = NDArray[np.float64]

Columns = dict[str, Floats]
Layout = Literal[
    "comma", "semicolon", "tab", "blanks", "decimal_comma", "json", "mat", "no_header", "given_columns"
]
Command = Literal["torque", "current", "duty", "voltage"]


@dataclass(frozen=True, kw_only=True)
class Names:
    """A team's names; braces are a number from `first`, an axis, or a unit."""

    time: str
    lean: tuple[str, str, str]
    gyro: str
    angle: str
    command: str  #: with the kind of command in {kind}
    units: bool  #: whether names have units
    first: int = 1


STYLES = tuple(
    Names(
        time=time,
        lean=(lean[0], lean[1], lean[2]),
        gyro=gyro,
        angle=angle,
        command=command,
        units=units == "units",
        first=0 if "[" in angle else 1,
    )
    for time, *lean, gyro, angle, command, units in map(
        str.split,
        (
            "t_now theta_x theta_y theta_z gyro_{} psi_{} u{} -",
            "Timestamp Roll Pitch Yaw Gyro{} Enc{} Motor{}_{kind} units",
            "time roll pitch yaw g{} enc_{} {kind}{} units",
            "t roll pitch yaw w{} wheel{} cmd_{} -",
            "stamp imu.roll imu.pitch imu.yaw imu.gyro.{} motor[{}].position motor[{}].{kind} -",
            "Time ImuRoll ImuPitch ImuYaw ImuGyro{} q{} tau_{} units",
        ),
    )
)
#: interval of the rows of a host that polls a robot [s]
POLLED = 0.0115
#: what a style's unit is called at the end of a name
SPELLED = {"deg/s": "dps", "rad/s": "rad_s", "N m": "Nm", "mN m": "mNm", "%": "pct"}


@dataclass(frozen=True, kw_only=True)
class Habits:
    """How a team writes its logs."""

    start: float  #: of the stretch [s]
    duration: float
    names: Names = STYLES[0]
    layout: Layout = "comma"
    time_unit: str = "s"
    time_offset: float = 0.0  #: [s]
    order: tuple[int, ...] = (0, 1, 2)  #: the file's wheels in turn are these of the robot (from 0)
    signs: tuple[int, ...] = (1, 1, 1)  #: of the file's wheels
    command_order: tuple[int, ...] = ()
    command_signs: tuple[int, ...] = (1, 1, 1)
    turn: float = 0.0  #: of the IMU's x axis from the robot's [rad]
    pitch_sign: int = 1
    yaw_sign: int = 1
    swapped: bool = False  #: whether roll and pitch are exchanged
    lean_unit: str = "rad"
    wheel_unit: str = "rad"
    gyro_unit: str | None = None  #: None without a gyro
    yaw: bool = True
    #: whether roll and pitch are tilts that do not turn with the heading (XYZ), not those that do (ZYX)
    tilts: bool = False
    command: Command = "torque"
    command_unit: str = ""
    command_scale: float = 1.0  #: the file's number for 1 N m, A, V or full duty
    sensor_delay: float = 0.0
    command_delay: float = 0.0
    noise: float = 0.0  #: of the angles [rad]
    interval: float = 0.0  #: of the rows [s]; 0 keeps the log's
    #: interval [s] of the messages of which a row has the latest; 0 if it has the values of its own time
    messages: float = 0.0
    extras: bool = False
    seed: int = 1


def columns_of(log: Log, habits: Habits, robot: Robot, *, dead_band: float) -> Columns:
    """Return the file's columns of the stretch of a log."""
    part = log.between(habits.start, habits.start + habits.duration)
    random = np.random.default_rng([17, habits.seed])
    t = row_times(part, habits)
    table: Columns = {_name(habits.names.time, habits.time_unit, habits): _time(t, habits)}
    table |= _inertial(part, t, habits, random)
    table |= _wheels(part, t, habits, robot)
    table |= _commands(part, t, habits, robot, dead_band=dead_band)
    if habits.extras:
        table |= _extras(t, random)
    if habits.layout in ("no_header", "given_columns"):
        return table
    names = list(table)
    if habits.seed % 3 == 0:
        names = [names[0], *random.permutation(names[1:]).tolist()]
    return {name: table[name] for name in names}


def row_times(part: Log, habits: Habits) -> Floats:
    """Return when the file's rows of a stretch of a log are written [s]."""
    if not habits.interval:
        return part.t[8:-8]
    t = np.arange(part.t[0] + 0.03, part.t[-1] - 0.03, habits.interval)
    if habits.interval == POLLED:
        return t + 2e-4 * np.random.default_rng([18, habits.seed]).standard_normal(len(t))
    return t


def _sent(t: Floats, habits: Habits) -> Floats:
    """Return when the sensors of rows at times t were read [s]."""
    return habits.messages * np.floor(t / habits.messages) if habits.messages else t


def _time(t: Floats, habits: Habits) -> Floats:
    factor = {"s": 1.0, "ms": 1e3, "us": 1e6}[habits.time_unit]
    values = (t + habits.time_offset) * factor
    return np.round(values) if habits.time_unit == "us" else np.round(values, 6)


def _name(stem: str, unit: str, habits: Habits) -> str:
    if not habits.names.units or not unit or unit == "turn":
        return stem
    return f"{stem}_{SPELLED.get(unit, unit)}"


def _at(times: Floats, log: Log, values: Floats) -> Floats:
    return np.column_stack([np.interp(times, log.t, column) for column in values.T])


def _inertial(part: Log, t: Floats, habits: Habits, random: np.random.Generator) -> Columns:
    states = np.column_stack([part[name] for name in STATE_NAMES])
    imu = Rotation.from_euler("XYZ", states[:, 2:5]) * Rotation.from_euler("z", habits.turn)
    roll, pitch, yaw = imu.as_euler("XYZ").T if habits.tilts else imu.as_euler("ZYX").T[::-1]
    signs, order = (
        np.array([1, habits.pitch_sign, habits.yaw_sign]),
        [1, 0, 2] if habits.swapped else [0, 1, 2],
    )
    read = _sent(t, habits) - habits.sensor_delay
    angles = _at(read, part, np.column_stack([roll, pitch, np.unwrap(yaw)])) * signs
    angles[:, :2] += habits.noise * random.standard_normal((len(t), 2))
    angles = angles[:, order]
    lean = np.degrees(angles) if habits.lean_unit == "deg" else angles
    columns = {
        _name(name, habits.lean_unit, habits): lean[:, axis]
        for axis, name in enumerate(habits.names.lean)
        if axis < 2 or habits.yaw
    }
    if habits.gyro_unit is not None and habits.layout != "no_header":
        c, s = np.cos(habits.turn), np.sin(habits.turn)
        x, y, z = part["gyro_x"], part["gyro_y"], part["gyro_z"]
        rates = (_at(read, part, np.column_stack([c * x + s * y, c * y - s * x, z])) * signs)[:, order]
        turned = np.degrees(rates) if habits.gyro_unit == "deg/s" else rates
        axes = "XYZ" if habits.names.gyro[0].isupper() else "xyz"
        stem = habits.names.gyro
        columns |= {_name(stem.format(axes[k]), habits.gyro_unit, habits): turned[:, k] for k in range(3)}
    return columns


def _wheels(part: Log, t: Floats, habits: Habits, robot: Robot) -> Columns:
    turn = robot.sensors.encoder_counts * robot.drive.gear_ratio
    angles = _at(_sent(t, habits), part, part.wheel_angles)[:, list(habits.order)] * np.asarray(habits.signs)
    counts = np.round(angles * turn / (2.0 * np.pi))
    scale = {"counts": 1.0, "rad": 2.0 * np.pi / turn, "deg": 360.0 / turn, "turn": 1.0 / turn}[
        habits.wheel_unit
    ]
    n, first = counts.shape[1], habits.names.first
    unit = habits.wheel_unit
    return {_name(habits.names.angle.format(k + first), unit, habits): counts[:, k] * scale for k in range(n)}


def _commands(part: Log, t: Floats, habits: Habits, robot: Robot, *, dead_band: float) -> Columns:
    # held, as the log has them
    latest = np.searchsorted(part.t, t + habits.command_delay + 1e-9, side="right") - 1
    u = commands(robot, part.torques, part.wheel_speeds, habits.command)
    if habits.command == "duty" and dead_band:
        u = np.sign(u) * np.maximum(np.abs(u) - dead_band, 1e-6)
    order = habits.command_order or habits.order
    u = (
        u[np.clip(latest, 0, len(u) - 1)][:, list(order)]
        * np.asarray(habits.command_signs)
        * habits.command_scale
    )
    if habits.command == "duty" and habits.command_scale > 1.0:
        u = np.round(u) if habits.command_scale != 100.0 else np.round(u, 2)
    n, first = u.shape[1], habits.names.first
    stem = habits.names.command
    kind = {"duty": "pwm"}.get(habits.command, habits.command)
    if stem == "tau_{}" and habits.command != "torque":
        stem = "{kind}_{}"
    named = [stem.replace("{kind}", kind).format(k + first) for k in range(n)]
    return {_name(name, habits.command_unit, habits): u[:, k] for k, name in enumerate(named)}


def commands(robot: Robot, torques: Floats, speeds: Floats, kind: Command) -> Floats:
    """Return torques [N m], currents [A], voltages [V] or duties (N, n) behind torques at wheel speeds [rad/s]."""
    drive = robot.drive
    current = torques / (drive.gear_ratio * drive.torque_constant)
    if kind in ("torque", "current"):
        return torques if kind == "torque" else current
    voltage = current * assumed_resistance(drive) + drive.gear_ratio * speeds / drive.speed_constant
    return voltage if kind == "voltage" else voltage / drive.supply_voltage


def _extras(t: Floats, random: np.random.Generator) -> Columns:
    return {
        "loop_count": np.arange(len(t), dtype=np.float64),
        "battery_V": 12.0 - 1e-3 * (t - t[0]) + 0.01 * random.standard_normal(len(t)),
        "ref_x": 0.3 * np.sin(0.5 * t),
        "target_roll": 0.01 * np.sin(2.0 * t),
        "error_pitch": 0.01 * random.standard_normal(len(t)),
    }


def write(path: Path, columns: Columns, habits: Habits) -> tuple[Path, list[str] | None]:
    """Write the file, its suffix by the layout; return it and what the user gives as --columns, or None."""
    names, table = list(columns), np.column_stack(list(columns.values()))
    if habits.layout == "json":
        rows = [dict(zip(names, row, strict=True)) for row in table.tolist()]
        path = path.with_suffix(".json")
        path.write_text(json.dumps(rows if habits.seed % 2 else {n: c.tolist() for n, c in columns.items()}))
        return path, None
    if habits.layout == "mat" and all(name.isidentifier() for name in names):
        path = path.with_suffix(".mat")
        scipy.io.savemat(path, {name: values[:, None] for name, values in columns.items()})
        return path, None
    mark = {"semicolon": ";", "tab": "\t", "blanks": " ", "decimal_comma": ";"}.get(habits.layout, ",")
    lines = [mark.join(f"{value:.10g}" for value in row) for row in table.tolist()]
    if habits.layout == "decimal_comma":
        lines = [line.replace(".", ",") for line in lines]
    if habits.layout not in ("no_header", "given_columns"):
        lines.insert(0, mark.join(names))
    path = path.with_suffix(".txt")
    path.write_text("\n".join(lines) + "\n")
    return path, names if habits.layout in ("no_header", "given_columns") else None
