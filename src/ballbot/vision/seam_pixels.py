"""The pixels of the ball in a picture, the points of the sphere seen there, and which of them are seam.

A pixel's score, 0 on the ball and 1 on the seam whatever the light, is computed from its colour.

    score = w . (l - mean of l around without the seam),      l = log of blue, green, red

In logarithms light adds the same to all three channels. Fisher's discriminant w (R. A. Fisher, Annals of Eugenics 7
(1936) 179-188), learned from the video itself, is therefore insensitive to light and shadow if the seam has a colour,
and uses brightness if it has none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.vision.seam import SeamPoints
from ballbot.vision.view import View

#: grey levels added before the logarithm, so that the noise of dark pixels does not grow without bound
_FLOOR = 12.0
#: standard deviation of the blur that is applied first [pixels]
_BLUR = 0.8
#: standard deviations assumed even if the first seconds show less: noise in each channel [grey levels], shadow as a
#: fraction of the light, and reflected white [grey levels]
_COLOUR_NOISE, _SHADOW, _REFLECTION = 3.0, 0.3, 15.0
#: side of the surroundings that a pixel is compared with, in radii of the ball
_AROUND = 0.5
#: smallest separation of seam and ball, in standard deviations, at which a seam is visible
_LEAST_SEPARATION = 1.7
#: score below which a pixel is certainly not seam
_NOT_SEAM = 0.3
#: keeps a quotient finite without ball around
_LEAST_SHARE = np.float32(1e-3)
#: largest fraction of a ball that a seam covers
_MOST_SEAM = 0.35
#: passes of learning the discriminant, each with surroundings that contain less of the seam
_PASSES = 3
#: most pixels that it is learned from
_MOST_PIXELS = 40_000
_LOGS = np.log(np.arange(256, dtype=np.float32) + np.float32(_FLOOR))


_NO_SEAM = (
    "No seam stands out from the ball. Give the ball's circle (--circle), or use a seam of another colour."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamColour:
    """Discriminates seam from ball by colour."""

    table: NDArray[np.float32]  #: (256, 3) w log(level), by channel
    around: int  #: side of the surroundings [pixels]
    noise: float  #: standard deviation of the score on the ball
    separation: float  #: of the two, in standard deviations of both

    def score(self, picture: NDArray[np.uint8], share: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the score (rows, columns) of a picture (rows, columns, 3); `share` is that of a `SeamFinder`."""
        logs = cv2.LUT(picture, self.table[:, None, :])
        value = np.asarray(cv2.GaussianBlur(cv2.transform(logs, np.ones((1, 3), np.float32)), (0, 0), _BLUR))
        inside = (share > 0.0).astype(np.float32)
        mean = _mean(value * inside, self.around) / np.maximum(share, _LEAST_SHARE)
        # again without the seam, which biases the mean
        ball = inside * (value - mean < np.float32(_NOT_SEAM))
        mean = _mean(value * ball, self.around) / np.maximum(_mean(ball, self.around), _LEAST_SHARE)
        return np.asarray((value - mean) * inside, np.float32)


def learn_colour(pictures: Sequence[NDArray[np.uint8]], inside: Bools, *, radius: float) -> SeamColour:
    """Learn what discriminates seam from ball in pictures (rows, columns, 3) of a ball of that radius [pixels].

    The seam is the most distinct minority of pixels against its surroundings. `inside` (rows, columns) marks the ball.
    InputError if no colour is distinct enough.
    """
    around = 2 * max(2, round(0.5 * _AROUND * radius)) + 1
    step = max(1, int(np.sqrt(inside.sum() * len(pictures) / _MOST_PIXELS)))
    chosen = np.zeros_like(inside)
    chosen[::step, ::step] = inside[::step, ::step]
    logs = [np.asarray(cv2.GaussianBlur(_LOGS[picture], (0, 0), _BLUR), np.float32) for picture in pictures]
    ball = inside.astype(np.float32)
    levels = np.median(np.concatenate([picture[chosen] for picture in pictures]), axis=0)
    by_level = 1.0 / (levels + _FLOOR)  # of the logarithm
    noise = np.diag((_COLOUR_NOISE * by_level) ** 2) + _SHADOW**2
    noise += np.outer(by_level, by_level) * _REFLECTION**2
    detail = _detail(logs, ball, chosen, around)
    w, threshold, separation = _start(detail), 0.0, 0.0
    for _ in range(_PASSES):
        for _ in range(6):
            is_seam = _split(detail @ w)
            if is_seam is None:
                raise InputError(_NO_SEAM)
            seam, rest = detail[is_seam], detail[~is_seam]
            apart = seam.mean(axis=0) - rest.mean(axis=0)
            spread = 0.5 * (np.cov(seam.T) + np.cov(rest.T)) + noise
            w = np.linalg.solve(spread, apart)
            w /= np.linalg.norm(w)
            threshold = float(0.5 * w @ (seam.mean(axis=0) + rest.mean(axis=0)))
            separation = float(w @ apart / np.sqrt(w @ spread @ w))
        # again with surroundings that are free of the seam
        detail = _detail(logs, ball, chosen, around, (w, threshold))
    if separation < _LEAST_SEPARATION:
        raise InputError(_NO_SEAM)
    along = detail @ w
    is_seam = along > threshold
    seam, rest = along[is_seam], along[~is_seam]
    contrast = seam.mean() - rest.mean()
    return SeamColour(
        table=(_LOGS[:, None] * (w / contrast)).astype(np.float32),
        around=around,
        # by the median, because the seam's blurred edges are not noise
        noise=1.4826 * float(np.median(np.abs(rest - np.median(rest)))) / contrast,
        separation=separation,
    )


def _detail(
    logs: Sequence[NDArray[np.float32]],
    inside: NDArray[np.float32],
    chosen: Bools,
    side: int,
    seam: tuple[Floats, float] | None = None,
) -> Floats:
    """Return log colours less those around (n, 3) of the pixels chosen in pictures (rows, columns, 3).

    A seam known by direction and threshold is left out of those around.
    """
    parts = []
    for values in logs:
        detail = values - _around(values, inside, side)
        if seam is not None:
            ball = inside * (detail @ seam[0].astype(np.float32) < np.float32(0.7 * seam[1]))
            detail = values - _around(values, ball, side)
        parts.append(detail[chosen])
    return np.concatenate(parts).astype(np.float64)


def _around(values: NDArray[np.float32], ball: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    share = np.maximum(_mean(ball, side), _LEAST_SHARE)
    return np.asarray(_mean(values * ball[..., None], side) / share[..., None], np.float32)


def _start(detail: Floats) -> Floats:
    """Return the initial direction (3,), along which pixels are most distinct."""
    # seam pixels are few but distant: weights by the square of the length emphasise them
    size = np.linalg.norm(detail, axis=1)
    size = np.minimum(size, np.quantile(size, 0.999))
    direction = np.linalg.eigh((detail * size[:, None] ** 2).T @ detail)[1][:, -1]
    along = detail @ direction
    far = np.abs(along) > np.quantile(np.abs(along), 0.98)
    return direction * np.sign(np.sum(along[far]))


def _split(along: Floats) -> Bools | None:
    """Return which values (n,) belong to the rare high cluster, by 2-means; None if it is not rare."""
    is_seam = along > 0.5 * (float(np.median(along)) + float(np.quantile(along, 0.99)))
    for _ in range(12):
        if not 20 < is_seam.sum() < _MOST_SEAM * len(along):
            return None
        is_seam = along > 0.5 * (float(along[~is_seam].mean()) + float(along[is_seam].mean()))
    return is_seam if 20 < is_seam.sum() < _MOST_SEAM * len(along) else None


def _mean(values: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    return np.asarray(cv2.blur(values, (side, side), borderType=cv2.BORDER_CONSTANT), np.float32)


#: pixels are binned until the ball's radius is below this: more points cost time and add little information [pixels]
_LARGEST_RADIUS = 160.0
#: smallest cosine between surface and picture of a used pixel: nearer the rim a pixel covers a wide piece of the ball
LEAST_FACING = 0.25
#: smallest cosine of a pixel that has the ball's colour
_LEAST_BALL = 0.15
#: smallest cosine of a piece of the curve with weight: the whole width of the seam is then within the used pixels
_LEAST_CURVE = 0.35
#: scores at which a pixel begins to be seam, and is
_BEGINS, _WHOLLY = 0.3, 0.7
#: and begins at least so many standard deviations of the ball's score above zero
_LEAST_CONTRAST = 3.5


@dataclass(frozen=True, kw_only=True, eq=False)
class BallPixels:
    """The ball's pixels under a view."""

    view: View
    rows: slice
    columns: slice
    shape: tuple[int, int]  #: of the box once its pixels are joined
    indices: NDArray[np.intp]  #: (m,) of the pixels used, in that box
    p: NDArray[np.float32]  #: (m, 3) camera frame
    area: NDArray[np.float32]  #: (m,) of the ball's surface in each, relative
    toward: NDArray[np.float32]  #: (3,) direction from the ball's centre to the lens, camera frame
    rim: float  #: points lower than this along `toward` are too near the rim [ball radii]
    index: NDArray[np.intp]  #: (rows * columns,) row in `p` of each pixel of the box, -1 where not used
    inside: Bools  #: (rows, columns) whether the ball's colour is visible

    def box(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the ball's box of a frame, its pixels joined."""
        cut = frame[self.rows, self.columns]
        if cut.shape[:2] == self.shape:
            return np.ascontiguousarray(cut)
        return np.asarray(cv2.resize(cut, self.shape[::-1], interpolation=cv2.INTER_AREA), np.uint8)

    def index_at(self, pixels: Floats) -> NDArray[np.intp]:
        """Return the row in `p` (k,) of the pixel used at each place (k, 2) of the picture; -1 without one."""
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
    middles = np.meshgrid(*(places.reshape(-1, joined).mean(axis=1) for places in (columns, rows)))
    pixels, shape = np.stack(middles, axis=-1).reshape(-1, 2), middles[0].shape
    p, facing = view.points(pixels)
    facing = np.nan_to_num(facing)
    indices = np.flatnonzero(facing > LEAST_FACING)
    index = np.full(len(pixels), -1, np.intp)
    index[indices] = np.arange(len(indices))
    # facing = (D h - 1) / sqrt(D^2 - 2 D h + 1) gives h, by its quadratic equation in D h - 1
    c2 = _LEAST_CURVE**2
    return BallPixels(
        view=view,
        rows=slice(int(low[1]), int(high[1])),
        columns=slice(int(low[0]), int(high[0])),
        shape=shape,
        indices=indices,
        p=p[indices].astype(np.float32),
        area=(1.0 / facing[indices]).astype(np.float32),
        toward=-view.axis.astype(np.float32),
        rim=float((1.0 - c2 + np.sqrt(c2**2 + c2 * (view.distance**2 - 1.0))) / view.distance),
        index=index,
        inside=(facing > _LEAST_BALL).reshape(shape),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamFinder:
    """Finds the seam of a colour among the pixels of the ball."""

    pixels: BallPixels
    colour: SeamColour

    @cached_property
    def share(self) -> NDArray[np.float32]:
        """What part (rows, columns) of each pixel's surroundings is ball; 0 beside the ball."""
        inside = self.pixels.inside
        return _mean(inside.astype(np.float32), self.colour.around) * inside

    def find(self, frame: NDArray[np.uint8]) -> tuple[SeamPoints, NDArray[np.float32]]:
        """Return the seam's points, and how much each pixel used (m,) is seam, 0 to 1."""
        score = self.colour.score(self.pixels.box(frame), self.share).ravel()[self.pixels.indices]
        begins = np.float32(max(_BEGINS, _LEAST_CONTRAST * self.colour.noise))
        width = np.float32(max(_WHOLLY - begins, 0.2))
        seam = np.clip((score - begins) / width, np.float32(0.0), np.float32(1.0))
        used, pixels = np.flatnonzero(seam), self.pixels
        area = seam[used] * pixels.area[used]
        seen = SeamPoints(p=pixels.p[used], area=area, indices=used, toward=pixels.toward, rim=pixels.rim)
        return seen, seam
