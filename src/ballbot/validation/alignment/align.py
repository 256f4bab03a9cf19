"""A log against motion capture of the same run: clock, frame, lever arm, flips; then the errors of the log's sensors.

The cameras may be on any clock and in any frame, and the frame of their marker body may stand anyhow to the robot's.
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
from ballbot.validation.alignment.errors import SensorErrors, sensor_errors
from ballbot.validation.alignment.frame import (
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
    Flip,
    MotionFit,
    fit_motion,
    unbroken_stretches,
    undo_flips,
    wahba,
)

#: share of the turning that must be common to both, or they are not of the same run
_LEAST_SHARE = 0.5
#: another clock whose fit is so likely beside the best is worth a word
_RIVAL = 0.5
#: clocks nearer than this in the log's middle are the same [s]
_SAME = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """How log and motion capture belong together, and what this says of the log's sensors."""

    log: Log  #: with the columns mocap_..., where it has angles
    motion: MotionFit
    flips: tuple[Flip, ...]
    rival_clock: Clock | None  #: another clock that fits nearly as well
    clock_signal: str  #: what of the log the clock follows: "gyro" or "angles"
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
        If they lack what is needed or are not of the same run.
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
    if not found or _share(found[0].motion) < _LEAST_SHARE:
        share = 100.0 * _share(found[0].motion) if found else 0.0
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


def _share(motion: MotionFit) -> float:
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
