"""What cameras tell of a balancing robot, in its body's own frame, so that the cameras' frame does not matter.

    body's turning        sum of log(R_k^T R_k+1)
    ball's rolling        sum of up x R_k^T (p_k+1 - p_k), in metres; divided by r_b it is the turning of a ball that
                          rolls without slip

`up` is the mean direction of the body's z axis while it is upright: an error of e in it changes the rolling by e^2/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.poses import read_poses

#: beyond this angle from upright [rad] a robot is falling or in hands
LARGEST_LEAN = 0.35


@dataclass(frozen=True, kw_only=True, eq=False)
class Film:
    """Running totals at the cameras' times, in the body's frame."""

    t: NDArray[np.float64]  #: (M,) [s], the cameras' clock
    turning: NDArray[np.float64]  #: (M, 3) [rad]
    rolling: NDArray[np.float64]  #: (M, 3) [m]
    missing: NDArray[np.float64]  #: (M,), running number of intervals without a pose or with a falling robot

    def rolling_at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rolling (k, 3) at times (k,) of the cameras' clock."""
        return _at(t, self.t, self.rolling)

    def covers(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which windows (w,) the cameras saw whole."""
        inside = (start > self.t[0]) & (end < self.t[-1])
        missed = self.missing[np.clip(np.searchsorted(self.t, end), 0, len(self.t) - 1)]
        before = self.missing[np.clip(np.searchsorted(self.t, start) - 1, 0, len(self.t) - 1)]
        return inside & (missed == before)


def read_film(film: Log) -> Film:
    """Return the running totals of a log of motion capture: t, x y z of the ball's centre, qw qx qy qz of the body.

    Raises
    ------
    InputError
        Where a column is missing, or the robot is hardly ever seen upright.
    """
    poses = read_poses(film)
    seen = poses.seen & np.isfinite(poses.places).all(axis=1)
    if seen.sum() < 10:
        raise InputError(
            "The motion capture has no poses; it needs the columns "
            "x, y, z and the unit quaternion qw, qx, qy, qz."
        )
    # an unseen pose is filled with the one before, so that nothing moves; `missing` counts it
    last = np.maximum.accumulate(np.where(seen, np.arange(len(seen)), np.argmax(seen)))
    positions, rotations = poses.places[last], Rotation.from_quat(poses.rotations.as_quat()[last])
    axis = rotations.apply([0.0, 0.0, 1.0])
    up = np.median(axis[seen], axis=0)
    up /= np.linalg.norm(up)
    upright = axis @ up > np.cos(LARGEST_LEAN)
    turns = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
    middle = (rotations[:-1] * Rotation.from_rotvec(0.5 * turns)).inv()
    rolls = np.cross(middle.apply(up), middle.apply(np.diff(positions, axis=0)))
    usable = seen & upright
    whole = usable[1:] & usable[:-1]
    missing = np.concatenate([[0.0], np.cumsum(~whole)])
    turns, rolls = np.where(whole[:, None], turns, 0.0), np.where(whole[:, None], rolls, 0.0)
    return Film(t=film.t, turning=_total(turns), rolling=_total(rolls), missing=missing)


def _total(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def _at(
    t: NDArray[np.float64], times: NDArray[np.float64], total: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.column_stack([np.interp(t, times, column) for column in total.T])
