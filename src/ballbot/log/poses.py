"""Poses out of a log of motion capture: t, x y z of a point, qw qx qy qz of a body; NaN where nothing was seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log.log import Log

QUATERNION_NAMES = ("qw", "qx", "qy", "qz")
PLACE_NAMES = ("x", "y", "z")
#: how far from one a quaternion's norm may be and still mean an orientation
_NORM_TOLERANCE = 0.1
_LEAST_POSES = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Poses:
    """What cameras saw, in their frame and on their clock."""

    t: NDArray[np.float64]  #: (M,) [s]
    rotations: Rotation  #: M of them, body to cameras; where unseen, the one seen last
    seen: NDArray[np.bool_]  #: (M,), the orientation is there
    places: NDArray[np.float64]  #: (M, 3) [m]; NaN where there is none

    def seen_only(self) -> Poses:
        """Return the poses whose orientation is there; where cameras saw nothing there is a gap in their times."""
        return Poses(
            t=self.t[self.seen],
            rotations=Rotation.from_quat(self.rotations.as_quat()[self.seen]),
            seen=self.seen[self.seen],
            places=self.places[self.seen],
        )


def read_poses(film: Log) -> Poses:
    """Return the poses of a log of motion capture; without x, y and z the places are NaN.

    Raises
    ------
    InputError
        Where there are no unit quaternions qw, qx, qy, qz.
    """
    wxyz = np.column_stack([film[name] for name in QUATERNION_NAMES])
    seen = np.isfinite(wxyz).all(axis=1) & (np.abs(np.linalg.norm(wxyz, axis=1) - 1.0) < _NORM_TOLERANCE)
    if seen.sum() < _LEAST_POSES:
        raise InputError("The motion capture has no poses; it needs unit quaternions in qw, qx, qy, qz.")
    last = np.maximum.accumulate(np.where(seen, np.arange(len(seen)), np.argmax(seen)))
    placed = all(name in film for name in PLACE_NAMES)
    places = np.column_stack([film[n] for n in PLACE_NAMES]) if placed else np.full((len(seen), 3), np.nan)
    return Poses(
        t=film.t,
        rotations=Rotation.from_quat(wxyz[last][:, [1, 2, 3, 0]]),
        seen=seen,
        places=np.where(np.isfinite(places).all(axis=1, keepdims=True), places, np.nan),
    )
