"""A log against motion capture of the same run: clock, frame, lever arm, flips; then the errors of the log's sensors.

The cameras may be on any clock and in any frame, and their marker body may be mounted in any orientation.

Errors of the log's angles and position by the cameras, with drift and delay:

    error = logged - seen,     error(t) = constant + drift t + wander

A log that is late by d has, over half a second, changes of its error of -d times the changes of its rate. Position
that is integrated in a frame turned by a heading wrong by d has the error  integral of (Rz(d) - 1) dp; the share of
the error seen that this explains is 1 - |seen - explained|^2 / |seen|^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.pose import Poses, read_poses
from ballbot.validation.alignment.clock import (
    ANGLE_NAMES,
    LARGEST_RATE,
    Clock,
    Turning,
    candidate_clocks,
    has_gyro,
    log_turning,
    longest_bridge,
    poses_turning,
)
from ballbot.validation.alignment.frame import (
    PREFIX,
    Common,
    Frame,
    Lever,
    aligned_columns,
    common_rows,
    fit_lever,
    fit_origin,
    fit_rotation,
)
from ballbot.validation.alignment.motion import (
    SPAN,
    Flip,
    MotionFit,
    fit_in_blocks,
    fit_motion,
    unbroken_stretches,
    undo_flips,
    wahba,
)

#: share of the turning that must be common to both, or they are not of the same run
_LEAST_SHARE = 0.5
#: another clock is reported if its likelihood exceeds this share of the best's
_RIVAL = 0.5
#: clocks nearer than this in the log's middle are the same [s]
_SAME = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """The alignment of a log with motion capture, and the errors of the log's sensors."""

    log: Log  #: with the columns mocap_..., where it has angles
    motion: MotionFit
    flips: tuple[Flip, ...]
    rival_clock: Clock | None  #: another clock that fits nearly as well
    clock_signal: str  #: the log's signal that the clock is matched to: "gyro" or "angles"
    unseen: float  #: share of the log's time that the cameras did not see
    frame: Frame | None  #: None for a log without angles
    lever: Lever | None  #: None without positions
    sensors: SensorErrors | None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Candidate:
    poses: Poses
    flips: tuple[Flip, ...]
    motion: MotionFit
    gain: float  #: logarithm of the likelihood over that of no relation


def align(log: Log, mocap: Log) -> Alignment:
    """Return how a log and its motion capture belong together.

    Parameters
    ----------
    log : Log
        Needs gyro_x, gyro_y, gyro_z or theta, phi, psi; with the angles, their errors come too, and with x and y
        those of the position.
    mocap : Log
        Motion capture: t, and qw qx qy qz of a body, marker frame to the cameras'; x y z of a point of it, if it has.

    Raises
    ------
    InputError
        If they lack a needed column or are not of the same run.
    """
    turning, poses = log_turning(log), read_poses(mocap).seen_only()
    best, rival = _best(turning, poses)
    unseen = _unseen(log, best.poses, best.motion.clock)
    if not all(name in log for name in ANGLE_NAMES):
        return Alignment(
            log=log, motion=best.motion, flips=best.flips, rival_clock=rival, clock_signal="gyro", unseen=unseen,
            frame=None, lever=None, sensors=None,
        )  # fmt: skip
    common = common_rows(log, best.poses, best.motion)
    frame = fit_rotation(common, best.motion)
    lever = fit_lever(common, frame, best.motion, _heading_error(common, frame))
    arm = np.zeros(3) if lever is None else lever.used
    if lever is not None:
        frame = fit_origin(common, frame, arm, best.motion)
    columns = aligned_columns(log, best.poses, best.motion.clock, best.motion.body_marker, frame, arm)
    return Alignment(
        log=log.with_columns(columns),
        motion=best.motion,
        flips=best.flips,
        rival_clock=rival,
        clock_signal="gyro" if has_gyro(log) else "angles",
        unseen=unseen,
        frame=frame,
        lever=lever,
        sensors=sensor_errors(log, columns),
    )


def _best(turning: Turning, poses: Poses) -> tuple[_Candidate, Clock | None]:
    """Return the likeliest fit and, if it is nearly as likely, the clock of another."""
    cameras, parts = poses_turning(poses), unbroken_stretches(poses)
    if not parts:
        raise InputError("The motion capture has no two poses in succession without a gap between them.")
    found: list[_Candidate] = []
    for clock in candidate_clocks(turning, cameras):
        one = _fitted(turning, poses, cameras, parts, clock)
        if one is not None and abs(one.motion.clock.rate) < 2.0 * LARGEST_RATE:
            found.append(one)
    found.sort(key=lambda one: -one.gain)
    if not found or _matching_share(found[0].motion) < _LEAST_SHARE:
        share = 100.0 * _matching_share(found[0].motion) if found else 0.0
        raise InputError(
            f"Log and motion capture do not turn alike: with the best clock only {share:.0f} % of "
            f"the turning is common to both; for the same run it is over {100 * _LEAST_SHARE:.0f} %."
        )
    middle = np.array(0.5 * (turning.t[0] + turning.t[-1]))
    here = found[0].motion.clock.to_cameras(middle)
    for other in found[1:]:
        clock = other.motion.clock
        if abs(clock.to_cameras(middle) - here) > _SAME and other.gain > _RIVAL * found[0].gain:
            return found[0], clock
    return found[0], None


def _fitted(
    turning: Turning, poses: Poses, cameras: Turning, parts: list[tuple[int, int]], clock: Clock
) -> _Candidate | None:
    """Return the fit that starts from a clock, flips undone; None if they share too little."""
    try:
        # the longest stretch within the log's time
        begin, end = clock.to_cameras(turning.t[[0, -1]])
        shared = [min(poses.t[last], end) - max(poses.t[first], begin) for first, last in parts]
        anchor = int(np.argmax(shared))
        rows = parts[anchor] if len(parts) > 1 else None
        start = wahba(turning, cameras, clock, rows=rows)
        poses, flips = undo_flips(poses, parts, anchor, log=turning, clock=clock, body_marker=start)
        motion = fit_motion(turning, poses_turning(poses) if flips else cameras, clock, start)
    except InputError:
        return None
    gain = -motion.increments * float(np.log(motion.error / motion.motion))
    return _Candidate(poses=poses, flips=flips, motion=motion, gain=gain)


def _matching_share(motion: MotionFit) -> float:
    return 1.0 - (motion.error / motion.motion) ** 2


def _unseen(log: Log, poses: Poses, clock: Clock) -> float:
    t = clock.to_cameras(log.t)
    after = np.clip(np.searchsorted(poses.t, t), 1, len(poses.t) - 1)
    near = poses.t[after] - poses.t[after - 1] <= longest_bridge(poses.t)
    return 1.0 - float(np.mean(near & (t >= poses.t[0]) & (t <= poses.t[-1])))


def _heading_error(common: Common, frame: Frame) -> NDArray[np.float64]:
    """Return the log's heading less the cameras' (k,) [rad], without jumps."""
    seen = (frame.camera_world.inv() * common.camera_body).as_euler("XYZ")[:, 2]
    return np.unwrap(common.world_body.as_euler("XYZ")[:, 2] - seen)


ANGLES = ("theta", "phi", "psi")
POSITIONS = ("x", "y")
#: beyond this angle from upright a robot is falling or in hands [rad]
LARGEST_LEAN = 0.35
#: rates are slopes over this, to either side [s]
_SLOPE = 0.04
_LEAST_ROWS = 60
#: scale and turn of the path are fitted to pieces this long, in which a robot's rocking averages out [s]
_STRETCH = 5.0
#: the fit uses one row in so many
_EVERY = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorError:
    """Of one angle [rad] or coordinate [m], logged less seen, while the robot stands."""

    name: str
    rms: float
    largest: float
    drift: float  #: slope of the straight line through the error [1/s]
    drift_half_width: float  #: 95 %, by blocks of time
    wander: float  #: rms about that line
    delay: float | None  #: of the logged value behind the clock's signal [s]; None for a coordinate
    delay_half_width: float | None


@dataclass(frozen=True, kw_only=True)
class PathScale:
    """How the log's path compares with the cameras', but for the heading's error; half widths of 95 %."""

    scale: float  #: the log's distances over the cameras'
    scale_half_width: float
    turn: float  #: from the cameras' path to the log's [rad]
    turn_half_width: float


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionError:
    """Contributions to the error of position."""

    largest: float  #: its length [m]
    path: float  #: length of the path that the cameras saw [m], over half a second at a time
    by_heading: (
        float  #: share of the error's square that the heading's error explains; below 0, it makes it worse
    )
    predicted: NDArray[np.float64]  #: (N, 2) [m] the error that the heading's makes; NaN if not seen
    scale: PathScale | None  #: None if the path is too short


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorErrors:
    """Errors of all that the log and the cameras both have."""

    of: dict[str, SensorError]
    errors: dict[str, NDArray[np.float64]]  #: by name, (N,) on the log's rows
    position: PositionError | None
    duration: float  #: from the first to the last row compared [s]


def sensor_errors(log: Log, columns: dict[str, NDArray[np.float64]]) -> SensorErrors | None:
    """Return the errors, or None if log and cameras have hardly a row together.

    Parameters
    ----------
    log : Log
    columns : dict
        From `aligned_columns`.
    """
    names = [name for name in (*ANGLES, *POSITIONS) if name in log and f"{PREFIX}{name}" in columns]
    standing = np.hypot(columns[f"{PREFIX}theta"], columns[f"{PREFIX}phi"]) < LARGEST_LEAN
    errors = {name: np.where(standing, log[name] - columns[f"{PREFIX}{name}"], np.nan) for name in names}
    if np.isfinite(errors["psi"]).sum() < _LEAST_ROWS:
        return None
    compared = log.t[np.isfinite(errors["psi"])]
    position = None
    if all(name in errors for name in POSITIONS):
        position = _position_error(log.t, columns, errors)
    return SensorErrors(
        of={name: _sensor_error(name, log, error) for name, error in errors.items()},
        errors=errors,
        position=position,
        duration=float(compared[-1] - compared[0]),
    )


def _sensor_error(name: str, log: Log, error: NDArray[np.float64]) -> SensorError:
    known = np.isfinite(error)
    t, e = log.t[known], error[known]
    J = np.column_stack([np.ones(len(t)), t - t.mean()])[:, None, :]
    (constant, drift), half = fit_in_blocks(J, e[:, None], t)
    wander = e - constant - drift * (t - t.mean())
    delay = _delay(log, name, error) if name in ANGLES else None
    return SensorError(
        name=name,
        rms=float(np.sqrt(np.mean(e**2))),
        largest=float(np.abs(e).max()),
        drift=float(drift),
        drift_half_width=float(half[1]),
        wander=float(np.sqrt(np.mean(wander**2))),
        delay=delay[0] if delay else None,
        delay_half_width=delay[1] if delay else None,
    )


def _delay(log: Log, name: str, error: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return how late an angle is logged [s] and the 95 % half width, or None if too little is known."""
    t = log.t
    known = np.isfinite(log[name])
    times, angle = t[known], np.unwrap(log[name][known])
    rate = (np.interp(t + _SLOPE, times, angle) - np.interp(t - _SLOPE, times, angle)) / (2.0 * _SLOPE)
    ahead = np.interp(t + SPAN, t, rate) - rate, np.interp(t + SPAN, t, error) - error
    usable = np.isfinite(ahead[0]) & np.isfinite(ahead[1]) & (t + SPAN <= t[-1])
    if usable.sum() < _LEAST_ROWS:
        return None
    found, half = fit_in_blocks(-ahead[0][usable][:, None, None], ahead[1][usable][:, None], t[usable])
    return float(found[0]), float(half[0])


def _position_error(
    t: NDArray[np.float64], columns: dict[str, NDArray[np.float64]], errors: dict[str, NDArray[np.float64]]
) -> PositionError | None:
    seen = np.column_stack([columns[f"{PREFIX}{name}"] for name in POSITIONS])
    error = np.column_stack([errors[name] for name in POSITIONS])
    known = np.isfinite(seen).all(axis=1) & np.isfinite(error).all(axis=1)
    if known.sum() < _LEAST_ROWS:
        return None
    times, seen, seen_error, off = t[known], seen[known], error[known], errors["psi"][known]
    turned = _turned(seen, off)
    of_heading = turned - (seen - seen[0])
    predicted = np.full_like(error, np.nan)
    predicted[known] = of_heading
    coarse = np.arange(times[0], times[-1], SPAN)
    path = np.column_stack([np.interp(coarse, times, column) for column in seen.T])
    return PositionError(
        largest=float(np.linalg.norm(seen_error, axis=1).max()),
        path=float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        by_heading=_share(seen_error, of_heading),
        predicted=predicted,
        scale=_fit_scale(times, turned, seen + seen_error),
    )


def _fit_scale(
    t: NDArray[np.float64], turned: NDArray[np.float64], logged: NDArray[np.float64]
) -> PathScale | None:
    """Return how the logged path (k, 2) is scaled and turned against the one seen, its headings made the log's."""
    ends = np.searchsorted(t, t + _STRETCH)
    starts = np.flatnonzero(ends < len(t))[::_EVERY]
    if len(starts) < _LEAST_ROWS:
        return None
    ends = ends[starts]
    (x, y), moved = (turned[ends] - turned[starts]).T, logged[ends] - logged[starts]
    J = np.stack([np.stack([x, -y], axis=1), np.stack([y, x], axis=1)], axis=1)
    (c, s), half = fit_in_blocks(J, moved, t[starts])
    size = float(np.hypot(c, s))
    if not (size > 0.5 and half.max() < 0.5):
        return None
    return PathScale(
        scale=size,
        scale_half_width=float(half[0]),
        turn=float(np.arctan2(s, c)),
        turn_half_width=float(half[1]) / size,
    )


def _turned(path: NDArray[np.float64], turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a path (k, 2), from its start, whose every step is turned by an angle (k,)."""
    steps = np.diff(path, axis=0)
    angle = 0.5 * (turn[1:] + turn[:-1])
    c, s = np.cos(angle), np.sin(angle)
    turned = np.column_stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)])


def _share(error: NDArray[np.float64], explained: NDArray[np.float64]) -> float:
    """Return the share of an error's square that is explained."""
    total = float(np.sum(error**2))
    return 1.0 - float(np.sum((error - explained) ** 2)) / total if total > 0.0 else 0.0
