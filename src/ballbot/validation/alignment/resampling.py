"""Motion capture on the log's clock and in the log's world: what it would have logged, NaN where nothing was seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ballbot.log import Log
from ballbot.log.poses import Poses
from ballbot.validation.alignment.clock import Clock
from ballbot.validation.alignment.frame import Frame
from ballbot.validation.alignment.turning import longest_bridge, whole_rows

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
