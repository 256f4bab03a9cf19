"""What a log shows at even times: the robot's pose, the ball's rotation, the wheels, friction, signals to plot.

    Omega = (-y_dot, x_dot, 0) / r_b,    q_(k+1) = exp(Omega dt) q_k,    wheel speeds = T_owb (R^T Omega - w)

The ball's rotation is not in a log; it is integrated from the position, of a ball that rolls without slip and does not
pivot. Wheel angles come from the encoders, else from that rolling.

A log with more rows than a picture a fiftieth of a second is thinned: angles and positions are interpolated, and of a
torque the least and the greatest value in each interval are kept, so that no peak is lost.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.checks.kinematics import other_wheels
from ballbot.log.columns import (
    POSITION_NAMES,
    STATE_NAMES,
    TRUE_PREFIX,
    torque_names,
    wheel_angle_names,
    wheel_speed_names,
)
from ballbot.log.pose import with_position
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot

#: least time between pictures, and the longest log [s]
INTERVAL, LONGEST = 0.02, 600.0
_QUATERNION = ("ball_w", "ball_x", "ball_y", "ball_z")

Columns = dict[str, Floats]


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A time series to plot."""

    name: str
    short: str  #: in a line with others
    unit: str
    columns: tuple[str, ...]  #: one, or the least and the greatest value in each interval


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplayMotion:
    """A log for the replay: rows at even times from the log's start."""

    interval: float  #: [s]
    columns: Columns  #: (K,) by name, SI units except where a signal says otherwise
    signals: tuple[Signal, ...]
    notes: tuple[str, ...]  #: where the motion comes from, in sentences

    @property
    def rows(self) -> int:
        """Number of rows, K."""
        return len(self.columns["x"])


def robot_at_rest(robot: Robot) -> ReplayMotion:
    """Return the motion of a robot that stands upright: one row."""
    zero, unit = np.zeros(1), np.ones(1)
    columns = dict.fromkeys((*POSITION_NAMES, *wheel_angle_names(robot.wheel_count), *_QUATERNION[1:]), zero)
    notes = ("The robot stands upright; no log is shown.", BODY_NOTE)
    return ReplayMotion(interval=INTERVAL, columns=columns | {"ball_w": unit}, signals=(), notes=notes)


BODY_NOTE = (
    "A robot file does not describe the body's shape: its width and height are those of two discs with its mass and "
    "inertia."
)


def motion_of(
    # with theta, phi and psi, and with x and y or what gives them (`ballbot.log.pose.with_position`). True states of a
    # simulated run come before the measured ones.
    log: Log,
    robot: Robot,  # its geometry, and its friction if the log has wheel speeds
) -> ReplayMotion:
    """Return what a log of a balancing robot shows.

    InputError if a column is missing or empty, the log is longer than `LONGEST`, or has another number of wheels.
    """
    _check(log, robot)
    log, notes = _posed(log, robot)
    times, interval = _times(log)
    rolling = _rolling_rates(log, robot)
    ball, (wheels, source) = (
        integrated_rotation(_integrated(log, rolling)),
        _wheel_angles(log, robot, rolling),
    )
    notes += [
        "The ball rolls along the position, without slip or pivoting.",
        f"Wheel angles: {source}.",
        BODY_NOTE,
    ]
    columns = {name: _between(times, log.t, log[name]) for name in ("x", "y", "theta", "phi")}
    columns["psi"] = _between(times, log.t, log["psi"])
    columns |= dict(zip(wheel_angle_names(robot.wheel_count), _rows_at(times, log.t, wheels).T, strict=True))
    columns |= dict(zip(_QUATERNION, _rows_at(times, log.t, ball).T, strict=True))
    columns |= _references(log, times)
    forces, signals = _forces(log, robot, times, interval, notes)
    columns |= forces
    plotted, others = _signals(log, columns, times)
    return ReplayMotion(
        interval=interval, columns=columns | plotted, signals=(*others, *signals), notes=tuple(notes)
    )


def _check(log: Log, robot: Robot) -> None:
    span = float(log.t[-1] - log.t[0])
    if span > LONGEST:
        raise InputError(
            f"The log is {span:.4g} s long; a replay shows at most {LONGEST:g} s. Choose a part with --start and --end."
        )
    if others := other_wheels(log, robot.wheel_count):
        raise InputError(f"{others[0].text.removesuffix('.')} with --robot.")


def _posed(log: Log, robot: Robot) -> tuple[Log, list[str]]:
    """Return the log with the states to show, and sentences on them."""
    if all(
        TRUE_PREFIX + name in log and np.isfinite(log[TRUE_PREFIX + name]).any() for name in POSITION_NAMES
    ):
        true = {name: log[TRUE_PREFIX + name] for name in STATE_NAMES if TRUE_PREFIX + name in log}
        note = "The pose is the simulation's true one, not the estimate that the controller used."
        return log.with_columns(true), [note]
    missing = [name for name in ("theta", "phi", "psi") if name not in log]
    if missing:
        raise InputError(
            f"The log has no {' and no '.join(missing)}, without which there is no pose to show. `ballbot check-log` "
            "shows what the log has."
        )
    by_wheels = "x" not in log
    log = with_position(log, robot)
    empty = [name for name in POSITION_NAMES if name not in log or not np.isfinite(log[name]).any()]
    if empty:
        raise InputError(
            f"The log has no values of {' and '.join(empty)}, without which there is no pose to show."
        )
    gaps = [name for name in POSITION_NAMES if not np.isfinite(log[name]).all()]
    notes = (
        ["Position: computed from the wheels' speeds."] if by_wheels else ["Pose: as measured in the log."]
    )
    if gaps:
        notes.append(f"Missing values of {', '.join(gaps)} are interpolated.")
    return log, notes


def _times(log: Log) -> tuple[Floats, float]:
    """Return the times to show (K,), from the log's first to its last, and their interval [s]."""
    span = float(log.t[-1] - log.t[0])
    if len(log) < 2:
        return log.t[:1].copy(), INTERVAL
    steps = max(1, round(span / max(INTERVAL, log.sample_time)))
    return log.t[0] + span / steps * np.arange(steps + 1), span / steps


def _between(times: Floats, t: Floats, values: Floats) -> Floats:
    """Return values at other times, on lines between those that are known."""
    known = np.isfinite(values)
    return np.interp(times, t[known], values[known])


def _rows_at(times: Floats, t: Floats, table: Floats) -> Floats:
    return np.column_stack([_between(times, t, column) for column in table.T])


def _has(log: Log, names: Sequence[str]) -> bool:
    """Return whether the log has columns with a value in every row."""
    return all(name in log and bool(np.isfinite(log[name]).all()) for name in names)


def _attitude(log: Log) -> Floats:
    """Return theta, phi and psi (N, 3) in every row."""
    angles = (log["theta"], log["phi"], log["psi"])
    return np.column_stack([_between(log.t, log.t, angle) for angle in angles])


def _body_rates(log: Log) -> Floats:
    """Return the body's angular velocity w (N, 3), body frame, from the angles' differences."""
    angles = _attitude(log)
    rates = np.gradient(angles, log.t, axis=0) if len(log) > 1 else np.zeros_like(angles)
    return np.einsum("nij,nj->ni", body_rates_matrix(*angles.T), rates)


def _rolling_rates(log: Log, robot: Robot) -> Floats:
    """Return the angular velocity Omega (N, 3) of a ball that rolls along the log's position, world frame."""
    if len(log) < 2:
        return np.zeros((len(log), 3))
    x, y = (_between(log.t, log.t, log[name]) for name in ("x", "y"))
    x_dot, y_dot = np.gradient(x, log.t), np.gradient(y, log.t)
    return np.column_stack((-y_dot, x_dot, np.zeros(len(log)))) / robot.ball.radius


def _integrated(log: Log, rates: Floats) -> Floats:
    """Return what rates (N, k) add up to from row to row (N - 1, k), by the trapezoidal rule."""
    return 0.5 * (rates[1:] + rates[:-1]) * np.diff(log.t)[:, None]


#: w, x, y, z
Quaternion = Sequence[float]


def quaternion_product(second: Quaternion, first: Quaternion) -> Quaternion:
    """Return the rotation that is one rotation, after another that comes first."""
    (a, b, c, d), (w, x, y, z) = second, first
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def integrated_rotation(
    turns: Floats,  # (n, 3) Rotation vectors [rad] in the world frame
    *,
    # (4,) Orientation before them, without rotation by default
    first: Sequence[float] | Floats = (1.0, 0.0, 0.0, 0.0),
) -> Floats:
    """Return the orientations after small turns, one after the other.

    Returns
    -------
    ndarray (n + 1, 4)
        Unit quaternions wxyz, each next to its predecessor in sign.
    """
    angle = np.linalg.norm(turns, axis=1)
    half_sine = 0.5 * np.sinc(angle / (2.0 * math.pi))  # sin(angle / 2) / angle, also at zero
    steps = np.column_stack((np.cos(angle / 2.0), half_sine[:, None] * turns)).tolist()
    orientation: Quaternion = tuple(float(part) for part in first)
    orientations: list[Quaternion] = [orientation]
    for step in steps:  # the turn is in the world frame
        orientation = quaternion_product(step, orientation)
        orientations.append(orientation)
    quaternions = np.array(orientations)
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
    return quaternions * np.concatenate(([1.0], np.cumprod(np.where(flips, -1.0, 1.0))))[:, None]


def _wheel_angles(log: Log, robot: Robot, rolling: Floats) -> tuple[Floats, str]:
    """Return the wheels' angles (N, n) from the log's start, and their source; `rolling` is that of the ball (N, 3)."""
    names = wheel_angle_names(robot.wheel_count)
    if _has(log, names):
        table = np.column_stack([log[name] for name in names])
        return table - table[0], "the encoders"
    z = np.einsum("nji,nj->ni", rotation(*_attitude(log).T), rolling)
    steps = _integrated(log, (z - _body_rates(log)) @ transforms(robot).T_owb.T)
    return np.concatenate((np.zeros((1, robot.wheel_count)), np.cumsum(steps, axis=0))), "from the position"


def _references(log: Log, times: Floats) -> Columns:
    """Return the reference's position and heading, as far as the log has them; empty without the position."""
    names = ("ref_x", "ref_y", "ref_psi")
    known = [name for name in names if name in log and np.isfinite(log[name]).any()]
    return {name: _between(times, log.t, log[name]) for name in known} if known[:2] == [*names[:2]] else {}


def _forces(
    log: Log, robot: Robot, times: Floats, interval: float, notes: list[str]
) -> tuple[Columns, list[Signal]]:
    """Return torques and friction as columns, and the signals of torques and wheel speeds."""
    columns: Columns = {}
    signals = []
    torques, speeds = torque_names(robot.wheel_count), wheel_speed_names(robot.wheel_count)
    if _has(log, torques):
        sizes = np.max([np.abs(log[name]) for name in torques], axis=0)
        columns["torque_low"], columns["torque_high"] = _extremes(times, interval, log.t, sizes)
        signals.append(_banded("largest wheel torque", "torque", "N m", "torque"))
        for number, name in enumerate(torques, start=1):
            columns[f"{name}_low"], columns[f"{name}_high"] = _extremes(times, interval, log.t, log[name])
            signals.append(_banded(f"torque of wheel {number}", f"u{number}", "N m", name))
    if not _has(log, speeds):
        return columns, signals
    rates = np.column_stack([log[name] for name in speeds])
    for number, name in enumerate(speeds, start=1):
        columns[name] = _between(times, log.t, log[name])
        signal = Signal(name=f"speed of wheel {number}", short=f"w{number}", unit="rad/s", columns=(name,))
        signals.append(signal)
    columns |= _friction(log, robot, rates, times)
    known = "friction1" in columns
    notes.append(
        "Friction arrows: the robot file's friction at the log's wheel speeds."
        if known
        else f"No friction arrows: the robot {robot.name!r} has no friction in its file."
    )
    return columns, signals


def _banded(name: str, short: str, unit: str, column: str) -> Signal:
    return Signal(name=name, short=short, unit=unit, columns=(f"{column}_low", f"{column}_high"))


def _friction(log: Log, robot: Robot, rates: Floats, times: Floats) -> Columns:
    """Return the friction of each wheel [N m] and of the floor on the ball [N], if the robot file has any."""
    if not any((*robot.friction.viscous, *robot.friction.breakaway, robot.friction.rolling)):
        return {}
    from ballbot.mechanics.floor import rolling_friction  # with compiled code, which other robots do without
    from ballbot.mechanics.friction import wheel_friction

    names = torque_names(robot.wheel_count)
    torques = np.column_stack([log[name] for name in names]) if _has(log, names) else None
    friction = wheel_friction(rates, robot.friction, torque=torques)
    columns = {f"friction{i + 1}": _between(times, log.t, values) for i, values in enumerate(friction.T)}
    velocity = _rolling_rates(log, robot)[:, [1, 0]] * robot.ball.radius * (1.0, -1.0)
    # below the speed of a millimetre a second the differences of a measured position are mostly noise
    force = rolling_friction(velocity, robot.rolling_force, slowest=1e-3)
    return columns | {
        f"floor_{axis}": _between(times, log.t, part) for axis, part in zip("xy", force.T, strict=True)
    }


def _extremes(times: Floats, interval: float, t: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest of the values that hold within each interval from the times on."""
    last = len(t) - 1
    first = np.clip(np.searchsorted(t, times + 1e-9 * interval, side="right") - 1, 0, last)
    end = np.maximum(np.searchsorted(t, times + (1.0 - 1e-6) * interval), first + 1)
    most = int((end - first).max())
    rows = np.minimum(first[:, None] + np.arange(most), (end - 1)[:, None])
    return values[rows].min(axis=1), values[rows].max(axis=1)


def _signals(log: Log, columns: Columns, times: Floats) -> tuple[Columns, list[Signal]]:
    """Return the signals that follow from the pose: distance, lean, heading, speed."""
    derived: Columns = {}
    signals = []

    def add(name: str, short: str, unit: str, column: str, values: Floats) -> None:
        derived[column] = values
        signals.append(Signal(name=name, short=short, unit=unit, columns=(column,)))

    if "ref_x" in columns:
        distance = np.hypot(columns["x"] - columns["ref_x"], columns["y"] - columns["ref_y"])
        add("distance from the reference", "off by", "mm", "distance", 1000.0 * distance)
    upright = np.cos(columns["theta"]) * np.cos(columns["phi"])
    add("lean", "lean", "°", "lean", np.degrees(np.arccos(np.clip(upright, -1.0, 1.0))))
    add("heading", "heading", "°", "heading", np.degrees(columns["psi"]))
    if "ref_psi" in columns:
        error = np.degrees(columns["psi"] - columns["ref_psi"])
        add("heading error", "heading off by", "°", "heading_error", error)
    if all(name in log and np.isfinite(log[name]).any() for name in ("x_dot", "y_dot")):
        x_dot, y_dot = (_between(times, log.t, log[name]) for name in ("x_dot", "y_dot"))
        add("speed", "speed", "m/s", "speed", np.hypot(x_dot, y_dot))
    return derived, signals
