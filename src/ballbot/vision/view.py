"""A ball in front of a pinhole camera at a finite distance: its visible points, and finding its outline in a video.

Camera frame: x to the right of the picture, y down, z away from the camera, into the scene. Pixel (0, 0) is the
middle of the first pixel. Lengths are in ball radii.

The rays that touch the ball make a cone with the half angle alpha, sin alpha = 1/D, about the ray to its centre; its
section with the picture is the outline, a circle only if the ball is in the middle of the picture. The points of
contact are nearer to the camera than the centre is, by 1/D: the outline is not the equator, and less than half of the
ball is visible.

    p = s d - D c,    s = D d.c - sqrt(1 - D^2 (1 - (d.c)^2)),    f = r / tan alpha = r sqrt(D^2 - 1)

The outline is found by a Hough transform for circles, each of which is scored by its edge. The median over frames,
pixel by pixel, removes the turning seam and keeps what stands still. Along rays from a circle's centre the edge is
where colour changes most. A ball's outline has an edge on most of its rays, and pixels change within it but not
outside, which distinguishes it from the rim of a plate on which the ball lies.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError

#: range of the closeness: from a distant telephoto lens to one that almost touches the ball
CLOSENESS = (0.004, 0.6)


@dataclass(frozen=True, kw_only=True)
class View:
    """How the camera sees the ball."""

    x: float  #: of the ball's centre in the picture [pixels]
    y: float
    radius: float  #: f tan alpha: the outline's radius if the ball were in the middle of the picture [pixels]
    closeness: float  #: 1/D: the ball's radius over the distance from the lens to its centre
    middle: tuple[float, float]  #: of the picture, where the optical axis is [pixels]

    @property
    def focal(self) -> float:
        """The focal length f [pixels]."""
        return self.radius * float(np.sqrt(self.closeness**-2 - 1.0))

    @property
    def distance(self) -> float:
        """D [ball radii]."""
        return 1.0 / self.closeness

    @property
    def axis(self) -> Floats:
        """The direction c (3,) from the lens to the ball's centre."""
        return self.rays(np.array([[self.x, self.y]]))[0]

    def rays(self, pixels: Floats) -> Floats:
        """Return the unit vectors d (k, 3) from the lens through points (k, 2) of the picture."""
        rays = np.column_stack([(pixels - np.asarray(self.middle)) / self.focal, np.ones(len(pixels))])
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def points(self, pixels: Floats) -> tuple[Floats, Floats]:
        """Return the points p (k, 3) of the unit sphere seen at places (k, 2) of the picture, and cosines (k,).

        The points are in the camera frame. The cosines are of the angle between the ball's normal and the ray; NaN
        beside the ball.
        """
        d, c, D = self.rays(pixels), self.axis, self.distance
        along = d @ c
        with np.errstate(invalid="ignore"):
            facing = np.sqrt(1.0 - D**2 * (1.0 - along**2))
        p = (D * along - facing)[:, None] * d - D * c
        return p, facing

    def project(self, points: Floats) -> tuple[Floats, Floats]:
        """Return where points (k, 3) of the unit sphere, camera frame, are in the picture (k, 2), and cosines (k,).

        The cosines are as `points` has them, negative on the far side.
        """
        c, D = self.axis, self.distance
        seen = points + D * c
        facing = -np.sum(points * seen, axis=1) / np.linalg.norm(seen, axis=1)
        return seen[:, :2] / seen[:, 2:] * self.focal + np.asarray(self.middle), facing

    def outline(self, count: int = 360) -> Floats:
        """Return points (count, 2) of the outline in the picture."""
        c = self.axis
        across = np.cross(c, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        round_ = np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(c, across))
        rays = np.sqrt(1.0 - self.closeness**2) * c + self.closeness * round_
        return rays[:, :2] / rays[:, 2:] * self.focal + np.asarray(self.middle)


def view_of_outline(points: Floats, *, size: tuple[int, int], closeness: float) -> View:
    """Return the view whose outline passes best through three points (k, 2) or more [pixels] of a picture.

    A ray d that touches the ball has d . c = cos alpha; least squares on d . g = 1 gives g = c / cos alpha. The rays
    depend on the focal length, which follows from closeness 1/D and radius; hence the fixed-point iteration.
    """
    middle = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
    x, y = points.mean(axis=0)
    radius = float(np.mean(np.hypot(points[:, 0] - x, points[:, 1] - y)))
    view = View(x=float(x), y=float(y), radius=radius, closeness=closeness, middle=middle)
    for _ in range(12):
        g = np.linalg.lstsq(view.rays(points), np.ones(len(points)), rcond=None)[0]
        # |g| = 1 / cos alpha gives tan alpha, and with the focal length the radius of the next iteration
        tangent = np.sqrt(max(g @ g - 1.0, 1e-12))
        x, y = g[:2] / g[2] * view.focal + np.asarray(middle)
        view = View(
            x=float(x), y=float(y), radius=view.focal * float(tangent), closeness=closeness, middle=middle
        )
    return view


#: closeness assumed until the seam determines it
ASSUMED_CLOSENESS = 0.12
#: largest picture for the Hough transform [pixels], and its smallest number of votes
_VOTED_SIZE = 360
_VOTES = 25.0
#: smallest and largest radius, as fractions of the picture's shorter side
_SMALLEST, _LARGEST = 0.08, 0.75
#: circles taken from each channel
_VOTED = 3
#: number of rays from a circle's centre, and the range on both sides of it in which edges are searched, by iteration,
#: as fractions of the radius
_RAYS = 240
_SEARCHES = (0.12, 0.06, 0.03)
#: change of colour within two pixels that is an edge [grey levels]
_EDGE = 8.0
#: largest distance of a ray's edge from the outline, as a fraction of the radius
_EDGE_TOLERANCE = 0.012
#: smallest fraction of rays within it
_LEAST_SHARE = 0.5


def find_outline(frames: Sequence[NDArray[np.uint8]]) -> Floats:
    """Return points (k, 2) of the ball's outline [pixels] in some frames of a camera that stands still.

    InputError if no circle has an edge on half of its rays.
    """
    few = np.stack(frames[:: max(1, len(frames) // 9)])
    still = np.median(few, axis=0).astype(np.uint8)
    picture = np.asarray(cv2.GaussianBlur(still, (0, 0), 1.0), np.float32)
    size = (picture.shape[1], picture.shape[0])
    candidates = [_refined(picture, circle, size) for circle in _voted(still)]
    refined = [candidate for candidate in candidates if candidate[2] >= _LEAST_SHARE]
    if not refined:
        raise InputError(
            "No ball was found: no circle in the picture has an edge along "
            "half of its circumference. Give the circle with --circle x,y,r."
        )
    # pixels that change over the frames by more than the picture's noise
    calm = np.stack([cv2.GaussianBlur(frame, (0, 0), 1.0) for frame in few]).astype(np.float32)
    spread = calm.std(axis=0).max(axis=2)
    changing = spread > 3.0 * np.median(spread) + 2.0
    return max(refined, key=lambda candidate: candidate[2] + _moves(changing, candidate[0]))[1]


def _moves(changing: Bools, view: View) -> float:
    """Return the fraction of changing pixels just within a circle less that of those just beyond."""
    rows, columns = np.mgrid[: changing.shape[0], : changing.shape[1]]
    out = np.hypot(columns - view.x, rows - view.y) / view.radius
    within, beyond = changing[(out > 0.75) & (out < 0.96)], changing[(out > 1.05) & (out < 1.2)]
    return float(within.mean()) - (float(beyond.mean()) if beyond.size else 0.0)


def circle_points(circle: tuple[float, float, float], size: tuple[int, int]) -> Floats:
    """Return points (k, 2) of a circle given as the ball's outline [pixels]; InputError if it is impossible."""
    (x, y, radius), (width, height) = circle, size
    room = (x + 0.5, y + 0.5, width - 0.5 - x, height - 0.5 - y)
    if not (radius >= 8.0 and all(radius <= distance for distance in room)):
        raise InputError(
            f"The circle is {x:g},{y:g},{radius:g}; it must lie in the picture, which is {width} x {height} pixels, "
            "and have a radius of at least 8 pixels."
        )
    return _on_circle(circle)


def _on_circle(circle: tuple[float, float, float]) -> Floats:
    x, y, radius = circle
    angle = np.linspace(0.0, 2.0 * np.pi, _RAYS, endpoint=False)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def _voted(still: NDArray[np.uint8]) -> list[tuple[float, float, float]]:
    """Return circles (x, y, radius) by Hough transforms, and circles of the strongest edges about the same centres."""
    factor = min(1.0, _VOTED_SIZE / max(still.shape[:2]))
    small = np.asarray(cv2.resize(still, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), np.uint8)
    shorter = min(small.shape[:2])
    smallest, largest = int(_SMALLEST * shorter), int(_LARGEST * shorter)
    circles: list[Floats] = []
    gray, lab = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), cv2.cvtColor(small, cv2.COLOR_BGR2LAB)
    for channel in (gray, *cv2.split(lab)):
        votes = cv2.HoughCircles(
            cv2.medianBlur(channel, 5), cv2.HOUGH_GRADIENT, 1.5, 0.06 * shorter, param1=80.0, param2=_VOTES,
            minRadius=smallest, maxRadius=largest,
        )  # fmt: skip
        if votes is not None:
            circles += list(np.reshape(votes, (-1, 3))[:_VOTED].astype(np.float64))
    distinct: list[Floats] = []
    for circle in circles:
        for radius in (circle[2], *_strongest(small, circle[0], circle[1], smallest, largest)):
            candidate = np.array([circle[0], circle[1], radius])
            if all(np.abs(candidate - other).max() > 0.03 * shorter for other in distinct):
                distinct.append(candidate)
    return [((x + 0.5) / factor - 0.5, (y + 0.5) / factor - 0.5, r / factor) for x, y, r in distinct]


def _strongest(picture: NDArray[np.uint8], x: float, y: float, smallest: int, largest: int) -> list[float]:
    """Return up to three radii of circles about a centre across which colour changes most."""
    shares = np.arange(smallest, largest)
    angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    columns = (x + np.outer(np.cos(angle), shares)).astype(np.float32)
    rows = (y + np.outer(np.sin(angle), shares)).astype(np.float32)
    colours = cv2.remap(
        picture.astype(np.float32), columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    change = np.median(np.linalg.norm(colours[:, 2:] - colours[:, :-2], axis=2), axis=0)
    inner = change[1:-1]
    peaks = np.flatnonzero((inner >= change[:-2]) & (inner > change[2:]) & (inner > 2.0)) + 1
    return [float(shares[peak] + 1) for peak in peaks[np.argsort(-change[peaks])][:3]]


def _refined(
    picture: NDArray[np.float32], circle: tuple[float, float, float], size: tuple[int, int]
) -> tuple[View, Floats, float]:
    """Return the outline near a circle, its points (k, 2), and the fraction of its rays whose edge agrees with it."""
    points = _on_circle(circle)
    view = view_of_outline(points, size=size, closeness=ASSUMED_CLOSENESS)
    share = 0.0
    for search in _SEARCHES:
        outline = view.outline(_RAYS)
        outward = outline - np.array([view.x, view.y])
        edges, strength = _edges(picture, outline, outward, search)
        off = np.where(strength > _EDGE, edges, np.nan)
        if np.isfinite(off).sum() < 0.3 * _RAYS:
            return view, points, 0.0
        good = np.abs(off - np.nanmedian(off)) < max(0.3 * search, _EDGE_TOLERANCE)
        positions = outline + off[:, None] * outward
        if good.sum() < 20:
            return view, points, 0.0
        points = positions[good]
        view = view_of_outline(points, size=size, closeness=ASSUMED_CLOSENESS)
        found, expected = (
            np.linalg.norm(places - np.array([view.x, view.y]), axis=1)
            for places in (positions, view.outline(_RAYS))
        )
        miss = found / expected
        share = float(np.mean(np.abs(miss - 1.0) < _EDGE_TOLERANCE))
    return view, points, share


def _edges(
    picture: NDArray[np.float32], outline: Floats, outward: Floats, search: float
) -> tuple[Floats, Floats]:
    """Return the position of the largest change of colour on each ray, as a fraction of its length, and that change."""
    length = float(np.mean(np.linalg.norm(outward, axis=1)))
    count = 2 * max(4, round(2.0 * search * length)) + 1  # half pixels
    shares = np.linspace(-search, search, count)
    positions = (outline[:, None] + shares[None, :, None] * outward[:, None]).astype(np.float32)
    colours = cv2.remap(
        picture, positions[..., 0], positions[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    step = 2  # to both sides: two pixels between
    change = np.linalg.norm(colours[:, 2 * step :] - colours[:, : -2 * step], axis=2)
    best = np.argmax(change, axis=1)
    rays = np.arange(len(change))
    peak = np.clip(best, 1, change.shape[1] - 2)
    left, mid, right = change[rays, peak - 1], change[rays, peak], change[rays, peak + 1]
    curve = left - 2.0 * mid + right
    shift = np.where(curve < -1e-6, 0.5 * (left - right) / np.where(curve < -1e-6, curve, 1.0), 0.0)
    position = peak + step + np.clip(shift, -1.0, 1.0)
    return np.interp(position, np.arange(count), shares), change[rays, best].astype(np.float64)
