"""The lever arm from the ball's centre to the point that the cameras track.

Over half a second, in the world's frame and with d the heading's error,

    R_wc (p_k+1 - p_k) = (R_wm,k+1 - R_wm,k) a + [c -s; s c] Rz(-d) (x y)_k+1 - (x y)_k ,      height: no change

linear in the arm a (marker frame), c and s; the last two let the log's path be longer than it was, or turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.validation.alignment.blocks import fitted
from ballbot.validation.alignment.frame import Common, Frame
from ballbot.validation.alignment.motion_fit import SPAN, MotionFit
from ballbot.validation.alignment.turning import whole_rows

_LEAST = 60
#: A ball's position computed from wheels is wrong by a little as the robot rocks (play, creep), and that looks like an
#: arm: of 3 and 5 cm on two logs whose cameras report the ball's centre itself. Below this no arm is believed [m]
BELIEVED = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Lever:
    """The arm, in the marker frame."""

    arm: NDArray[np.float64]  #: (3,) [m] as fitted
    half_width: NDArray[np.float64]  #: (3,) 95 % [m], of chance alone
    used: NDArray[np.float64]  #: (3,) [m], what is taken off: the arm, or zero where it is not believed


def fit_lever(
    common: Common, frame: Frame, motion: MotionFit, heading_error: NDArray[np.float64]
) -> Lever | None:
    """Return the lever arm, or None where log or cameras have hardly any positions.

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
    if len(starts) < _LEAST:
        return None
    world_marker = (frame.camera_world.inv() * common.camera_body * motion.body_marker).as_matrix()
    moved = frame.camera_world.inv().apply(common.places[ends] - common.places[starts])
    d = -0.5 * (heading_error[starts] + heading_error[ends])
    x, y = (common.positions[ends] - common.positions[starts]).T
    x, y = np.cos(d) * x - np.sin(d) * y, np.sin(d) * x + np.cos(d) * y
    J = np.zeros((len(starts), 3, 5))
    J[:, :, :3] = world_marker[ends] - world_marker[starts]
    J[:, 0, 3], J[:, 1, 3], J[:, 0, 4], J[:, 1, 4] = x, y, -y, x
    found, half = fitted(J, moved, common.t[starts])
    arm = found[:3]
    believed = np.linalg.norm(arm) > BELIEVED + np.linalg.norm(half[:3])
    return Lever(arm=arm, half_width=half[:3], used=arm if believed else np.zeros(3))
