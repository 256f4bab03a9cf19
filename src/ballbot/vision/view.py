"""A ball before a pinhole camera at a finite distance: what of it is seen, and where; and its outline found in a video.

Camera frame: x to the right of the picture, y down, z away from the camera, into the scene. Pixel (0, 0) is the
middle of the first pixel. Lengths are in ball radii.

The rays that touch the ball make a cone with the half angle alpha, sin alpha = 1/D, about the ray to its centre; its
section with the picture is the outline, a circle only where the ball is in the middle of the picture. The points that
they touch are nearer to the camera than the centre is, by 1/D: the outline is not the equator, and less than half
of the ball is seen.

    p = s d - D c,    s = D d.c - sqrt(1 - D^2 (1 - (d.c)^2)),    f = r / tan alpha = r sqrt(D^2 - 1)

The outline is found from what changes: all that turns with the ball does, and the smallest circle about it is nearly
the outline. Of some frames the median is taken, pixel by pixel: what turns with the ball is gone and what stands still
stays. Along rays from the circle's centre the edge is where colour changes most; a ball's outline has an edge on most
of its rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.columns import Floats

#: closeness stays within these: from a telephoto lens afar to one that all but touches
CLOSENESS = (0.004, 0.6)


@dataclass(frozen=True, kw_only=True)
class View:
    """How the camera sees the ball."""

    x: float  #: of the ball's centre in the picture [pixels]
    y: float
    radius: float  #: f tan alpha: the outline's radius, were the ball in the middle of the picture [pixels]
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

    A ray d that touches the ball has d . c = cos alpha; least squares on d . g = 1 gives g = c / cos alpha. The focal
    length, which the rays need, comes from the closeness 1/D and the radius, so that this is done a few times.
    """
    middle = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
    x, y = points.mean(axis=0)
    radius = float(np.mean(np.hypot(points[:, 0] - x, points[:, 1] - y)))
    view = View(x=float(x), y=float(y), radius=radius, closeness=closeness, middle=middle)
    for _ in range(12):
        g = np.linalg.lstsq(view.rays(points), np.ones(len(points)), rcond=None)[0]
        # |g| = 1 / cos alpha; the outline's angle under this focal length shows how to change it
        tangent = np.sqrt(max(g @ g - 1.0, 1e-12))
        x, y = g[:2] / g[2] * view.focal + np.asarray(middle)
        view = View(
            x=float(x), y=float(y), radius=view.focal * float(tangent), closeness=closeness, middle=middle
        )
    return view


#: closeness assumed until the seam determines it
ASSUMED_CLOSENESS = 0.12
#: added to levels before the logarithm, so that the noise of dark pixels counts little [grey levels]
_FLOOR = 12.0
#: a pixel changes if its logarithms of blue, green and red, or their differences, scatter by more than this over
#: frames, and by more than this fraction of what one pixel in two hundred does
_LEAST_CHANGE, _CHANGE_SHARE = 0.03, 0.25
#: rays from a circle's centre, and how far to both sides of it an edge is looked for, round by round, as fractions of
#: the radius
_RAYS = 240
_SEARCHES = (0.12, 0.06, 0.03)
#: an edge is where colour changes by so much within two pixels [grey levels]
_EDGE = 8.0
#: a ray agrees with the outline where its edge is within this fraction of the radius
_EDGE_TOLERANCE = 0.012
#: fraction of the rays within the picture that must
_LEAST_SHARE = 0.5


def find_outline(frames: Sequence[NDArray[np.uint8]]) -> Floats:
    """Return points (k, 2) of the ball's outline [pixels] in some frames of a camera that stands still.

    InputError if no circle about what changes has an edge on half of its rays.
    """
    few = np.stack(frames[:: max(1, len(frames) // 9)])
    still = np.median(few, axis=0).astype(np.uint8)
    picture = np.asarray(cv2.GaussianBlur(still, (0, 0), 1.0), np.float32)
    outlines = [_refined(picture, circle) for circle in _turning(few)]
    if not outlines or max(share for _, share in outlines) < _LEAST_SHARE:
        raise InputError(
            "No ball was found: no circle about what turns in the picture has an edge along "
            "half of its circumference. Give the circle with --circle x,y,r."
        )
    return max(outlines, key=lambda one: one[1])[0]


#: as OpenCV has it: centre, both axes, and the angle of the first [degrees]
Ellipse = tuple[Sequence[float], Sequence[float], float]


def _turning(frames: NDArray[np.uint8]) -> list[Ellipse]:
    """Return circles about what changes over frames (k, height, width, 3): in light, and in colour."""
    calm = np.stack([cv2.GaussianBlur(frame, (0, 0), 1.0) for frame in frames])
    logs = np.log(calm.astype(np.float32) + np.float32(_FLOOR))
    circles = []
    for values in (logs, logs - logs.mean(axis=3, keepdims=True)):  # a shadow changes the first only
        spread = values.std(axis=0).max(axis=2)
        most = float(np.quantile(spread, 0.995))
        changes = (spread > max(_LEAST_CHANGE, _CHANGE_SHARE * most)).astype(np.uint8)
        filled = cv2.morphologyEx(changes, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
        pieces = cv2.findContours(filled, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        if pieces:
            center, radius = cv2.minEnclosingCircle(max(pieces, key=cv2.contourArea))
            circles.append((center, (2.0 * radius, 2.0 * radius), 0.0))
    return circles


def circle_points(circle: tuple[float, float, float], size: tuple[int, int]) -> Floats:
    """Return points (k, 2) of a circle that is given as the ball's outline [pixels]; InputError if it cannot be."""
    (x, y, radius), (width, height) = circle, size
    room = (x + 0.5, y + 0.5, width - 0.5 - x, height - 0.5 - y)
    if not (radius >= 8.0 and all(radius <= one for one in room)):
        raise InputError(
            f"The circle is {x:g},{y:g},{radius:g}; it must lie in the picture, which is {width} x {height} pixels, "
            "and have a radius of at least 8 pixels."
        )
    return _on_ellipse(((x, y), (2.0 * radius, 2.0 * radius), 0.0))


def _on_ellipse(ellipse: Ellipse) -> Floats:
    center, axes, degrees = ellipse
    angle, turn = np.linspace(0.0, 2.0 * np.pi, _RAYS, endpoint=False), np.radians(degrees)
    along = np.column_stack([0.5 * axes[0] * np.cos(angle), 0.5 * axes[1] * np.sin(angle)])
    c, s = np.cos(turn), np.sin(turn)
    return center + along @ np.array([[c, s], [-s, c]])


def _refined(picture: NDArray[np.float32], ellipse: Ellipse) -> tuple[Floats, float]:
    """Return points (k, 2) of the outline near an ellipse, and the fraction of its rays whose edge agrees with it."""
    points, share = _on_ellipse(ellipse), 0.0
    for search in _SEARCHES:
        outline = _on_ellipse(ellipse)
        outward = outline - np.array(ellipse[0])
        seen = ((outline > 0.0) & (outline < np.array(picture.shape[1::-1]) - 1.0)).all(axis=1)
        edges, strength = _edges(picture, outline, outward, search)
        off = np.where(seen & (strength > _EDGE), edges, np.nan)
        if np.isfinite(off).sum() < 0.3 * _RAYS:
            return points, 0.0
        good = np.abs(off - np.nanmedian(off)) < max(0.3 * search, _EDGE_TOLERANCE)
        points, share = (outline + off[:, None] * outward)[good], float(good.sum() / seen.sum())
        ellipse = cv2.fitEllipse(points.astype(np.float32))
    return points, share


def _edges(
    picture: NDArray[np.float32], outline: Floats, outward: Floats, search: float
) -> tuple[Floats, Floats]:
    """Return where on each ray colour changes most, as a fraction of its length from the outline, and by how much."""
    length = float(np.mean(np.linalg.norm(outward, axis=1)))
    count = 2 * max(4, round(2.0 * search * length)) + 1  # half pixels
    shares = np.linspace(-search, search, count)
    places = (outline[:, None] + shares[None, :, None] * outward[:, None]).astype(np.float32)
    colours = cv2.remap(
        picture, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    step = 2  # to both sides: two pixels between
    change = np.linalg.norm(colours[:, 2 * step :] - colours[:, : -2 * step], axis=2)
    best = np.argmax(change, axis=1)
    rays = np.arange(len(change))
    peak = np.clip(best, 1, change.shape[1] - 2)
    left, mid, right = change[rays, peak - 1], change[rays, peak], change[rays, peak + 1]
    curve = left - 2.0 * mid + right
    shift = np.where(curve < -1e-6, 0.5 * (left - right) / np.where(curve < -1e-6, curve, 1.0), 0.0)
    place = peak + step + np.clip(shift, -1.0, 1.0)
    return np.interp(place, np.arange(count), shares), change[rays, best].astype(np.float64)
