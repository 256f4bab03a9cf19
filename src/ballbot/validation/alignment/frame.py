"""The cameras' frame against the log's world, the lever arm of the point they track, and their poses on the log's rows.

    R_seen = R_camera_world R_world_body R_body_marker
    p_seen = R_camera_world p_world + origin + R_seen lever

The log's own angles and position give the first and the origin. Its heading drifts, so the vertical comes from the
whole log (R_seen R_marker_body R_body_world takes it to the cameras' frame whatever the heading), heading and origin
from the first two seconds. A constant error of the lean angles cannot be separated from a tilt of the frame and goes
into it.

The lever arm goes from the ball's centre to the point that the cameras track. Over half a second, in the world's frame
and with d the heading's error,

    R_wc (p_k+1 - p_k) = (R_wm,k+1 - R_wm,k) a + [c -s; s c] Rz(-d) (x y)_k+1 - (x y)_k ,      height: no change

linear in the arm a (marker frame), c and s; the last two let the log's path be longer than it was, or turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.pose import Poses
from ballbot.validation.alignment.clock import Clock, log_rotations, longest_bridge, whole_rows
from ballbot.validation.alignment.motion import SPAN, MotionFit, fit_in_blocks

#: heading and origin are those of the first so many seconds
START = 2.0
_LEAST_ROWS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Common:
    """Poses at times that the log has as well."""

    t: NDArray[np.float64]  #: (k,) [s], the log's clock
    camera_body: Rotation  #: k of them: the log's body as the cameras saw it
    world_body: Rotation  #: k of them, by the log's angles
    places: NDArray[np.float64]  #: (k, 3) [m], the cameras' frame; NaN if not seen
    positions: NDArray[np.float64]  #: (k, 2) [m], the log's x and y; NaN if missing


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """The pose of the log's world in the cameras' frame."""

    camera_world: Rotation
    tilt_half_width: float  #: 95 % [rad]
    heading_half_width: float  #: 95 % [rad]; infinite if not determined
    origin: (
        NDArray[np.float64] | None
    )  #: (3,) [m] the world's, at the ball centre's height; None without positions


def common_rows(log: Log, poses: Poses, motion: MotionFit) -> Common:
    """Return the poses that were seen while the log has its angles.

    Raises
    ------
    InputError
        If there are hardly any.
    """
    rotations, known = log_rotations(log)
    t = motion.clock.to_log(poses.t)
    rows = (t >= log.t[0]) & (t <= log.t[-1])
    # both neighbours of the time in the log
    after = np.clip(np.searchsorted(log.t, t), 1, len(log) - 1)
    rows &= known[after] & known[after - 1]
    if rows.sum() < _LEAST_ROWS:
        raise InputError(f"The log's angles and the motion capture have only {rows.sum()} times in common.")
    x, y = (log.columns.get(name, np.full(len(log), np.nan)) for name in ("x", "y"))
    return Common(
        t=t[rows],
        camera_body=poses.rotations[rows] * motion.body_marker.inv(),
        world_body=Slerp(log.t, rotations)(t[rows]),
        places=poses.places[rows],
        positions=np.column_stack([np.interp(t[rows], log.t, x), np.interp(t[rows], log.t, y)]),
    )


def fit_rotation(common: Common, motion: MotionFit) -> Frame:
    """Return the cameras' frame but for its origin."""
    camera_world = common.camera_body * common.world_body.inv()
    up = np.median(camera_world.apply([0.0, 0.0, 1.0]), axis=0)
    up /= np.linalg.norm(up)
    leveled = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0]
    turned = (leveled * camera_world).apply([1.0, 0.0, 0.0])
    start = common.t <= common.t[0] + START
    first = turned[start, :2].mean(axis=0)
    heading = float(np.arctan2(first[1], first[0]))
    widths = motion.rotation_half_width
    return Frame(
        camera_world=leveled.inv() * Rotation.from_rotvec([0.0, 0.0, heading]),
        tilt_half_width=float(np.hypot(widths[0], widths[1])),
        heading_half_width=float(widths[2]),
        origin=None,
    )


def fit_origin(common: Common, frame: Frame, lever: NDArray[np.float64], motion: MotionFit) -> Frame:
    """Return the frame with its origin, given the lever arm (3,) [m] in the marker frame.

    Raises
    ------
    InputError
        If the first two seconds have no position.
    """
    level = np.column_stack([common.positions, np.zeros(len(common.t))])
    rise = (common.camera_body * motion.body_marker).apply(lever)
    origins = common.places - rise - frame.camera_world.apply(level)
    known = np.isfinite(origins).all(axis=1)
    if not known.any():
        raise InputError("The motion capture has no position while the log has x and y.")
    begin = common.t[known][0]
    return Frame(
        camera_world=frame.camera_world,
        tilt_half_width=frame.tilt_half_width,
        heading_half_width=frame.heading_half_width,
        origin=origins[known & (common.t <= begin + START)].mean(axis=0),
    )


_LEAST_SPANS = 60
#: A ball's position computed from wheels is wrong by a little as the robot rocks (play, creep), and that looks like an
#: arm: of 3 and 5 cm on two logs whose cameras report the ball's centre itself. Below this no arm is believed [m]
LEAST_LEVER = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Lever:
    """The arm, in the marker frame."""

    arm: NDArray[np.float64]  #: (3,) [m] as fitted
    half_width: NDArray[np.float64]  #: (3,) 95 % [m], of chance alone
    used: NDArray[np.float64]  #: (3,) [m], the arm that is subtracted, or zero if it is not significant


def fit_lever(
    common: Common, frame: Frame, motion: MotionFit, heading_error: NDArray[np.float64]
) -> Lever | None:
    """Return the lever arm, or None if log or cameras have hardly any positions.

    Parameters
    ----------
    common : Common
    frame : Frame
        Needs no origin.
    motion : MotionFit
    heading_error : ndarray (k,)
        The log's heading less the cameras' [rad].
    """
    known = whole_rows(common.places) & whole_rows(common.positions)
    ends = np.searchsorted(common.t, common.t + SPAN)
    inside = ends < len(common.t)
    starts, ends = np.flatnonzero(inside), ends[inside]
    # a span without a gap, or nearly
    near = common.t[ends] - common.t[starts] < 1.2 * SPAN
    kept = near & known[starts] & known[ends]
    starts, ends = starts[kept], ends[kept]
    if len(starts) < _LEAST_SPANS:
        return None
    world_marker = (frame.camera_world.inv() * common.camera_body * motion.body_marker).as_matrix()
    moved = frame.camera_world.inv().apply(common.places[ends] - common.places[starts])
    d = -0.5 * (heading_error[starts] + heading_error[ends])
    x, y = (common.positions[ends] - common.positions[starts]).T
    x, y = np.cos(d) * x - np.sin(d) * y, np.sin(d) * x + np.cos(d) * y
    J = np.zeros((len(starts), 3, 5))
    J[:, :, :3] = world_marker[ends] - world_marker[starts]
    J[:, 0, 3], J[:, 1, 3], J[:, 0, 4], J[:, 1, 4] = x, y, -y, x
    found, half = fit_in_blocks(J, moved, common.t[starts])
    arm = found[:3]
    believed = np.linalg.norm(arm) > LEAST_LEVER + np.linalg.norm(half[:3])
    return Lever(arm=arm, half_width=half[:3], used=arm if believed else np.zeros(3))


PREFIX = "mocap_"


def aligned_columns(
    log: Log, poses: Poses, clock: Clock, body_marker: Rotation, frame: Frame, lever: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return mocap_theta, _phi, _psi (N,) [rad] and, with an origin, mocap_x, _y, _z (N,) [m] on the log's rows.

    Parameters
    ----------
    log : Log
    poses : Poses
        All seen, without flips.
    clock : Clock
    body_marker : Rotation
        Marker frame to the log's body frame.
    frame : Frame
    lever : ndarray (3,)
        From the ball's centre to the point tracked [m], marker frame.
    """
    t = clock.to_cameras(log.t)
    world_body = frame.camera_world.inv() * poses.rotations * body_marker.inv()
    inside, between = _bracketed(t, poses.t, longest_bridge(poses.t))
    angles = np.full((len(t), 3), np.nan)
    if inside.any():
        angles[inside] = Slerp(poses.t, world_body)(t[inside]).as_euler("XYZ")
        angles[inside, 2] = _nearest_turn(angles[inside, 2], log, inside)
    angles[~between] = np.nan
    columns = {f"{PREFIX}{name}": angles[:, i] for i, name in enumerate(("theta", "phi", "psi"))}
    if frame.origin is not None:
        centers = poses.places - poses.rotations.apply(lever) - frame.origin
        places = _places(t, poses, frame.camera_world.inv().apply(centers))
        columns |= {f"{PREFIX}{name}": places[:, i] for i, name in enumerate("xyz")}
    return columns


def _places(t: NDArray[np.float64], poses: Poses, centers: NDArray[np.float64]) -> NDArray[np.float64]:
    known = whole_rows(centers)
    if known.sum() < 2:
        return np.full((len(t), 3), np.nan)
    _, between = _bracketed(t, poses.t[known], longest_bridge(poses.t))
    columns = [np.interp(t, poses.t[known], centers[known, i]) for i in range(3)]
    return np.where(between[:, None], np.column_stack(columns), np.nan)


def _bracketed(
    t: NDArray[np.float64], seen: NDArray[np.float64], longest: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which times (N,) lie within those seen, and which between two no further apart than `longest`."""
    inside = (t >= seen[0]) & (t <= seen[-1])
    after = np.clip(np.searchsorted(seen, t), 1, len(seen) - 1)
    return inside, inside & (seen[after] - seen[after - 1] <= longest)


def _nearest_turn(psi: NDArray[np.float64], log: Log, rows: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the heading seen on those rows of the log with the whole turns that keep it near the log's.

    The difference of the two is slow, so that turns in a gap are not lost.
    """
    known = np.isfinite(log["psi"])
    logged = np.interp(log.t[rows], log.t[known], log["psi"][known])
    off = np.unwrap(psi - logged)
    return logged + off - 2.0 * np.pi * np.round(off[0] / (2.0 * np.pi))
