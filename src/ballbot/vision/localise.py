"""The ball's orientation with nothing known: many rotations tried, the best refined, the best of those kept.

Seams have symmetries: several orientations look alike, and any of them will do, for the angular velocity is the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.vision.ball_pixels import BallPixels
from ballbot.vision.fit import Fit, SeamPoints, fit_rotation
from ballbot.vision.seams import Seam
from ballbot.vision.sphere_table import SeamTable

#: rotations tried: evenly, 15 degrees to the next
_TRIED = 2304
#: points of the frame that they are tried with, and how many of them are refined
_POINTS, _REFINED = 160, 24
#: a point farther from the curve than this is as bad as any [rad]
_FAR = 0.3
_REACHES = (0.5, 0.4, 0.3, 0.25, 0.2, 0.16, 0.13, 0.13)
#: points of the curve by which it is judged whether the seam is seen where it should be
_CURVE_POINTS = 400
#: share of a seam pixel that counts as seen
_SEEN = 0.15


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A fit, and how much of the seam that should be seen is seen."""

    fit: Fit
    cover: float

    @property
    def quality(self) -> float:
        """The smaller of what is explained of the pixels and what is seen of the curve, 0 to 1."""
        return min(self.fit.inliers, self.cover)


@dataclass(frozen=True, kw_only=True, eq=False)
class Judge:
    """What orientations are tried and judged with."""

    table: SeamTable
    pixels: BallPixels
    curve: NDArray[np.float64]  #: (k, 3) points of the seam, ball frame

    def judge(self, fit: Fit, seam: NDArray[np.float32]) -> Judged:
        """Return a fit with the share of the curve, where a pixel is used, that a frame's pixels (m,) show."""
        pixels, _ = self.pixels.view.project(self.curve @ fit.R.T)
        facing = (self.curve @ fit.R.T) @ self.pixels.toward > self.pixels.rim
        index = self.pixels.index_at(pixels[facing])
        index = index[index >= 0]
        cover = float(np.mean(seam[index] > _SEEN)) if len(index) else 0.0
        return Judged(fit=fit, cover=cover)

    def localise(
        self, seen: SeamPoints, seam: NDArray[np.float32], *, near: NDArray[np.float64] | None
    ) -> Judged:
        """Return the best orientation for a frame.

        Parameters
        ----------
        seen : SeamPoints
        seam : ndarray (m,)
            From `SeamFinder.find`.
        near : ndarray (3, 3), optional
            Among orientations as good, the nearest to this one is taken.
        """
        # those with more weight are likelier to be chosen; the same for the same frame
        chosen = np.searchsorted(np.cumsum(seen.area), np.linspace(0.0, 0.999, _POINTS) * seen.area.sum())
        few = seen.p[np.minimum(chosen, len(seen.p) - 1)]
        grid = _grid().astype(np.float32)
        q = np.einsum("pi,gij->gpj", few, grid).reshape(-1, 3)
        r = np.einsum("ki,ki->k", q, self.table.normals_at(q)).reshape(len(grid), -1)
        cost = np.minimum(r * r, np.float32(_FAR**2)).mean(axis=1)
        best = [
            self.judge(fit_rotation(self.table, seen, grid[k].astype(np.float64), reaches=_REACHES), seam)
            for k in np.argsort(cost, kind="stable")[:_REFINED]
        ]
        top = max(best, key=lambda one: one.quality)
        if near is None:
            return top
        alike = [one for one in best if one.quality > 0.97 * top.quality]
        return max(alike, key=lambda one: float(np.trace(one.fit.R.T @ near)))


def make_judge(seam: Seam, table: SeamTable, pixels: BallPixels) -> Judge:
    """Return what orientations of a ball with that seam are judged with."""
    points = seam.points
    return Judge(table=table, pixels=pixels, curve=points[:: max(1, len(points) // _CURVE_POINTS)])


def _grid() -> NDArray[np.float64]:
    """Return rotations (n, 3, 3) spread evenly: the super-Fibonacci spiral (M. Alexa, CVPR 2022, 8281-8290)."""
    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(_TRIED) + 0.5
    t, d = s / _TRIED, 2.0 * np.pi * s
    r, R = np.sqrt(t), np.sqrt(1.0 - t)
    alpha, beta = d / phi, d / psi
    quaternions = np.column_stack([r * np.sin(alpha), r * np.cos(alpha), R * np.sin(beta), R * np.cos(beta)])
    return Rotation.from_quat(quaternions).as_matrix()
