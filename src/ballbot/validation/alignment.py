"""Align a log with motion capture of the same run (thesis, Appendix IV): clock, frames, lever arm, sensor errors.

The cameras may have any clock and any frame, and the marker body may be mounted in any orientation.

    R_seen = R_camera_world R_world_body R_body_marker
    p_seen = R_camera_world p_world + origin + R_seen lever

The world frame is that of the log's angles and position. The log's heading drifts, so the vertical is estimated from
the whole log, heading and origin from its first two seconds. A constant error of the lean angles cannot be separated
from a tilt of the camera frame and is part of it. The lever arm is from the ball's centre to the tracked point. Over a
few seconds, in the world frame and with d the heading's error,

    R_wc (p_k+1 - p_k) = (R_wm,k+1 - R_wm,k) a + [c -s; s c] Rz(-d) ((x y)_k+1 - (x y)_k) ,      height: no change

which is linear in the arm a (marker frame), c and s; c and s scale and rotate the log's path.

Errors of the log's angles and position with respect to the cameras, with drift and delay:

    error = logged - seen,     error(t) = constant + drift t + wander

A delay d changes the error over half a second by -d times the change of the rate. Position that is integrated with a
heading error d has the error  integral of (Rz(d) - 1) dp; its share of the observed error is
1 - |observed - explained|^2 / |observed|^2.

The findings begin with the heading; further significant results follow.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, note
from ballbot.identification.motion_capture import (
    LARGEST_LEAN,
    POSITIONS,
    SeenRows,
    frame_findings,
    poses_on_rows,
    stretches,
)
from ballbot.identification.turning import (
    ANGLE_NAMES,
    SPAN,
    Clock,
    MotionFit,
    fit_in_blocks,
    has_gyro,
    log_rotations,
    log_turning,
    longest_bridge,
    match_turning,
    poses_turning,
)
from ballbot.log import Log
from ballbot.log.pose import Poses, read_poses
from ballbot.results import key, left_out
from ballbot.rounding import digits, percent, plus_minus

#: share of the turning that log and cameras must have in common to be of the same run
_LEAST_SHARE = 0.5
PREFIX = "mocap_"
#: fewest common rows for a frame and errors
_LEAST_ROWS = 60
#: heading and origin are estimated over the first so many seconds
_START = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraFrame:
    """The pose of the log's world in the cameras' frame."""

    camera_world: Rotation = field(metadata=key("camera_world_wxyz"))
    tilt_half_width: float  #: 95 % [rad]
    heading_half_width: float  #: 95 % [rad]
    origin: Floats | None  #: (3,) [m] at the ball centre's height; None without positions


@dataclass(frozen=True, kw_only=True, eq=False)
class PathFit:
    """The lever arm, and scale and rotation of the log's path against the cameras' without the heading's error."""

    arm: Floats  #: (3,) [m] marker frame, as fitted
    arm_half_width: Floats  #: (3,) 95 % [m], random errors only
    used: Floats  #: (3,) [m] the arm that is subtracted; zero if it is not significant
    scale: float  #: the log's distances over the cameras'
    scale_half_width: float
    turn: float  #: from the cameras' path to the log's [rad]
    turn_half_width: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorError:
    """Error of an angle [rad] or a coordinate [m], logged minus seen, while the robot stands."""

    rms: float
    largest: float
    drift: float  #: slope of the straight line through the error [1/s]
    drift_half_width: float  #: 95 %, by blocks of time
    wander: float  #: rms about that line
    delay: float | None  #: of the logged value after the clock's signal [s]; None for a coordinate
    delay_half_width: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionError:
    """Contributions to the error of position."""

    largest: float  #: largest position error [m]
    path: float  #: length of the path that the cameras saw [m], in steps of half a second
    #: share of the squared error that the heading's error explains; negative if subtracting it makes the error larger
    by_heading: float = field(metadata=key("explained_by_heading"))
    #: (N, 2) [m] the position error by the heading's error; NaN if not seen
    predicted: Floats = field(metadata=left_out)


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorErrors:
    """Errors of the signals that both the log and the cameras have."""

    of: dict[str, SensorError]
    errors: dict[str, Floats]  #: by name, (N,) on the log's rows
    position: PositionError | None
    duration: float  #: from the first to the last row compared [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """The alignment of a log with motion capture, and the errors of the log's sensors."""

    log: Log  #: with the columns mocap_..., where it has angles
    motion: MotionFit
    rival_clock: Clock | None  #: another clock that fits nearly as well
    clock_signal: str  #: the log's signal that the clock is matched to: "gyro" or "angles"
    unseen: float  #: share of the log's time that the cameras did not see
    frame: CameraFrame | None  #: None for a log without angles
    path: PathFit | None  #: None without positions
    sensors: SensorErrors | None
    doubts: tuple[Finding, ...] = ()  #: errors of the cameras' unit and frame


def align(log: Log, mocap: Log) -> Alignment:
    """Return the alignment of a log with its motion capture.

    The log needs gyro_x, gyro_y, gyro_z or theta, phi, psi; with the angles their errors are estimated, and with x and
    y those of the position. The motion capture needs t and qw qx qy qz of a body, marker frame to camera frame; x y z
    [m] of a point are optional. InputError if a needed column is missing, they are not of the same run, or the cameras
    confused markers out of view.
    """
    turning, poses = log_turning(log), _in_one_frame(read_poses(mocap))
    motion, rival = match_turning(turning, poses_turning(poses), least_share=_LEAST_SHARE)
    seen = poses_on_rows(log, poses, motion)
    doubts = frame_findings(log, seen, motion)
    frame = path = sensors = None
    if all(name in log for name in ANGLE_NAMES):
        log, frame, path = _with_poses(log, seen, motion)
        sensors = _sensor_errors(log)
    return Alignment(
        log=log, motion=motion, rival_clock=rival, clock_signal="gyro" if has_gyro(log) else "angles",
        unseen=1.0 - len(seen[0]) / len(log), frame=frame, path=path, sensors=sensors,
        doubts=tuple(doubts),
    )  # fmt: skip


#: faster than any gyro's range, 2000 degrees a second: a jump of the marker body's frame, not a rotation [rad/s]
_FASTEST = 40.0
#: smaller rotations may be noise; larger ones are a jump whatever the time, as a quarter turn is [rad]
_LEAST_JUMP, _SURE_JUMP = 0.35, 1.0


def _in_one_frame(poses: Poses) -> Poses:
    """Return the poses without those in which the cameras confused markers.

    Symmetric markers make the marker body's frame jump by 90 or 180 degrees, and back. The product of the jumps is the
    rotation of each interval between two jumps against the first; the frame that most poses have is kept.
    """
    steps, dt = poses.rotations[:-1].inv() * poses.rotations[1:], np.diff(poses.t)
    jumps = steps.magnitude() > np.clip(_FASTEST * dt, _LEAST_JUMP, _SURE_JUMP)
    jumps &= dt <= longest_bridge(poses.t)
    frames = [Rotation.identity()]
    for jump in np.flatnonzero(jumps):
        frames.append(frames[-1] * steps[int(jump)])
    stretch = np.concatenate([[0], np.cumsum(jumps)])
    counts = np.bincount(stretch)
    turns = Rotation.concatenate(frames)
    alike = np.array([(turns.inv() * frame).magnitude() < _LEAST_JUMP for frame in frames])
    kept = alike[int(np.argmax(alike @ counts))][stretch]
    return poses.of_rows(kept)


def _with_poses(log: Log, seen: SeenRows, motion: MotionFit) -> tuple[Log, CameraFrame, PathFit | None]:
    """Return the log with mocap_theta, _phi, _psi [rad] and mocap_x, _y, _z [m], the frame and the path's fit."""
    (rows, camera_marker, points), (world_body, known) = seen, log_rotations(log)
    kept, t = known[rows], log.t[rows]
    if kept.sum() < _LEAST_ROWS:
        raise InputError(f"The log's angles and the motion capture have only {kept.sum()} rows in common.")
    camera_body = camera_marker * motion.body_marker.inv()
    by_log = Rotation.from_quat(world_body.as_quat()[rows[kept]])
    camera_world = _camera_world(t[kept], Rotation.from_quat(camera_body.as_quat()[kept]) * by_log.inv())
    seen_body = camera_world.inv() * camera_body
    angles = seen_body.as_euler("XYZ")
    # unwrap the slowly varying difference of the headings: the heading itself may turn within a gap
    off = np.unwrap(angles[:, 2] - np.interp(t, log.t[known], log["psi"][known]))
    off -= 2.0 * np.pi * np.round(off[0] / (2.0 * np.pi))
    angles[:, 2] = np.interp(t, log.t[known], log["psi"][known]) + off
    columns = dict(zip(ANGLE_NAMES, angles.T, strict=True))
    unknown = np.full(len(log), np.nan)
    positions = np.column_stack([log.columns.get(name, unknown)[rows] for name in POSITIONS])
    world_marker, points = seen_body * motion.body_marker, camera_world.inv().apply(points)
    path = _path_fit(t, world_marker, points, positions, off)
    arm = np.zeros(3) if path is None else path.used
    points = points - world_marker.apply(arm)
    away = points - np.column_stack([positions, np.zeros(len(t))])
    both, origin = np.isfinite(away).all(axis=1), None
    if both.any():
        start = away[both & (t <= t[both][0] + _START)].mean(axis=0)
        origin = camera_world.apply(start)
        columns |= dict(zip("xyz", (points - start).T, strict=True))
    filled = {f"{PREFIX}{name}": unknown.copy() for name in columns}
    for column, values in zip(filled.values(), columns.values(), strict=True):
        column[rows] = values
    widths = motion.rotation_half_width
    frame = CameraFrame(
        camera_world=camera_world, tilt_half_width=float(np.hypot(widths[0], widths[1])),
        heading_half_width=float(widths[2]), origin=origin,
    )  # fmt: skip
    return log.with_columns(filled), frame, path


def _camera_world(t: Floats, each: Rotation) -> Rotation:
    """Return the world's orientation in the camera frame from its estimate at each row; InputError if it jumps."""
    jumps = (each[:-1].inv() * each[1:]).magnitude() > 2.0 * _LEAST_JUMP
    if jumps.any():
        raise InputError(
            f"The cameras' body turns against the log between two poses, at {t[int(np.argmax(jumps)) + 1]:.2f} s of "
            "the log: out of view, markers were confused. Cut the motion capture there."
        )
    up = np.median(each.apply([0.0, 0.0, 1.0]), axis=0)
    leveled = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up / np.linalg.norm(up)])[0]
    forward = (leveled * each).apply([1.0, 0.0, 0.0])[t <= t[0] + _START].mean(axis=0)
    return leveled.inv() * Rotation.from_rotvec([0.0, 0.0, float(np.arctan2(forward[1], forward[0]))])


#: smallest lever arm that is subtracted [m]: the position computed from the wheels has small errors as the robot rocks
#: (play, creep) that look like an arm, of 3 and 5 cm on two logs whose cameras track the ball's centre itself
LEAST_LEVER = 0.1


def _path_fit(
    t: Floats, world_marker: Rotation, points: Floats, positions: Floats,
    heading: Floats,
) -> PathFit | None:  # fmt: skip
    """Return the lever arm, scale and rotation of the path, or None if log or cameras have too few positions.

    At k times t [s]: the marker's orientation and the tracked point's position (k, 3) [m] in the axes of the world,
    the log's x and y (k, 2) [m], and the cameras' heading less the log's (k,) [rad].
    """
    known = np.asarray(np.isfinite(np.hstack([points, positions])).all(axis=1))
    starts, ends = stretches(t)
    kept = known[starts] & known[ends]
    starts, ends = starts[kept], ends[kept]
    if len(starts) < _LEAST_ROWS:
        return None
    marker, d = world_marker.as_matrix(), 0.5 * (heading[starts] + heading[ends])
    x, y = (positions[ends] - positions[starts]).T
    x, y = np.cos(d) * x - np.sin(d) * y, np.sin(d) * x + np.cos(d) * y
    J = np.zeros((len(starts), 3, 5))
    J[:, :, :3] = marker[ends] - marker[starts]
    J[:, 0, 3], J[:, 1, 3], J[:, 0, 4], J[:, 1, 4] = x, y, -y, x
    estimate, half = fit_in_blocks(J, points[ends] - points[starts], t[starts])
    if half[3:].max() > 0.3 * np.hypot(*estimate[3:]):  # too short a path
        return None
    arm, size = estimate[:3], float(np.hypot(*estimate[3:]))
    significant = np.linalg.norm(arm) > LEAST_LEVER + np.linalg.norm(half[:3])
    return PathFit(
        arm=arm, arm_half_width=half[:3], used=arm if significant else np.zeros(3), scale=1.0 / size,
        scale_half_width=float(half[3]) / size**2, turn=-float(np.arctan2(estimate[4], estimate[3])),
        turn_half_width=float(half[4]) / size,
    )  # fmt: skip


#: rates are differences over this time to either side [s]
_SLOPE = 0.04


def _sensor_errors(log: Log) -> SensorErrors | None:
    """Return the errors of a log with the columns of the cameras, or None if they have too few common rows."""
    names = [name for name in (*ANGLE_NAMES, *POSITIONS) if name in log and f"{PREFIX}{name}" in log]
    standing = np.hypot(log[f"{PREFIX}theta"], log[f"{PREFIX}phi"]) < LARGEST_LEAN
    errors = {name: np.where(standing, log[name] - log[f"{PREFIX}{name}"], np.nan) for name in names}
    compared = log.t[np.isfinite(errors["psi"])]
    if len(compared) < _LEAST_ROWS:
        return None
    return SensorErrors(
        of={name: _sensor_error(name, log, error) for name, error in errors.items()},
        errors=errors,
        position=_position_error(log, errors) if "x" in errors and "y" in errors else None,
        duration=float(compared[-1] - compared[0]),
    )


def _sensor_error(name: str, log: Log, error: Floats) -> SensorError:
    known = np.isfinite(error)
    t, e = log.t[known], error[known]
    J = np.column_stack([np.ones(len(t)), t - t.mean()])[:, None, :]
    (constant, drift), half = fit_in_blocks(J, e[:, None], t)
    wander = e - constant - drift * (t - t.mean())
    delay, delay_half_width = _delay(log, name, error) if name in ANGLE_NAMES else (None, None)
    return SensorError(
        rms=float(np.sqrt(np.mean(e**2))), largest=float(np.abs(e).max()), drift=float(drift),
        drift_half_width=float(half[1]), wander=float(np.sqrt(np.mean(wander**2))), delay=delay,
        delay_half_width=delay_half_width,
    )  # fmt: skip


def _delay(log: Log, name: str, error: Floats) -> tuple[float | None, float | None]:
    """Return the delay of a logged angle [s] and its 95 % half width, or None if there are too few rows."""
    t, known = log.t, np.isfinite(log[name])
    times, angle = t[known], np.unwrap(log[name][known])
    rate = (np.interp(t + _SLOPE, times, angle) - np.interp(t - _SLOPE, times, angle)) / (2.0 * _SLOPE)
    of_rate, of_error = np.interp(t + SPAN, t, rate) - rate, np.interp(t + SPAN, t, error) - error
    usable = np.isfinite(of_rate) & np.isfinite(of_error) & (t + SPAN <= t[-1])
    if usable.sum() < _LEAST_ROWS:
        return None, None
    estimate, half = fit_in_blocks(-of_rate[usable][:, None, None], of_error[usable][:, None], t[usable])
    return float(estimate[0]), float(half[0])


def _position_error(log: Log, errors: dict[str, Floats]) -> PositionError | None:
    seen = np.column_stack([log[f"{PREFIX}{name}"] for name in POSITIONS])
    error = np.column_stack([errors[name] for name in POSITIONS])
    known = np.isfinite(seen).all(axis=1) & np.isfinite(error).all(axis=1)
    if known.sum() < _LEAST_ROWS:
        return None
    t, seen, logged_off, off = log.t[known], seen[known], error[known], errors["psi"][known]
    explained = _turned(seen, off) - (seen - seen[0])
    predicted = np.full_like(error, np.nan)
    predicted[known] = explained
    coarse = np.arange(t[0], t[-1], SPAN)
    path = np.column_stack([np.interp(coarse, t, column) for column in seen.T])
    return PositionError(
        largest=float(np.linalg.norm(logged_off, axis=1).max()),
        path=float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        by_heading=1.0 - float(np.sum((logged_off - explained) ** 2) / max(np.sum(logged_off**2), 1e-300)),
        predicted=predicted,
    )


def _turned(path: Floats, turn: Floats) -> Floats:
    """Return a path (k, 2) relative to its start with every step rotated by an angle (k,)."""
    steps = np.diff(path, axis=0) @ np.array([1.0, 1.0j])
    turned = np.cumsum(np.exp(0.5j * (turn[1:] + turn[:-1])) * steps)
    return np.concatenate([np.zeros((1, 2)), np.column_stack([turned.real, turned.imag])])


#: explained share from which the position error is said to follow the heading
_FOLLOWS = 0.5
#: delays of angles below this are not reported [s]
_LEAST_DELAY = 2e-3
#: accuracy of mounting markers [m]
_LEAST_ARM = 0.01
#: share of the time out of view from which it is reported
_UNSEEN = 0.01


def alignment_findings(alignment: Alignment) -> tuple[Finding, ...]:
    """Return the findings, the one on the heading first."""
    sentences: list[str] = []
    if alignment.sensors is None:
        sentences.append(
            "The log has no theta, phi and psi in common with the cameras: only clocks and markers are aligned."
        )
    else:
        sentences += [_heading(alignment.sensors), *_of_angles(alignment.sensors, alignment.clock_signal)]
    if alignment.path is not None and not alignment.doubts:
        sentences += _of_path(alignment.path)
    if alignment.unseen >= _UNSEEN:
        sentences.append(
            f"For {percent(alignment.unseen)} of the log's time the cameras saw nothing, or confused two markers."
        )
    if alignment.rival_clock is not None:
        sentences.append(
            f"Another alignment fits nearly as well, with the cameras' clock at {alignment.rival_clock.offset:.2f} s "
            "at the log's zero, because the motion repeats itself. A log that begins or ends with a sideways push "
            "would decide."
        )
    return tuple(note("alignment", sentence) for sentence in sentences)


def _heading(sensors: SensorErrors) -> str:
    psi, position = sensors.of["psi"], sensors.position
    drifts = abs(psi.drift) > psi.drift_half_width
    drift, half = 60 * np.degrees(psi.drift), 60 * np.degrees(psi.drift_half_width)
    words = f"Heading does not drift, {plus_minus(drift, half)} degrees a minute"
    if drifts:
        total = (
            f"{digits(abs(np.degrees(psi.drift)) * sensors.duration, 2)} degrees in {sensors.duration:.0f} s"
        )
        words = f"Heading drifts {plus_minus(abs(drift), half)} degrees a minute, {total}"
    if position is None:
        return f"{words}."
    reaches = f"reaches {digits(1000.0 * position.largest, 2)} mm on a path of {digits(position.path, 2)} m"
    if not drifts:
        return f"{words}; the position error {reaches}."
    follows = "follows it" if position.by_heading > _FOLLOWS else "does not follow it"
    share = "none" if position.by_heading < 0.005 else percent(position.by_heading)
    return (
        f"{words}. The position error {follows} and {reaches}; rotating "
        f"that path by the heading error explains {share} of it."
    )


def _of_angles(sensors: SensorErrors, signal: str) -> Iterator[str]:
    sizes = (digits(np.degrees(sensors.of[name].rms), 2) for name in ("theta", "phi"))
    drifting = []
    for name in ("theta", "phi"):
        drift, half = np.degrees([60.0 * sensors.of[name].drift, 60.0 * sensors.of[name].drift_half_width])
        if abs(drift) > half:
            drifting.append(f"{name} drifts {plus_minus(drift, half)} degrees a minute")
    yield (
        f"The lean angles are accurate to {' and '.join(sizes)} degrees RMS; "
        f"{' and '.join(drifting) or 'neither drifts'}. A constant error of them cannot be separated from a tilt of "
        "the cameras' frame and is not counted."
    )
    for name in ANGLE_NAMES:
        delay, half = sensors.of[name].delay, sensors.of[name].delay_half_width
        if delay is not None and half is not None and abs(delay) > max(_LEAST_DELAY, half):
            way = "behind" if delay > 0 else "ahead of"
            yield (
                f"{name} is logged {plus_minus(1e3 * abs(delay), 1e3 * half)} ms {way} the {signal}, to which the "
                "clock is aligned."
            )


def _of_path(path: PathFit) -> Iterator[str]:
    if abs(path.scale - 1.0) > 3.0 * path.scale_half_width:
        off = plus_minus(100 * abs(path.scale - 1.0), 100 * path.scale_half_width)
        yield (
            f"The log's distances are {off} % too {'long' if path.scale > 1.0 else 'short'}: the radius of the ball or "
            "of the wheels differs from the one that the robot uses, or the wheels slip."
        )
    if path.used.any():
        yield "The cameras track a point beside the ball's centre; the lever arm was subtracted."
    elif np.linalg.norm(path.arm) > max(_LEAST_ARM, float(np.linalg.norm(path.arm_half_width))):
        yield (
            "The point that the cameras track is assumed to be the ball's centre. A lever arm fits, but one of less "
            f"than {1000.0 * LEAST_LEVER:.0f} mm beyond chance may also be the log's own error as the robot rocks."
        )
