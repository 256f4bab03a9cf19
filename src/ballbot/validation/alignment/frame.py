"""The cameras' frame against the log's world.

    R_seen = R_camera_world R_world_body R_body_marker
    p_seen = R_camera_world p_world + origin + R_seen lever

The log's own angles and position tell the first and the origin. Its heading drifts, so the vertical comes from the
whole log (R_seen R_marker_body R_body_world takes it to the cameras' frame whatever the heading), heading and origin
from the first two seconds. A constant error of the lean angles cannot be told from a tilt of the frame and goes into
it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.poses import Poses
from ballbot.validation.alignment.motion_fit import MotionFit
from ballbot.validation.alignment.turning import log_rotations

#: heading and origin are those of the first so many seconds
START = 2.0
_LEAST_ROWS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Common:
    """Poses at times that the log has as well."""

    t: NDArray[np.float64]  #: (k,) [s], the log's clock
    camera_body: Rotation  #: k of them: the log's body as the cameras saw it
    world_body: Rotation  #: k of them, by the log's angles
    places: NDArray[np.float64]  #: (k, 3) [m], the cameras' frame; NaN where there is none
    positions: NDArray[np.float64]  #: (k, 2) [m], the log's x and y; NaN where there is none


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """How the log's world stands in the cameras' frame."""

    camera_world: Rotation
    tilt_half_width: float  #: 95 % [rad]
    heading_half_width: float  #: 95 % [rad]; infinite where not told
    origin: (
        NDArray[np.float64] | None
    )  #: (3,) [m] the world's, at the ball centre's height; None without positions


def common_rows(log: Log, poses: Poses, motion: MotionFit) -> Common:
    """Return the poses that were seen while the log has its angles.

    Raises
    ------
    InputError
        Where there are hardly any.
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
        Where the first two seconds have no position.
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
