"""The best rotation for points of the seam seen in one frame: Gauss-Newton on the distances from the curve.

    q = R^T p,   r = n(q) . q,   R <- R exp(d),   r(d) = r - d . (q x n)

p are points of the ball in the camera's frame, q the same in the ball's, n from `SeamTable`: r is the distance from
the curve, and the point may slide along it (Y. Chen and G. Medioni, Image and Vision Computing 10 (1992) 145-155).
Points far off count less (Tukey's biweight), and from `reach` on not at all.

A seam is a band, and the middle of a band is the curve only if weights do not change across it. So a point weighs
as its piece of the ball's surface, times a factor that falls toward the rim and is taken at the foot, p - r n, on
the curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.vision.rotations import exponential, logarithm
from ballbot.vision.sphere_table import SeamTable

#: of the start, as a share of the points' mean information: what they do not tell stays as it was predicted
TRUST = 5e-4
#: cells along a diameter of the ball, that cut its seam into pieces
_PIECES = 5
#: a step below this is none [rad]
_SMALL = 2e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamPoints:
    """Where the seam was seen in a frame."""

    p: NDArray[np.float32]  #: (k, 3) unit vectors, camera frame
    area: NDArray[np.float32]  #: (k,) of the ball's surface, relative
    places: NDArray[np.intp]  #: (k,) which pixels of the ball these are
    toward: NDArray[np.float32]  #: (3,) direction from the ball's centre to the lens, camera frame
    rim: float  #: feet lower than this along `toward` count nothing [ball radii]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A rotation and what the points say of it."""

    R: NDArray[np.float64]  #: (3, 3) ball frame to camera frame
    information: NDArray[
        np.float64
    ]  #: (3, 3) sum of w (q x n)(q x n)^T, camera frame, as if each point erred by 1 rad
    bias: NDArray[np.float64]  #: (3, 3) covariance by how pieces of the seam disagree, camera frame [rad^2]
    inliers: float  #: share of the weight that is within reach of the curve
    spread: float  #: rms distance of those from the curve [rad]
    step: float  #: length of the last step [rad]


def fit_rotation(
    table: SeamTable, seen: SeamPoints, start: NDArray[np.float64], *, reaches: tuple[float, ...]
) -> Fit:
    """Return the rotation near a start (3, 3) that brings the points onto the curve best.

    Points on one circle, all that is seen of some seams at times, do not tell a turn about its axis; the start does
    then.

    Parameters
    ----------
    table : SeamTable
    seen : SeamPoints
        At least three points.
    start : ndarray (3, 3)
        Ball frame to camera frame.
    reaches : tuple of float
        For each iteration, the distance from which on a point counts nothing [rad].
    """
    R = start
    d = np.zeros(3)
    for reach in reaches:
        r, n, q, w = matched(table, seen, R, reach)
        lever = crossed(q, n)
        H = (lever * w[:, None]).T @ lever
        trust = TRUST / 3.0 * max(float(np.trace(H)), 1e-9)
        g = (lever.T @ (w * r)).astype(np.float64) - trust * logarithm(start.T @ R)
        d = np.linalg.solve(H.astype(np.float64) + trust * np.eye(3), g).astype(np.float64)
        R = R @ exponential(d)
        if float(d @ d) < _SMALL**2 and reach == reaches[-1]:
            break
    return _judged(table, seen, R, reaches[-1], float(np.linalg.norm(d)))


def matched(
    table: SeamTable, seen: SeamPoints, R: NDArray[np.float64], reach: float
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


def _judged(table: SeamTable, seen: SeamPoints, R: NDArray[np.float64], reach: float, step: float) -> Fit:
    r, n, q, w = matched(table, seen, R, reach)
    lever = crossed(q, n)
    H = ((lever * w[:, None]).T @ lever).astype(np.float64)
    near = np.abs(r) < reach
    inside = float(seen.area[near].sum())
    return Fit(
        R=R,
        information=R @ H @ R.T,
        bias=R @ _disagreement(H, lever * (w * r)[:, None], q - r[:, None] * n) @ R.T,
        inliers=inside / max(float(seen.area.sum()), 1e-9),
        spread=float(np.sqrt((seen.area[near] @ r[near] ** 2) / max(inside, 1e-9))),
        step=step,
    )


def _disagreement(
    H: NDArray[np.float64], pulls: NDArray[np.float64], feet: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the rotation's covariance (3, 3) by the pulls (k, 3) of points, in whatever way those of one piece of
    the seam go together; the pieces are told by the points' feet (k, 3).

    The sandwich of K.-Y. Liang and S. Zeger, Biometrika 73 (1986) 13-22: what blur, shadows, a wrong view or a
    wrong curve do to one piece they do otherwise to the next.
    """
    cell = np.minimum(((feet + 1.0) * (0.5 * _PIECES)).astype(np.intp), _PIECES - 1)
    piece = (cell[:, 0] * _PIECES + cell[:, 1]) * _PIECES + cell[:, 2]
    sums = np.stack([np.bincount(piece, weights=pulls[:, axis]) for axis in range(3)])
    inverse = np.linalg.inv(H + TRUST / 3.0 * max(float(np.trace(H)), 1e-9) * np.eye(3))
    return inverse @ (sums @ sums.T) @ inverse
