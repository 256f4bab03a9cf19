"""A table over all directions: where the seam is nearest, so that a look-up answers for any point of the ball.

The sphere is laid out on a square by the octahedral map (E. Praun and H. Hoppe, ACM Trans. Graphics 22 (2003)
340-349):

    s = |x| + |y| + |z|;   (u, v) = (x, y) / s above the equator,   ((1 - |y|/s) sgn x, (1 - |x|/s) sgn y) below

A cell keeps n = c x tau, c the seam's point nearest to it and tau the tangent there. The great circle with the
normal n touches the seam at c, so that asin(n . q) is the distance of any q near from the seam, signed by the side,
to second order in the cell's size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ballbot.vision.seams import Seam

#: cells along a side; one is about 0.006 rad across
_SIDE = 512


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamTable:
    """The seam's normals by direction."""

    normals: NDArray[np.float32]  #: (side^2, 3), ball frame
    side: int

    def normals_at(self, q: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return n (k, 3) for directions q (k, 3), ball frame; n . q is the sine of the distance from the seam."""
        u, v = octahedral(q)
        scale = np.float32(0.5 * self.side)
        most = np.int32(self.side - 1)
        column = np.minimum(((u + np.float32(1.0)) * scale).astype(np.int32), most)
        row = np.minimum(((v + np.float32(1.0)) * scale).astype(np.int32), most)
        return self.normals.take(row * np.int32(self.side) + column, axis=0)


def seam_table(seam: Seam) -> SeamTable:
    """Return the table of a seam."""
    points, tangents = seam.points, seam.tangents
    nearest = KDTree(points).query(cell_directions(_SIDE))[1]
    normals = np.cross(points[nearest], tangents[nearest])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return SeamTable(normals=normals.astype(np.float32), side=_SIDE)


def octahedral(q: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the place (u, v), each (k,) within -1..1, of directions (k, 3) on the square."""
    x, y, z = q[:, 0], q[:, 1], q[:, 2]
    size = np.float32(1.0) / (np.abs(x) + np.abs(y) + np.abs(z))
    u, v = x * size, y * size
    below = z < 0
    folded_u = np.copysign(np.float32(1.0) - np.abs(v), u)
    folded_v = np.copysign(np.float32(1.0) - np.abs(u), v)
    return np.where(below, folded_u, u), np.where(below, folded_v, v)


def cell_directions(side: int) -> NDArray[np.float64]:
    """Return the directions (side^2, 3) at the middles of the cells, row by row."""
    middles = (np.arange(side) + 0.5) * (2.0 / side) - 1.0
    v, u = np.meshgrid(middles, middles, indexing="ij")
    z = 1.0 - np.abs(u) - np.abs(v)
    x = np.where(z < 0, np.copysign(1.0 - np.abs(v), u), u)
    y = np.where(z < 0, np.copysign(1.0 - np.abs(u), v), v)
    directions = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
