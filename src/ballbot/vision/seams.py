"""The seams of balls, as closed curves on the unit sphere in the ball's own frame.

    (V.4)   x = a cos t + b cos 3t,   y = a sin t - b sin 3t,   z = c sin 2t,   b = 1 - a,   c = 2 sqrt(ab)

The thesis prints cos 3t in the second component and c = sqrt(ab); with either the curve leaves the sphere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

#: points of a curve: 0.003 rad apart at the most, an eighth of a seam's width
_POINTS = 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class Seam:
    """Where a ball's seam runs."""

    name: str
    curves: tuple[NDArray[np.float64], ...]  #: each (n, 3), unit vectors, closed: the last meets the first

    @property
    def points(self) -> NDArray[np.float64]:
        """All points of all curves (n, 3)."""
        return np.vstack(self.curves)

    @property
    def tangents(self) -> NDArray[np.float64]:
        """The unit tangents (n, 3) at `points`."""
        slopes = [np.roll(curve, -1, axis=0) - np.roll(curve, 1, axis=0) for curve in self.curves]
        return np.vstack([slope / np.linalg.norm(slope, axis=1, keepdims=True) for slope in slopes])


def thesis_seam(a: float = 0.65) -> Seam:
    """Return (V.4) with its two misprints mended.

    Parameters
    ----------
    a : float
        0.5 < a < 1, in ball radii; the nearer to 1, the nearer is the curve to a great circle.

    Raises
    ------
    InputError
        Where a is outside of that.
    """
    if not 0.5 < a < 1.0:
        raise InputError(f"a of the seam is {a:g} ball radii; (V.4) needs a value between 0.5 and 1.")
    t, b = _parameter(), 1.0 - a
    x = a * np.cos(t) + b * np.cos(3.0 * t)
    y = a * np.sin(t) - b * np.sin(3.0 * t)
    z = 2.0 * np.sqrt(a * b) * np.sin(2.0 * t)
    return Seam(name="thesis", curves=(np.column_stack([x, y, z]),))


def tennis_seam() -> Seam:
    """Return a tennis ball's seam: (V.4) with a = 0.75, whose neck is 60 degrees wide where the thesis's is 35."""
    return Seam(name="tennis", curves=thesis_seam(0.75).curves)


def basketball_seam() -> Seam:
    """Return a basketball's seam of eight panels: two great circles, and an oval about each end of the x axis.

    The ovals are 45 degrees from the x axis where the great circle z = 0 cuts them and 62 degrees at their far
    ends; makers differ in this, and none publishes a curve.
    """
    t = _parameter()
    zero = np.zeros_like(t)
    equator = np.column_stack([np.cos(t), np.sin(t), zero])
    meridian = np.column_stack([zero, np.cos(t), np.sin(t)])
    opening = np.radians(45.0) + np.radians(17.0) * np.sin(t) ** 2
    oval = np.column_stack([np.cos(opening), np.sin(opening) * np.cos(t), np.sin(opening) * np.sin(t)])
    return Seam(name="basketball", curves=(equator, meridian, oval, oval * [-1.0, 1.0, 1.0]))


SEAMS: Mapping[str, Callable[[], Seam]] = MappingProxyType(
    {"thesis": thesis_seam, "tennis": tennis_seam, "basketball": basketball_seam}
)


def seam_named(name: str) -> Seam:
    """Return the seam of that name.

    Raises
    ------
    InputError
        Where there is none.
    """
    if name not in SEAMS:
        raise InputError(f"There is no seam {name!r}; the seams are {', '.join(SEAMS)}.")
    return SEAMS[name]()


def _parameter() -> NDArray[np.float64]:
    return np.linspace(0.0, 2.0 * np.pi, _POINTS, endpoint=False)
