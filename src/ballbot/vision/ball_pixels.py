"""The pixels of the ball in a picture, the points of the sphere seen there, and which of them are seam in a frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.vision.colour import SeamColour, surroundings
from ballbot.vision.fit import SeamPoints
from ballbot.vision.view import View

#: pixels are joined until the ball's radius is below this: more points cost time and tell little more [pixels]
_LARGEST_RADIUS = 160.0
#: least cosine between surface and picture of a pixel that is used: nearer the rim a pixel is a wide piece of the
#: ball
LEAST_FACING = 0.25
#: of one whose colour counts as the ball's
_LEAST_BALL = 0.15
#: and of a piece of the curve that counts: across it, the seam is whole within the pixels used
_LEAST_CURVE = 0.35
#: scores at which a pixel begins to be seam, and is
_BEGINS, _WHOLLY = 0.3, 0.7
#: and begins no sooner than at so many standard deviations of the ball's
_NOISE = 3.5
#: changes by which derivatives by the view are taken: x, y [pixels], logarithm of the radius, closeness
_CHANGES = np.array([0.5, 0.5, 2e-3, 2e-3])


@dataclass(frozen=True, kw_only=True, eq=False)
class BallPixels:
    """The ball's pixels under a view."""

    view: View
    rows: slice
    columns: slice
    shape: tuple[int, int]  #: of the box once its pixels are joined
    places: NDArray[np.intp]  #: (m,) of the pixels used, in that box
    p: NDArray[np.float32]  #: (m, 3) camera frame
    area: NDArray[np.float32]  #: (m,) of the ball's surface in each, relative
    toward: NDArray[np.float32]  #: (3,) direction from the ball's centre to the lens, camera frame
    rim: float  #: what of the ball is lower than this along `toward` is too near the rim [ball radii]
    by_view: NDArray[np.float32]  #: (m, 4, 3) derivatives of p by x, y, ln radius and closeness
    index: NDArray[np.intp]  #: (rows * columns,) row in `p` of each pixel of the box, -1 where not used
    inside: NDArray[np.bool_]  #: (rows, columns) where the ball's colour is seen

    def box(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the ball's box of a frame, its pixels joined."""
        cut = frame[self.rows, self.columns]
        if cut.shape[:2] == self.shape:
            return np.ascontiguousarray(cut)
        return np.asarray(cv2.resize(cut, self.shape[::-1], interpolation=cv2.INTER_AREA), np.uint8)

    def index_at(self, pixels: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return the row in `p` (k,) of the pixel used at each place (k, 2) of the picture; -1 where there is none."""
        factor = self.shape[1] / (self.columns.stop - self.columns.start)
        column = np.rint((pixels[:, 0] - self.columns.start + 0.5) * factor - 0.5).astype(np.intp)
        row = np.rint((pixels[:, 1] - self.rows.start + 0.5) * factor - 0.5).astype(np.intp)
        within = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        return np.where(within, self.index[np.where(within, row * self.shape[1] + column, 0)], -1)


def ball_pixels(view: View, size: tuple[int, int]) -> BallPixels:
    """Return the pixels of a ball in pictures of that width and height."""
    outline = view.outline()
    low = np.maximum(np.floor(outline.min(axis=0)).astype(int) - 2, 0)
    high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 3, np.array(size))
    joined = max(1, int(np.ceil(view.radius / _LARGEST_RADIUS)))
    high = low + (high - low) // joined * joined
    columns, rows = np.arange(low[0], high[0]), np.arange(low[1], high[1])
    middles = np.stack(
        np.meshgrid(columns.reshape(-1, joined).mean(axis=1), rows.reshape(-1, joined).mean(axis=1)), axis=-1
    )
    shape = (len(rows) // joined, len(columns) // joined)
    pixels = middles.reshape(-1, 2)
    p, facing = view.points(pixels)
    facing = np.nan_to_num(facing)
    places = np.flatnonzero(facing > LEAST_FACING)
    index = np.full(len(pixels), -1, np.intp)
    index[places] = np.arange(len(places))
    return BallPixels(
        view=view,
        rows=slice(int(low[1]), int(high[1])),
        columns=slice(int(low[0]), int(high[0])),
        shape=shape,
        places=places,
        p=p[places].astype(np.float32),
        area=(1.0 / facing[places]).astype(np.float32),
        toward=-view.axis.astype(np.float32),
        rim=_height(_LEAST_CURVE, view.distance),
        by_view=_by_view(view, pixels[places]),
        index=index,
        inside=(facing > _LEAST_BALL).reshape(shape),
    )


def moved(view: View, change: NDArray[np.float64]) -> View:
    """Return a view with x, y, the logarithm of the radius and the closeness changed (4,)."""
    return replace(
        view,
        x=view.x + float(change[0]),
        y=view.y + float(change[1]),
        radius=view.radius * float(np.exp(change[2])),
        closeness=view.closeness + float(change[3]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamFinder:
    """Finds the seam's pixels in a frame."""

    pixels: BallPixels
    colour: SeamColour
    share: NDArray[np.float32]  #: from `surroundings`

    def find(self, frame: NDArray[np.uint8]) -> tuple[SeamPoints, NDArray[np.float32]]:
        """Return the seam's points, and how much each pixel used (m,) is seam, 0 to 1."""
        score = self.colour.score(self.pixels.box(frame), self.share).ravel()[self.pixels.places]
        begins = np.float32(max(_BEGINS, _NOISE * self.colour.noise))
        width = np.float32(max(_WHOLLY - begins, 0.2))
        seam = np.clip((score - begins) / width, np.float32(0.0), np.float32(1.0))
        places = np.flatnonzero(seam)
        pixels = self.pixels
        seen = SeamPoints(
            p=pixels.p[places],
            area=seam[places] * pixels.area[places],
            places=places,
            toward=pixels.toward,
            rim=pixels.rim,
        )
        return seen, seam


def seam_finder(pixels: BallPixels, colour: SeamColour) -> SeamFinder:
    """Return what finds the seam of that colour in those pixels."""
    return SeamFinder(pixels=pixels, colour=colour, share=surroundings(pixels.inside, colour.around))


def _height(facing: float, distance: float) -> float:
    """Return h with facing = (D h - 1) / sqrt(D^2 - 2 D h + 1), by its quadratic equation in D h - 1."""
    c2 = facing**2
    root = np.sqrt(c2**2 + c2 * (distance**2 - 1.0))
    return float((1.0 - c2 + root) / distance)


def _by_view(view: View, pixels: NDArray[np.float64]) -> NDArray[np.float32]:
    found = np.empty((len(pixels), 4, 3), np.float32)
    for k, change in enumerate(np.diag(_CHANGES)):
        after, before = moved(view, change).points(pixels)[0], moved(view, -change).points(pixels)[0]
        found[:, k] = (after - before) / (2.0 * _CHANGES[k])
    return found
