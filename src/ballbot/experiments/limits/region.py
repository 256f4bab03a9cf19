"""The edge between starts that are survived and starts that are not: along rays, and over a plane.

A ray is first looked at in `LOOKS` places, so that what is lost between two survived sizes is not overlooked, and the
first loss is then halved in on, all rays in one batch. A plane is looked at coarsely; from then on only cells are
halved whose corners, or whose neighbours' corners, differ. So a map of a million points takes the runs along its edge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.experiments.limits.loop import Survives

#: places at which a ray is looked at first, evenly spread
LOOKS = 24
#: of each ray, each to half the interval left: 1/24 of the ray becomes 1/12288
_HALVINGS = 9
#: a map's intervals a side: `_COARSE` at first, then halved so many times
_COARSE, _REFINEMENTS = 32, 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """How far along rays starts are survived."""

    sizes: NDArray[np.float64]  #: (...), up to which every start looked at was survived
    limited: NDArray[np.bool_]  #: (...), whether there is a loss at all up to the ray's end
    runs: int


def reach(
    survives: Survives,
    start_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    *,
    shape: tuple[int, ...],
    most: float,
) -> Reach:
    """Return how far each of some rays is survived, from zero to `most`.

    Parameters
    ----------
    survives : callable
    start_of : callable
        From sizes (k, *shape) along each ray to starts (k, *shape, 10).
    shape : tuple of int
        Of the rays.
    most : float
        The rays' end, in the unit of the sizes.
    """

    def looked(sizes: NDArray[np.float64]) -> NDArray[np.bool_]:
        return survives(start_of(sizes).reshape(-1, 10)).reshape(sizes.shape)

    looks = most * np.arange(1, LOOKS + 1) / LOOKS
    first = looked(np.broadcast_to(looks.reshape(-1, *(1,) * len(shape)), (LOOKS, *shape)))
    limited = np.logical_not(np.all(first, axis=0))
    kept = np.where(limited, first.argmin(axis=0), LOOKS) * (most / LOOKS)
    interval = most / LOOKS
    for _ in range(_HALVINGS):
        interval *= 0.5
        further = looked((kept + interval)[None])[0]
        kept = np.where(limited & further, kept + interval, kept)
    return Reach(sizes=kept, limited=limited, runs=(LOOKS + _HALVINGS) * int(np.prod(shape)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Region:
    """Which starts of a plane are survived."""

    across: NDArray[np.float64]  #: (a,), the first coordinate
    along: NDArray[np.float64]  #: (b,), the second
    kept: NDArray[np.bool_]  #: (a, b)
    runs: int  #: starts that were run; the others lie between starts that agree

    @property
    def area(self) -> float:
        """The survived part of the plane, in both coordinates' units."""
        cell = (self.across[1] - self.across[0]) * (self.along[1] - self.along[0])
        return float(self.kept.sum() * cell)


def map_region(
    survives: Survives,
    start_of: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
    *,
    most: tuple[float, float],
    refinements: int = _REFINEMENTS,
) -> Region:
    """Return which starts are survived over a rectangle about the origin, refined at the edge.

    Parameters
    ----------
    survives : callable
    start_of : callable
        From both coordinates (k,) to starts (k, 10).
    most : tuple of float
        The rectangle reaches from minus to plus this in each coordinate.
    refinements : int
        Times that the coarse grid of 33 x 33 is halved; 5 make 1025 x 1025 points.
    """
    intervals = _COARSE << refinements
    across, along = (np.linspace(-end, end, intervals + 1) for end in most)
    kept = np.zeros((intervals + 1, intervals + 1), np.bool_)
    known = np.zeros_like(kept)
    runs = 0
    stride = 1 << refinements
    wanted = np.zeros_like(kept)
    wanted[::stride, ::stride] = True
    while True:
        places = np.nonzero(wanted & ~known)
        kept[places] = survives(start_of(across[places[0]], along[places[1]]))
        known[places] = True
        runs += len(places[0])
        if stride == 1:
            return Region(across=across, along=along, kept=kept, runs=runs)
        wanted = _between(kept, stride)
        stride //= 2


def _between(kept: NDArray[np.bool_], stride: int) -> NDArray[np.bool_]:
    """Halve a grid in place where its cells agree, and return the points (a, b) of the others that are to be run."""
    corners = kept[::stride, ::stride]
    whole = corners[:-1, :-1] & corners[1:, :-1] & corners[:-1, 1:] & corners[1:, 1:]
    none = ~(corners[:-1, :-1] | corners[1:, :-1] | corners[:-1, 1:] | corners[1:, 1:])
    mixed = np.pad(~(whole | none), 1)
    cells = mixed.shape[0] - 2
    open_cells = np.zeros((cells, cells), np.bool_)
    for i in range(3):
        for j in range(3):
            open_cells |= mixed[i : i + cells, j : j + cells]
    half = stride // 2
    wanted = np.zeros_like(kept)
    for i in (0, half, stride):
        for j in (0, half, stride):
            target = np.s_[
                i : i + cells * stride - (stride - 1) : stride, j : j + cells * stride - (stride - 1) : stride
            ]
            wanted[target] |= open_cells
            if half in (i, j):
                kept[target] = np.where(open_cells, kept[target], whole)
    return wanted
