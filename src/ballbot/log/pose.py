"""Position, wheel speeds and poses from a log: odometry, motion capture.

    z = T_obw wheel speeds + w,    Omega = R z,    v = r_b (Omega_y, -Omega_x),    wheel speeds = T_owb (z - w)

(Appendix V of the thesis.) The ball rolls without slip; pivoting under the robot does not move it. If no sensor
measures the heading, it is computed from the wheels, for a ball that does not spin about the vertical n:

    n . z = 0,    yaw rate = -n . (T_obw wheel speeds + w_0)

with w_0 the body's angular velocity at a heading that stays zero. Logs of motion capture have t, x y z of a point and
qw qx qy qz of a body, with NaN while the cameras do not see it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError, about
from ballbot.log.clock import clock_findings, clock_unit
from ballbot.log.columns import ATTITUDE_NAMES, STATE_NAMES, unit_of, wheel_angle_names, wheel_speed_names
from ballbot.log.formats import read_foreign_table
from ballbot.log.formats.text import ForeignTable
from ballbot.log.imu_angles import body_motion, integral_of
from ballbot.log.log import Log
from ballbot.log.mapping import ColumnTable, LogMapping
from ballbot.log.mapping_search.names import marked_series, quaternions, roles_by_name, stated_unit
from ballbot.robot import Robot
from ballbot.summary import counted

_LEAN = ("theta", "phi", "theta_dot", "phi_dot")
_HEADING = ("psi", "psi_dot")


def wheel_speeds_of_states(states: Floats, robot: Robot) -> Floats:
    """Return the wheel speeds (N, n) [rad/s] that an encoder sees at the states (N, 10), rolling without slip."""
    from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms

    theta, phi, psi = states[:, 2], states[:, 3], states[:, 4]
    x_dot, y_dot = states[:, 5], states[:, 6]
    Omega = np.column_stack([-y_dot, x_dot, np.zeros_like(x_dot)]) / robot.ball.radius
    z = np.einsum("nji,nj->ni", rotation(theta, phi, psi), Omega)
    w = np.einsum("nij,nj->ni", body_rates_matrix(theta, phi, psi), states[:, 7:10])
    return (z - w) @ transforms(robot).T_owb.T


def measured_wheel_speeds(log: Log, robot: Robot) -> Floats:
    """Return the wheel speeds (N, n) [rad/s]: the encoders', or those of the states where these are missing."""
    names = wheel_speed_names(robot.wheel_count)
    logged = set(names) <= set(log.names)
    speeds = np.column_stack([log[name] if logged else np.full(len(log), np.nan) for name in names])
    if np.isfinite(speeds).all():
        return speeds
    zero = np.zeros(len(log))  # the position does not matter
    states = np.column_stack([zero, zero, *(log[name] for name in STATE_NAMES[2:])])
    return np.where(np.isfinite(speeds), speeds, wheel_speeds_of_states(states, robot))


def with_odometry(log: Log, robot: Robot) -> Log:
    """Return the rows of a log that have wheel speeds and attitude, with x, y [m] and x_dot, y_dot [m/s] from them.

    The log needs theta, phi, their rates and every wheel's speed, and psi and its rate or neither. Without these, theta
    and phi are those of a heading that stays zero, and the heading is computed from the wheels. InputError if a column
    is missing, or no row has a value in all of them.
    """
    names = wheel_speed_names(robot.wheel_count)
    heading = _HEADING if any(name in log for name in _HEADING) else ()
    log = log.complete(*_LEAN, *heading, *names)
    if "psi" not in log:
        log = _with_heading(log, robot)
    x_dot, y_dot = _ball_velocity(log, robot, np.column_stack([log[name] for name in names])).T
    x, y = integral_of(log.t, x_dot), integral_of(log.t, y_dot)
    return log.with_columns({"x": x, "y": y, "x_dot": x_dot, "y_dot": y_dot})


def ball_rates(log: Log, robot: Robot, wheel_speeds: Floats) -> Floats:
    """Return Omega (N, 3) [rad/s] of the ball, world frame, from wheel speeds (N, n) [rad/s] and a log's attitude."""
    from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms

    angles, rates = (np.column_stack([log[n + end] for n in ATTITUDE_NAMES]) for end in ("", "_dot"))
    w = np.einsum("nij,nj->ni", body_rates_matrix(*angles.T), rates)
    z = wheel_speeds @ transforms(robot).T_obw.T + w
    return np.einsum("nij,nj->ni", rotation(*angles.T), z)


def _ball_velocity(log: Log, robot: Robot, wheel_speeds: Floats) -> Floats:
    """Return v (N, 2) [m/s] of a ball that rolls so; see `ball_rates`."""
    Omega = ball_rates(log, robot, wheel_speeds)
    return robot.ball.radius * np.column_stack([Omega[:, 1], -Omega[:, 0]])


#: two velocities or paths whose difference is a smaller share of either are equal but for the digits of a file
_SAME = 2e-3


def without_encoder_lag(log: Log, robot: Robot) -> Log:
    """Return the log with the lag of its wheel speeds removed, and the ball's velocity and position that follow.

    Firmware computes a speed from the encoder's counts over the last samples, and may filter it. The speeds are then
    half a sample or more late, and so are the ball's velocity and position that the robot computes from them; the
    body's rates are not. At 200 Hz half a sample changes friction's parameters by up to 1.4 standard errors
    (`campaigns.coverage`). `encoder_lag` estimates the lag from the angles.

    A log is returned unchanged if it lacks a wheel's angle or speed or a state, if its velocity is not that of its
    wheel speeds (as a Kalman filter's), or if its speeds are not late. A position that is not the integral of its
    velocity stays.
    """
    names = wheel_speed_names(robot.wheel_count)
    needed = {*STATE_NAMES, *wheel_angle_names(robot.wheel_count), *names}
    if len(log) < 2 * _APART or not needed <= set(log.names):
        return log
    speeds, velocity = (np.column_stack([log[n] for n in columns]) for columns in (names, ("x_dot", "y_dot")))
    if not _alike(_ball_velocity(log, robot, speeds), velocity):
        return log
    lag = encoder_lag(log, robot)
    if lag == 0.0:
        return log
    at_rows = np.column_stack([np.interp(log.t + lag, log.t, speed) for speed in speeds.T])
    velocity_at_rows = _ball_velocity(log, robot, at_rows)
    columns = dict(zip((*names, "x_dot", "y_dot"), (*at_rows.T, *velocity_at_rows.T), strict=True))
    steps, position = _steps(log), np.column_stack([log["x"], log["y"]])
    moved = np.diff(position, axis=0)
    means = (velocity[1:], 0.5 * (velocity[1:] + velocity[:-1]))
    if any(_alike(_summed(steps * mean), _summed(moved)) for mean in means):
        correction = 0.5 * steps * (velocity_at_rows[1:] + velocity_at_rows[:-1]) - moved
        position[1:] += np.cumsum(np.nan_to_num(correction, posinf=0.0, neginf=0.0), axis=0)  # NaN at gaps
        columns |= {"x": position[:, 0], "y": position[:, 1]}
    return log.with_columns(columns)


#: rows over which the changes of angles and the sums of speeds are compared, and the largest plausible lag [s]
_APART, _LARGEST_LAG = 10, 0.05


def encoder_lag(log: Log, robot: Robot) -> float:
    """Return the lag of the wheels' speeds behind their angles [s]; 0 if the log shows none.

    A speed that is late by e is the angle's rate at t - e: over some rows, the angle changes by e times the change of
    speed more than the integral of the speeds. Least squares over all wheels; only the angles have the counts' noise. A
    lag that leaves more than half of the squares does not explain them.
    """
    names = wheel_angle_names(robot.wheel_count)
    angles, speeds = (np.column_stack([log[name + end] for name in names]) for end in ("", "_dot"))
    ahead = _summed(np.diff(angles, axis=0) - 0.5 * _steps(log) * (speeds[1:] + speeds[:-1]))
    change = speeds[_APART:] - speeds[:-_APART]
    known = np.isfinite(ahead) & np.isfinite(change)
    ahead, change = ahead[known], change[known]
    size = float((change**2).sum())
    lag = float((ahead * change).sum()) / size if size > 0.0 else 0.0
    explained = ((ahead - lag * change) ** 2).sum() <= 0.5 * (ahead**2).sum()
    return lag if explained and abs(lag) <= _LARGEST_LAG else 0.0


def _steps(log: Log) -> Floats:
    """Return the intervals (N - 1, 1) between rows [s]; NaN where rows are missing."""
    steps = np.diff(log.t)[:, None]
    return np.where(steps > 1.5 * log.sample_time, np.nan, steps)


def _summed(values: Floats) -> Floats:
    """Return the sums over `_APART` rows of (N, c), from each row on."""
    return np.lib.stride_tricks.sliding_window_view(values, _APART, axis=0).sum(axis=-1)


def _alike(first: Floats, second: Floats) -> bool:
    """Return whether two signals are equal but for rounding; False if they have no row in common."""
    squares = (first - second) ** 2
    known = np.isfinite(squares)
    return bool(known.any() and squares[known].sum() <= _SAME**2 * (second**2)[known].sum())


def _with_heading(log: Log, robot: Robot) -> Log:
    """Return the log with the heading and its rate from the wheels, and theta and phi about the world's axes."""
    from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms

    theta, phi, theta_dot, phi_dot = (log[name] for name in _LEAN)
    # the third angle at which the yaw is zero
    across = rotation(theta, phi, 0.0)[:, 1]
    third = np.arctan2(-across[:, 0], across[:, 1])
    R = rotation(theta, phi, third)
    changing = np.gradient(third, log.t) if len(log) > 1 else np.zeros(1)
    rates = np.column_stack([theta_dot, phi_dot, changing])
    w = np.einsum("nij,nj->ni", body_rates_matrix(theta, phi, third), rates)
    wheels = np.column_stack([log[name] for name in wheel_speed_names(robot.wheel_count)])
    vertical = R[:, 2]
    yaw_rate = -np.sum(vertical * (wheels @ transforms(robot).T_obw.T + w), axis=1)
    roll, pitch = np.arctan2(vertical[:, 1], vertical[:, 2]), -np.arcsin(np.clip(vertical[:, 0], -1.0, 1.0))
    imu = roll, pitch, integral_of(log.t, yaw_rate)
    motion = body_motion(log.t, imu, w + yaw_rate[:, None] * vertical, turn=0.0)
    return log.with_columns({name: motion[name] for name in (*_LEAN, *_HEADING)})


def with_position(log: Log, robot: Robot) -> Log:
    """Return the log itself if it has x, else with the position, and a missing heading, by `with_odometry`."""
    return log if "x" in log else with_odometry(log, robot)


def with_rates(log: Log, robot: Robot) -> Log:
    """Return the log with the missing rates of its angles as their derivatives, if it has every angle and two rows."""
    angles = (*ATTITUDE_NAMES, *wheel_angle_names(robot.wheel_count))
    lacking = [name for name in angles if f"{name}_dot" not in log]
    if len(log) < 2 or any(name not in log for name in (*lacking, *ATTITUDE_NAMES)):
        return log
    return log.with_columns({f"{name}_dot": np.gradient(log[name], log.t) for name in lacking})


QUATERNION_NAMES = ("qw", "qx", "qy", "qz")
PLACE_NAMES = ("x", "y", "z")
#: largest difference from one of the norm of a quaternion that is an orientation
_NORM_TOLERANCE = 0.1
_LEAST_POSES = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Poses:
    """Poses measured by motion capture, in its frame and on its clock; a gap in time where the body was not seen."""

    t: Floats  #: (M,) [s]
    rotations: Rotation  #: M of them, body to cameras
    places: Floats  #: (M, 3) [m]; NaN if not measured

    def of_rows(self, kept: Bools) -> Poses:
        """Return some of the poses."""
        rotations = Rotation.from_quat(self.rotations.as_quat()[kept])
        return Poses(t=self.t[kept], rotations=rotations, places=self.places[kept])


def read_motion_capture(path: Path, mapping: Path | None = None) -> Log:
    """Read a log of motion capture, or a program's export: a time, and columns of one body that end in W, X, Y, Z.

    An export is read by the mapping that its names make. A clock in another unit is an error in the log's `changes`.
    InputError if it is neither, or has several bodies.
    """
    table = None if mapping else read_foreign_table(path)
    by = mapping if table is None or "t" in table.columns else _mapping_of_export(path, table)
    mocap = Log.read(path, mapping=by)
    return replace(mocap, changes=(*mocap.changes, *clock_findings(mocap.t, "--mocap-mapping")))


def _mapping_of_export(path: Path, table: ForeignTable) -> LogMapping:
    columns, roles = table.columns, roles_by_name([*table.columns], wheel_count=0, units=table.units)
    bodies = quaternions(columns)
    if not roles.time or len(bodies) != 1:
        raise InputError(
            f"{path} has no t, qw, qx, qy, qz and x, y, z, and is no export of one body: it has "
            f"{'a' if roles.time else 'no'} time and {counted(len(bodies), 'unit quaternion')} in {', '.join(columns)}."
        )
    places = next((one for one in marked_series(columns, "xyz") if not {*one} & {*bodies[0]}), ())
    named = zip(QUATERNION_NAMES + PLACE_NAMES, bodies[0] + places, strict=False)
    entries = {
        own: ColumnTable(source=name, unit=unit_of(own) and stated_unit(name, table.units))
        for own, name in named
    }
    with about(path):
        unit = clock_unit(columns[roles.time], roles.time, roles.unit((roles.time,))).name
    return LogMapping(file=table.layout, columns={"t": ColumnTable(source=roles.time, unit=unit), **entries})


def read_poses(mocap: Log) -> Poses:
    """Return the poses of a log of motion capture; without x, y and z the places are NaN.

    InputError if there are no unit quaternions qw, qx, qy, qz.
    """
    wxyz = np.column_stack([mocap[name] for name in QUATERNION_NAMES])
    seen = np.isfinite(wxyz).all(axis=1) & (np.abs(np.linalg.norm(wxyz, axis=1) - 1.0) < _NORM_TOLERANCE)
    if seen.sum() < _LEAST_POSES:
        raise InputError("The motion capture has no poses; it needs unit quaternions in qw, qx, qy, qz.")
    placed = all(name in mocap for name in PLACE_NAMES)
    places = np.column_stack([mocap[n] for n in PLACE_NAMES]) if placed else np.full((len(seen), 3), np.nan)
    places[~np.isfinite(places).all(axis=1)] = np.nan
    rotations = Rotation.from_quat(wxyz[seen][:, [1, 2, 3, 0]])
    return Poses(t=mocap.t[seen], rotations=rotations, places=places[seen])
