"""Finding the ball's outline in a video: circles are voted for, and each is judged by its own edge all around.

Of some frames the median is taken, pixel by pixel: what turns with the ball is gone and what stands still stays.
Along rays from a circle's centre the edge is where colour changes most; a ball's outline has an edge on most of its
rays, and pictures change within it and not beyond, which they do not at the rim of a plate on which the ball lies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.vision.view import View, view_of_outline

#: closeness assumed until the seam tells it
ASSUMED_CLOSENESS = 0.12
#: circles are voted for on a picture no larger than this [pixels], with these patiences of the vote
_VOTED_SIZE = 360
_PATIENCES = (60.0, 40.0, 25.0)
#: smallest and largest radius, as shares of the picture's shorter side
_SMALLEST, _LARGEST = 0.08, 0.75
#: circles taken from each vote, and in all
_VOTED, _CANDIDATES = 3, 40
#: rays from a circle's centre, and how far to both sides of it an edge is looked for, round by round, as shares of
#: the radius
_RAYS = 240
_SEARCHES = (0.12, 0.06, 0.03)
#: an edge is where colour changes by so much within two pixels [grey levels]
_EDGE = 8.0
#: a ray agrees with the outline where its edge is within this share of the radius
_AGREES = 0.012
#: share of the rays that must
_LEAST_SHARE = 0.5


def find_outline(frames: Sequence[NDArray[np.uint8]]) -> NDArray[np.float64]:
    """Return points (k, 2) of the ball's outline [pixels].

    Parameters
    ----------
    frames : sequence of ndarray (height, width, 3) uint8
        Some, of a camera that stands still.

    Raises
    ------
    InputError
        Where no circle has an edge on half of its rays.
    """
    few = np.stack(frames[:: max(1, len(frames) // 9)])
    still = np.median(few, axis=0).astype(np.uint8)
    picture = np.asarray(cv2.GaussianBlur(still, (0, 0), 1.0), np.float32)
    size = (picture.shape[1], picture.shape[0])
    refined = [
        one for one in (_refined(picture, circle, size) for circle in _voted(still)) if one[2] >= _LEAST_SHARE
    ]
    if not refined:
        raise InputError(
            "No ball was found: no circle in the picture has an edge along "
            "half of its circumference. Give the circle with --circle x,y,r."
        )
    changing = _changing(few)
    return max(refined, key=lambda one: one[2] + _moves(changing, one[0]))[1]


def _changing(frames: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return which pixels (height, width) change over frames (k, height, width, 3) by more than the picture's noise."""
    calm = np.stack([cv2.GaussianBlur(frame, (0, 0), 1.0) for frame in frames]).astype(np.float32)
    spread = calm.std(axis=0).max(axis=2)
    return spread > 3.0 * np.median(spread) + 2.0


def _moves(changing: NDArray[np.bool_], view: View) -> float:
    """Return the share of changing pixels just within a circle less that of those just beyond."""
    rows, columns = np.mgrid[: changing.shape[0], : changing.shape[1]]
    out = np.hypot(columns - view.x, rows - view.y) / view.radius
    within, beyond = changing[(out > 0.75) & (out < 0.96)], changing[(out > 1.05) & (out < 1.2)]
    return float(within.mean()) - (float(beyond.mean()) if beyond.size else 0.0)


def circle_points(circle: tuple[float, float, float], size: tuple[int, int]) -> NDArray[np.float64]:
    """Return points (k, 2) of a circle that is given as the ball's outline in a picture of that size [pixels].

    Raises
    ------
    InputError
        Where the circle is too small or not within the picture.
    """
    x, y, radius = circle
    width, height = size
    if not all(map(math.isfinite, circle)):
        raise InputError(f"The circle is {x:g},{y:g},{radius:g}; it must be three numbers in pixels.")
    if not radius >= 8.0:
        raise InputError(f"The circle's radius is {radius:g} pixels; a ball needs at least 8.")
    if x - radius < -0.5 or y - radius < -0.5 or x + radius > width - 0.5 or y + radius > height - 0.5:
        raise InputError(
            f"The circle {x:g},{y:g},{radius:g} is not inside the picture, which is {width} x {height} pixels."
        )
    return _on_circle(circle)


def _on_circle(circle: tuple[float, float, float]) -> NDArray[np.float64]:
    x, y, radius = circle
    angle = np.linspace(0.0, 2.0 * np.pi, _RAYS, endpoint=False)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def _voted(still: NDArray[np.uint8]) -> list[tuple[float, float, float]]:
    """Return circles (x, y, radius) that edges vote for, and about the same centres those of the strongest edges."""
    factor = min(1.0, _VOTED_SIZE / max(still.shape[:2]))
    small = np.asarray(cv2.resize(still, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), np.uint8)
    shorter = min(small.shape[:2])
    smallest, largest = int(_SMALLEST * shorter), int(_LARGEST * shorter)
    circles: list[NDArray[np.float64]] = []
    for patience in _PATIENCES:
        for channel in (
            cv2.cvtColor(small, cv2.COLOR_BGR2GRAY),
            *cv2.split(cv2.cvtColor(small, cv2.COLOR_BGR2LAB)),
        ):
            found = cv2.HoughCircles(
                cv2.medianBlur(channel, 5), cv2.HOUGH_GRADIENT, 1.5, 0.06 * shorter, param1=80.0, param2=patience,
                minRadius=smallest, maxRadius=largest,
            )  # fmt: skip
            if found is not None:
                circles += list(np.reshape(found, (-1, 3))[:_VOTED].astype(np.float64))
    distinct: list[NDArray[np.float64]] = []
    for circle in circles:
        for radius in (circle[2], *_strongest(small, circle[0], circle[1], smallest, largest)):
            one = np.array([circle[0], circle[1], radius])
            if all(np.abs(one - other).max() > 0.03 * shorter for other in distinct):
                distinct.append(one)
    return [
        ((x + 0.5) / factor - 0.5, (y + 0.5) / factor - 0.5, r / factor) for x, y, r in distinct[:_CANDIDATES]
    ]


def _strongest(picture: NDArray[np.uint8], x: float, y: float, smallest: int, largest: int) -> list[float]:
    """Return the radii of the circles about a place on which colour changes most, all around, up to three."""
    shares = np.arange(smallest, largest)
    angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    columns = (x + np.outer(np.cos(angle), shares)).astype(np.float32)
    rows = (y + np.outer(np.sin(angle), shares)).astype(np.float32)
    colours = cv2.remap(
        picture.astype(np.float32), columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    change = np.median(np.linalg.norm(colours[:, 2:] - colours[:, :-2], axis=2), axis=0)
    peaks = (
        np.flatnonzero((change[1:-1] >= change[:-2]) & (change[1:-1] > change[2:]) & (change[1:-1] > 2.0)) + 1
    )
    return [float(shares[peak] + 1) for peak in peaks[np.argsort(-change[peaks])][:3]]


def _refined(
    picture: NDArray[np.float32], circle: tuple[float, float, float], size: tuple[int, int]
) -> tuple[View, NDArray[np.float64], float]:
    """Return the outline near a circle, its points (k, 2), and the share of its rays whose edge agrees with it."""
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
        good = np.abs(off - np.nanmedian(off)) < max(0.3 * search, _AGREES)
        places = outline + off[:, None] * outward
        if good.sum() < 20:
            return view, points, 0.0
        points = places[good]
        view = view_of_outline(points, size=size, closeness=ASSUMED_CLOSENESS)
        after = view.outline(_RAYS)
        miss = np.linalg.norm(places - np.array([view.x, view.y]), axis=1) / np.linalg.norm(
            after - np.array([view.x, view.y]), axis=1
        )
        share = float(np.mean(np.abs(miss - 1.0) < _AGREES))
    return view, points, share


def _edges(
    picture: NDArray[np.float32], outline: NDArray[np.float64], outward: NDArray[np.float64], search: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where on each ray colour changes most, as a share of its length from the outline, and by how much."""
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
