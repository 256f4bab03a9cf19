"""The ball's orientation: found with nothing known, then followed through a video, frame by frame.

To find it, many rotations are tried, the best are refined, and the best of those is kept. Seams have symmetries:
several orientations look alike, and any of them will do, for the angular velocity is the same.

To follow it, each frame's fit starts where the last angular velocity leads. A frame is lost where too little of the
seam's pixels is explained, or too little of the curve is seen. Where it cannot be followed the orientation is searched
for anew, at once and then in every fourth frame. Frames belong to one stretch as long as each follows from the one
before; from one stretch to the next the ball may be another of its symmetric selves.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.vision.seam import Fit, SeamPoints, SeamTable, exponential, fit_rotation, logarithm
from ballbot.vision.seam_pixels import BallPixels, SeamFinder

#: rotations tried: evenly, 15 degrees to the next
_TRIED = 2304
#: points of the frame that they are tried with, and how many of them are refined
_POINTS, _REFINED = 160, 24
#: a point farther from the curve than this is as bad as any [rad]
_FAR = 0.3
_SEARCH_REACHES = (0.5, 0.4, 0.3, 0.25, 0.2, 0.16, 0.13, 0.13)
#: points of the curve by which it is scored how much of the seam is seen where it should be
_CURVE_POINTS = 400
#: share of a seam pixel that counts as seen
_SEEN = 0.15


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoredFit:
    """A fit, and how much of the seam that should be seen is seen."""

    fit: Fit
    cover: float

    @property
    def quality(self) -> float:
        """The smaller of what is explained of the pixels and what is seen of the curve, 0 to 1."""
        return min(self.fit.inliers, self.cover)


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientationSearch:
    """Tries orientations and scores them."""

    table: SeamTable
    pixels: BallPixels
    curve: NDArray[np.float64]  #: (k, 3) points of the seam, ball frame

    def score(self, fit: Fit, seam: NDArray[np.float32]) -> ScoredFit:
        """Return a fit with the share of the curve, where a pixel is used, that a frame's pixels (m,) show."""
        pixels, _ = self.pixels.view.project(self.curve @ fit.R.T)
        facing = (self.curve @ fit.R.T) @ self.pixels.toward > self.pixels.rim
        index = self.pixels.index_at(pixels[facing])
        index = index[index >= 0]
        cover = float(np.mean(seam[index] > _SEEN)) if len(index) else 0.0
        return ScoredFit(fit=fit, cover=cover)

    def localise(
        self, seen: SeamPoints, seam: NDArray[np.float32], *, near: NDArray[np.float64] | None
    ) -> ScoredFit:
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
            self.score(
                fit_rotation(self.table, seen, grid[k].astype(np.float64), reaches=_SEARCH_REACHES), seam
            )
            for k in np.argsort(cost, kind="stable")[:_REFINED]
        ]
        top = max(best, key=lambda one: one.quality)
        if near is None:
            return top
        alike = [one for one in best if one.quality > 0.97 * top.quality]
        return max(alike, key=lambda one: float(np.trace(one.fit.R.T @ near)))


def orientation_search(table: SeamTable, pixels: BallPixels) -> OrientationSearch:
    """Return the search for orientations of a ball with the table's seam."""
    points = table.seam.points
    return OrientationSearch(
        table=table, pixels=pixels, curve=points[:: max(1, len(points) // _CURVE_POINTS)]
    )


def _grid() -> NDArray[np.float64]:
    """Return rotations (n, 3, 3) spread evenly: the super-Fibonacci spiral (M. Alexa, CVPR 2022, 8281-8290)."""
    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(_TRIED) + 0.5
    t, d = s / _TRIED, 2.0 * np.pi * s
    r, R = np.sqrt(t), np.sqrt(1.0 - t)
    alpha, beta = d / phi, d / psi
    quaternions = np.column_stack([r * np.sin(alpha), r * np.cos(alpha), R * np.sin(beta), R * np.cos(beta)])
    return Rotation.from_quat(quaternions).as_matrix()


#: distances from the curve from which on pixels count nothing, by iteration [rad]: first where the start may be off
_REACHES = (0.28, 0.2, 0.14, 0.12, 0.12)
#: quality from which a frame is tracked, and from which one found anew is believed
_TRACKED, _FOUND = 0.55, 0.7
#: fewer seam pixels are no seam
_LEAST_PIXELS = 60
#: while lost, the orientation is searched for in one frame of so many
_SEARCHED_EVERY = 4
#: what a ball turns at most beyond what was predicted [rad]
_LARGEST_JUMP = 0.35


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The ball's orientation in every frame."""

    R: NDArray[np.float64]  #: (n, 3, 3) ball frame to camera frame; NaN where lost
    information: NDArray[np.float64]  #: (n, 3, 3) from `Fit`, camera frame
    bias: NDArray[np.float64]  #: (n, 3, 3) from `Fit`, camera frame [rad^2]
    quality: NDArray[np.float64]  #: (n,) 0 to 1
    stretch: NDArray[np.int64]  #: (n,) number of the stretch; -1 where lost

    @property
    def tracked(self) -> NDArray[np.bool_]:
        """Which frames (n,) were tracked."""
        return self.stretch >= 0


class _Follower:
    """The state between frames."""

    def __init__(self, finder: SeamFinder, search: OrientationSearch) -> None:
        self._finder, self._search = finder, search
        self._last: NDArray[np.float64] | None = None
        self._turn = np.zeros(3)  # over the last frame, camera frame [rad]
        self._settled = False  # whether that is known
        self._lost = 0  # frames since the last that was tracked
        self._stretch = -1

    def next(self, frame: NDArray[np.uint8]) -> tuple[Fit, float, int] | None:
        """Return the orientation, its quality and its stretch; None where it is lost."""
        seen, seam = self._finder.find(frame)
        scored = None
        if len(seen.p) >= _LEAST_PIXELS:
            scored = self._followed(seen, seam) or self._searched(seen, seam)
        if scored is None:
            self._lost += 1
            self._settled = False
            return None
        self._lost = 0
        return scored.fit, scored.quality, self._stretch

    def _followed(self, seen: SeamPoints, seam: NDArray[np.float32]) -> ScoredFit | None:
        if self._last is None or self._lost > 1:
            return None
        turn = self._turn * (1.0 + self._lost)
        predicted = exponential(turn) @ self._last
        scored = self._search.score(fit_rotation(self._search.table, seen, predicted, reaches=_REACHES), seam)
        jump = float(np.linalg.norm(logarithm(scored.fit.R @ predicted.T)))
        if scored.quality < _TRACKED or jump > _LARGEST_JUMP:
            if self._settled:
                return None
            # the second frame of a stretch: how fast the ball turns is not known yet
            scored = self._search.localise(seen, seam, near=self._last)
            if scored.quality < _FOUND:
                return None
        whole = logarithm(scored.fit.R @ self._last.T) / (1.0 + self._lost)
        if np.linalg.norm(whole) > 1.0:  # another of the symmetric selves
            return None
        self._turn, self._last, self._settled = whole, scored.fit.R, True
        return scored

    def _searched(self, seen: SeamPoints, seam: NDArray[np.float32]) -> ScoredFit | None:
        if self._last is not None and self._lost % _SEARCHED_EVERY:
            return None
        scored = self._search.localise(seen, seam, near=self._last)
        if scored.quality < _FOUND:
            return None
        self._last, self._turn, self._settled = scored.fit.R, np.zeros(3), False
        self._stretch += 1
        return scored


def follow(
    frames: Iterable[NDArray[np.uint8]],
    finder: SeamFinder,
    search: OrientationSearch,
    *,
    frame_count: int = 0,
    progress: ProgressCallback = ignore_progress,
) -> Track:
    """Return the orientation in every frame.

    Parameters
    ----------
    frames : iterable of ndarray (height, width, 3) uint8
    finder : SeamFinder
    search : OrientationSearch
    frame_count : int, optional
        How many there are at most, for the progress; 0 if that is not known.
    progress : callable, optional
        Called after each frame.
    """
    follower = _Follower(finder, search)
    nothing = np.full((3, 3), np.nan)
    R, information, bias, quality, stretch = [], [], [], [], []
    for count, frame in enumerate(frames, start=1):
        found = follower.next(frame)
        fit, score, number = found or (None, 0.0, -1)
        R.append(fit.R if fit else nothing)
        information.append(fit.information if fit else nothing)
        bias.append(fit.bias if fit else nothing)
        quality.append(score)
        stretch.append(number)
        total = frame_count or 1
        progress(Progress(stage="tracking", done=min(count, total), total=total))
    return Track(
        R=np.array(R).reshape(-1, 3, 3),
        information=np.array(information).reshape(-1, 3, 3),
        bias=np.array(bias).reshape(-1, 3, 3),
        quality=np.array(quality),
        stretch=np.array(stretch, dtype=np.int64),
    )
