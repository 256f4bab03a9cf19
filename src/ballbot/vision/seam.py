"""The seam of a ball: its curve, a table of the curve by direction, and the rotation that fits seam points best.

Curves, closed on the unit sphere in the ball's own frame:

    (V.4)   x = a cos t + b cos 3t,   y = a sin t - b sin 3t,   z = c sin 2t,   b = 1 - a,   c = 2 sqrt(ab)

The thesis prints cos 3t in the second component and c = sqrt(ab); either error takes the curve off the sphere.

Table: the point of the seam that is nearest to any direction. The octahedral map lays the sphere out on a square (E.
Praun and H. Hoppe, ACM Trans. Graphics 22 (2003) 340-349):

    s = |x| + |y| + |z|;   (u, v) = (x, y) / s above the equator,   ((1 - |y|/s) sgn x, (1 - |x|/s) sgn y) below

A cell keeps n = c x tau, c the seam's point nearest to it and tau the tangent there. The great circle with the
normal n touches the seam at c, so that asin(n . q) is the distance of any q near from the seam, signed by the side,
to second order in the cell's size.

Fit, by Gauss-Newton on the distances from the curve:

    q = R^T p,   r = n(q) . q,   R <- R exp(d),   r(d) = r - d . (q x n)

p are points of the ball in the camera's frame, q the same in the ball's, n from `SeamTable`: r is the distance from
the curve, along which the point may slide (Y. Chen and G. Medioni, Image and Vision Computing 10 (1992) 145-155).
Distant points have less weight (Tukey's biweight), and none from `reach` on.

A seam is a band, and its weighted middle is the curve only if the weight is constant across the band. So a point's
weight is its area on the ball's surface, times a factor that falls toward the rim and is evaluated at the point's foot
on the curve, p - r n.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.errors import InputError, check_known

#: parameter of a curve's points: 0.003 rad apart at the most, an eighth of a seam's width
_T: Floats = np.linspace(0.0, 2.0 * np.pi, 4096, endpoint=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Seam:
    """The curve of a ball's seam."""

    name: str
    curves: tuple[Floats, ...]  #: each (n, 3), unit vectors, closed: the last meets the first

    @property
    def points(self) -> Floats:
        """All points of all curves (n, 3)."""
        return np.vstack(self.curves)

    @property
    def tangents(self) -> Floats:
        """The unit tangents (n, 3) at `points`."""
        slopes = [np.roll(curve, -1, axis=0) - np.roll(curve, 1, axis=0) for curve in self.curves]
        return np.vstack([slope / np.linalg.norm(slope, axis=1, keepdims=True) for slope in slopes])


@cache
def thesis_seam(a: float = 0.65) -> Seam:
    """Return the curve (V.4) with its two misprints corrected; InputError unless 0.5 < a < 1.

    a is in ball radii; as it approaches 1, the curve approaches a great circle.
    """
    if not 0.5 < a < 1.0:
        raise InputError(f"a of the seam is {a:g} ball radii; (V.4) needs a value between 0.5 and 1.")
    t, b = _T, 1.0 - a
    x = a * np.cos(t) + b * np.cos(3.0 * t)
    y = a * np.sin(t) - b * np.sin(3.0 * t)
    z = 2.0 * np.sqrt(a * b) * np.sin(2.0 * t)
    return Seam(name="thesis", curves=(np.column_stack([x, y, z]),))


@cache
def basketball_seam() -> Seam:
    """Return a basketball's seam of eight panels: two great circles, and an oval about each end of the x axis.

    The ovals are 45 degrees from the x axis where the great circle z = 0 intersects them and 62 degrees at their far
    ends; manufacturers differ, and none publishes a curve.
    """
    t, zero = _T, np.zeros_like(_T)
    equator = np.column_stack([np.cos(t), np.sin(t), zero])
    meridian = np.column_stack([zero, np.cos(t), np.sin(t)])
    opening = np.radians(45.0) + np.radians(17.0) * np.sin(t) ** 2
    oval = np.column_stack([np.cos(opening), np.sin(opening) * np.cos(t), np.sin(opening) * np.sin(t)])
    return Seam(name="basketball", curves=(equator, meridian, oval, oval * [-1.0, 1.0, 1.0]))


SEAMS: Mapping[str, Callable[[], Seam]] = MappingProxyType(
    {
        "thesis": thesis_seam,
        # the neck is 60 degrees wide where the thesis's is 35
        "tennis": lambda: replace(thesis_seam(0.75), name="tennis"),
        "basketball": basketball_seam,
    }
)


def seam_named(name: str) -> Seam:
    """Return the seam of that name; InputError if there is none."""
    check_known(name, SEAMS, f"There is no seam {name!r}", otherwise="the seams are")
    return SEAMS[name]()


#: cells along a side; one is about 0.006 rad across
_SIDE = 512


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamTable:
    """The seam's normals by direction."""

    seam: Seam
    normals: NDArray[np.float32]  #: (side^2, 3), ball frame

    def normals_at(self, q: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return n (k, 3) for directions q (k, 3), ball frame; n . q is the sine of the distance from the seam."""
        u, v = octahedral(q)
        scale = np.float32(0.5 * _SIDE)
        most = np.int32(_SIDE - 1)
        column = np.minimum(((u + np.float32(1.0)) * scale).astype(np.int32), most)
        row = np.minimum(((v + np.float32(1.0)) * scale).astype(np.int32), most)
        return self.normals.take(row * np.int32(_SIDE) + column, axis=0)


@lru_cache(maxsize=4)
def seam_table(seam: Seam) -> SeamTable:
    """Return the table of a seam."""
    points, tangents = seam.points, seam.tangents
    nearest = KDTree(points).query(cell_directions(_SIDE))[1]
    normals = np.cross(points[nearest], tangents[nearest])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return SeamTable(seam=seam, normals=normals.astype(np.float32))


def octahedral(q: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the coordinates u, v (k,) within -1..1 of directions (k, 3) on the square."""
    x, y, z = q[:, 0], q[:, 1], q[:, 2]
    size = np.float32(1.0) / (np.abs(x) + np.abs(y) + np.abs(z))
    u, v = x * size, y * size
    below = z < 0
    folded_u = np.copysign(np.float32(1.0) - np.abs(v), u)
    folded_v = np.copysign(np.float32(1.0) - np.abs(u), v)
    return np.where(below, folded_u, u), np.where(below, folded_v, v)


def cell_directions(side: int) -> Floats:
    """Return the directions (side^2, 3) at the middles of the cells, row by row."""
    middles = (np.arange(side) + 0.5) * (2.0 / side) - 1.0
    v, u = np.meshgrid(middles, middles, indexing="ij")
    z = 1.0 - np.abs(u) - np.abs(v)
    x = np.where(z < 0, np.copysign(1.0 - np.abs(v), u), u)
    y = np.where(z < 0, np.copysign(1.0 - np.abs(u), v), v)
    directions = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


#: weight of the start, as a fraction of the points' mean information: rotations that they do not determine keep the
#: predicted value
TRUST = 5e-4
#: cells along a diameter of the ball, which divide its seam into pieces
_PIECES = 5
#: step below which the iteration has converged [rad]
_SMALL = 2e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamPoints:
    """The seam as observed in a frame."""

    p: NDArray[np.float32]  #: (k, 3) unit vectors, camera frame
    area: NDArray[np.float32]  #: (k,) of the ball's surface, relative
    indices: NDArray[np.intp]  #: (k,) of the points among the pixels of the ball
    toward: NDArray[np.float32]  #: (3,) direction from the ball's centre to the lens, camera frame
    rim: float  #: feet lower than this along `toward` have no weight [ball radii]


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamFit:
    """A rotation, and how well the points fit it."""

    R: Floats  #: (3, 3) ball frame to camera frame
    #: (3, 3) sum of w (q x n)(q x n)^T, camera frame, as if each point erred by 1 rad
    information: Floats
    bias: Floats  #: (3, 3) covariance from the disagreement of pieces of the seam, camera frame [rad^2]
    inliers: float  #: fraction of the weight that is within reach of the curve


def fit_rotation(table: SeamTable, seen: SeamPoints, start: Floats, *, reaches: tuple[float, ...]) -> SeamFit:
    """Return the rotation near a start (3, 3), ball to camera frame, that brings three points or more onto the curve.

    `reaches` are, for each iteration, the distance from which a point has no weight [rad]. Points on one circle,
    sometimes all that is visible of a seam, do not determine the rotation about its axis, which then stays the start's.
    """
    R = start
    for reach in reaches:
        r, n, q, w = matched(table, seen, R, reach)
        lever = crossed(q, n)
        H = (lever * w[:, None]).T @ lever
        trust = TRUST / 3.0 * max(float(np.trace(H)), 1e-9)
        g = (lever.T @ (w * r)).astype(np.float64) - trust * Rotation.from_matrix(start.T @ R).as_rotvec()
        d = np.linalg.solve(H.astype(np.float64) + trust * np.eye(3), g).astype(np.float64)
        R = R @ Rotation.from_rotvec(d).as_matrix()
        if float(d @ d) < _SMALL**2 and reach == reaches[-1]:
            break
    return _scored(table, seen, R, reaches[-1])


def matched(
    table: SeamTable, seen: SeamPoints, R: Floats, reach: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return distances r (k,), normals n (k, 3) and points q (k, 3) in the ball's frame, and weights (k,)."""
    turned = R.astype(np.float32)
    q = seen.p @ turned
    n = table.normals_at(q)
    r = np.einsum("ki,ki->k", q, n)
    toward = seen.toward @ turned
    rim = np.float32(seen.rim)
    foot = (q @ toward - r * (n @ toward) - rim) / (np.float32(1.0) - rim)
    share = np.maximum(np.float32(1.0) - (r / np.float32(reach)) ** 2, np.float32(0.0))
    return r, n, q, seen.area * np.maximum(foot, np.float32(0.0)) * share * share


def crossed(q: NDArray[np.float32], n: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return q x n (k, 3)."""
    lever = np.empty_like(q)
    lever[:, 0] = q[:, 1] * n[:, 2] - q[:, 2] * n[:, 1]
    lever[:, 1] = q[:, 2] * n[:, 0] - q[:, 0] * n[:, 2]
    lever[:, 2] = q[:, 0] * n[:, 1] - q[:, 1] * n[:, 0]
    return lever


def _scored(table: SeamTable, seen: SeamPoints, R: Floats, reach: float) -> SeamFit:
    r, n, q, w = matched(table, seen, R, reach)
    lever = crossed(q, n)
    H = ((lever * w[:, None]).T @ lever).astype(np.float64)
    return SeamFit(
        R=R,
        information=R @ H @ R.T,
        bias=R @ _disagreement(H, lever * (w * r)[:, None], q - r[:, None] * n) @ R.T,
        inliers=float(seen.area[np.abs(r) < reach].sum()) / max(float(seen.area.sum()), 1e-9),
    )


def piece_of(feet: Floats | NDArray[np.float32], cells: int) -> NDArray[np.intp]:
    """Return the piece (k,) of the seam that each foot (k, 3) is on: a cell of the cube about the ball."""
    cell = np.minimum(((feet + 1.0) * (0.5 * cells)).astype(np.intp), cells - 1)
    return (cell[:, 0] * cells + cell[:, 1]) * cells + cell[:, 2]


def _disagreement(H: Floats, pulls: Floats, feet: Floats) -> Floats:
    """Return the rotation's covariance (3, 3) by the gradients (k, 3) of points, clustered by piece of the seam.

    The pieces are cells of the points' feet (k, 3). The sandwich estimator of K.-Y. Liang and S. Zeger, Biometrika 73
    (1986) 13-22: blur, shadows, a wrong view or a wrong curve act alike within a piece and differently on the next.
    """
    piece = piece_of(feet, _PIECES)
    sums = np.stack([np.bincount(piece, weights=pulls[:, axis]) for axis in range(3)])
    inverse = np.linalg.inv(H + TRUST / 3.0 * max(float(np.trace(H)), 1e-9) * np.eye(3))
    return inverse @ (sums @ sums.T) @ inverse
