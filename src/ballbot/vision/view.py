"""A ball before a pinhole camera at a finite distance: what of it is seen, and where.

Camera frame: x to the right of the picture, y down, z away from the camera, into the scene. Pixel (0, 0) is the
middle of the first pixel. Lengths are in ball radii.

The rays that touch the ball make a cone with the half angle alpha, sin alpha = 1/D, about the ray to its centre; its
section with the picture is the outline, a circle only where the ball is in the middle of the picture. The points that
they touch are nearer to the camera than the centre is, by 1/D: the outline is not the equator, and less than half
of the ball is seen.

    p = s d - D c,    s = D d.c - sqrt(1 - D^2 (1 - (d.c)^2)),    f = r / tan alpha = r sqrt(D^2 - 1)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

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
    def axis(self) -> NDArray[np.float64]:
        """The direction c (3,) from the lens to the ball's centre."""
        return self.rays(np.array([[self.x, self.y]]))[0]

    def rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the unit vectors d (k, 3) from the lens through points (k, 2) of the picture."""
        rays = np.column_stack([(pixels - np.asarray(self.middle)) / self.focal, np.ones(len(pixels))])
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def points(self, pixels: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where points (k, 3) of the unit sphere, camera frame, are in the picture (k, 2), and cosines (k,).

        The cosines are as `points` has them, negative on the far side.
        """
        c, D = self.axis, self.distance
        seen = points + D * c
        facing = -np.sum(points * seen, axis=1) / np.linalg.norm(seen, axis=1)
        return seen[:, :2] / seen[:, 2:] * self.focal + np.asarray(self.middle), facing

    def outline(self, count: int = 360) -> NDArray[np.float64]:
        """Return points (count, 2) of the outline in the picture."""
        c = self.axis
        across = np.cross(c, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        round_ = np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(c, across))
        rays = np.sqrt(1.0 - self.closeness**2) * c + self.closeness * round_
        return rays[:, :2] / rays[:, 2:] * self.focal + np.asarray(self.middle)


def view_of_outline(points: NDArray[np.float64], *, size: tuple[int, int], closeness: float) -> View:
    """Return the view whose outline passes best through points of the picture.

    A ray d that touches the ball has d . c = cos alpha; least squares on d . g = 1 gives g = c / cos alpha. The focal
    length, which the rays need, comes from the closeness and the radius, so that this is done a few times.

    Parameters
    ----------
    points : ndarray (k, 2)
        At least three points of the outline [pixels].
    size : tuple of int
        Width and height of the picture [pixels].
    closeness : float
        1/D, between 0 and 1.
    """
    middle = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
    x, y = points.mean(axis=0)
    radius = float(np.mean(np.hypot(points[:, 0] - x, points[:, 1] - y)))
    view = View(x=float(x), y=float(y), radius=radius, closeness=closeness, middle=middle)
    for _ in range(12):
        g = np.linalg.lstsq(view.rays(points), np.ones(len(points)), rcond=None)[0]
        # |g| = 1 / cos alpha; the angle that the outline has under this focal length says how to change it
        tangent = np.sqrt(max(g @ g - 1.0, 1e-12))
        x, y = g[:2] / g[2] * view.focal + np.asarray(middle)
        view = View(
            x=float(x), y=float(y), radius=view.focal * float(tangent), closeness=closeness, middle=middle
        )
    return view


def check_distance(distance: float) -> None:
    """Refuse a camera within the ball, or so near or far that its distance makes no sense.

    Raises
    ------
    InputError
        Where the closeness would not be within `CLOSENESS`.
    """
    far, near = (1.0 / closeness for closeness in CLOSENESS)
    if not near <= distance <= far:
        raise InputError(
            f"The camera's distance is {distance:g} ball radii from "
            f"the ball's centre; it must be from {near:.2g} to {far:g}."
        )
