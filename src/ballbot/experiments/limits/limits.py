"""What a robot with a controller can be thrown at: leans at rest, blows, and a plane of lean and lean rate.

Each is found twice, and the truth lies between: `sure`, where no wheel ever lets go of the ball, and `most`, where the
wheels are taken to hold whatever they push (the equations of motion know no slip).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.experiments.limits.loop import Loop
from ballbot.experiments.limits.region import Reach, Region, map_region, reach
from ballbot.experiments.limits.starts import leaning, pushed
from ballbot.mechanics.equations import LARGEST_LEAN

#: leans and blows are tried towards so many directions, evenly spread
DIRECTIONS = 36
#: heights of a blow above the ball's centre, in heights of the centre of mass
HEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0)
_CENTER = HEIGHTS.index(1.0)
#: a blow no robot stays on the ball after: this speed [m/s] times the whole mass
_HARDEST = 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Edges:
    """How far every direction is survived, wheels held to their grip and wheels that always hold."""

    sure: Reach
    most: Reach

    @property
    def runs(self) -> int:
        """Runs that it took."""
        return self.sure.runs + self.most.runs


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLimits:
    """The limits of one closed loop."""

    directions: NDArray[np.float64]  #: (d,) on the floor, from x towards y [rad]
    heights: NDArray[np.float64]  #: (h,) of blows above the ball's centre [m]
    lean: Edges  #: sizes (d,): the lean at rest [rad]
    blow: Edges  #: sizes (h, d): the impulse [N s]
    plane_direction: float  #: in which the plane lies: the least sure lean [rad]
    sure_plane: Region  #: over lean [rad] and lean rate [rad/s]
    most_plane: Region

    @property
    def runs(self) -> int:
        """Runs that all of it took."""
        return self.lean.runs + self.blow.runs + self.sure_plane.runs + self.most_plane.runs

    @property
    def points(self) -> int:
        """Points of the two planes."""
        return self.sure_plane.kept.size + self.most_plane.kept.size

    def blow_at_center(self, edge: Reach) -> NDArray[np.float64]:
        """Return the impulses (d,) [N s] that are survived at the height of the centre of mass."""
        return edge.sizes[_CENTER]

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "directions": self.directions.tolist(),
            "heights": self.heights.tolist(),
            "lean": {"sure": self.lean.sure.sizes.tolist(), "most": self.lean.most.sizes.tolist()},
            "blow": {"sure": self.blow.sure.sizes.tolist(), "most": self.blow.most.sizes.tolist()},
            "plane": {
                "direction": self.plane_direction,
                "lean": float(self.sure_plane.across[-1]),
                "rate": float(self.sure_plane.along[-1]),
                "sure_area": self.sure_plane.area,
                "most_area": self.most_plane.area,
            },
            "runs": self.runs,
            "points": self.points,
        }


Kind = Literal["lean", "blow"]


@dataclass(frozen=True, kw_only=True)
class TwinEdge:
    """One limit on the model and on the twin: rad for a lean, N s for a blow at the centre of mass's height."""

    kind: Kind
    direction: float  #: [rad]
    sure: float  #: up to where no wheel of the model lets go
    twin: float  #: up to where the twin stands, to 1/32 of `most` and a tenth
    most: float  #: up to where the model stands if its wheels always hold

    @property
    def agrees(self) -> bool:
        """Whether the twin's limit is between the model's two, to within 5 %."""
        return 0.95 * self.sure <= self.twin <= 1.05 * self.most


def find_limits(
    loop: Loop, *, refinements: int = 5, tell: Callable[[float], None] | None = None
) -> RobotLimits:
    """Return how far a robot may lean and how hard it may be hit.

    Parameters
    ----------
    loop : Loop
        Its grip is that of `sure`.
    refinements : int
        Of the planes' grid; 5 make a million points each.
    tell : callable, optional
        Told the share that is done.
    """
    note = tell or (lambda _: None)
    held = replace(loop, grip=np.inf)
    directions = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    lean = Edges(sure=_leans(loop, directions), most=_leans(held, directions))
    note(0.05)
    body = loop.robot.body
    heights = body.center_of_mass * np.array(HEIGHTS)
    blow = Edges(sure=_blows(loop, directions, heights), most=_blows(held, directions, heights))
    note(0.2)
    worst = float(directions[lean.sure.sizes.argmin()])
    widest = float(lean.most.sizes[lean.sure.sizes.argmin()])
    growth = float(loop.model.linearize().poles().real.max())
    most = (min(1.6 * widest, LARGEST_LEAN), 2.2 * growth * widest)
    planes = []
    for done, one in ((0.6, loop), (1.0, held)):
        planes.append(
            map_region(one.survives, lambda a, b: leaning(worst, a, b), most=most, refinements=refinements)
        )
        note(done)
    return RobotLimits(
        directions=directions,
        heights=heights,
        lean=lean,
        blow=blow,
        plane_direction=worst,
        sure_plane=planes[0],
        most_plane=planes[1],
    )


def _leans(loop: Loop, directions: NDArray[np.float64]) -> Reach:
    return reach(
        loop.survives, lambda sizes: leaning(directions, sizes), shape=directions.shape, most=LARGEST_LEAN
    )


def _blows(loop: Loop, directions: NDArray[np.float64], heights: NDArray[np.float64]) -> Reach:
    robot = loop.robot
    return reach(
        loop.survives,
        lambda sizes: pushed(loop.model, directions, sizes, heights[:, None]),
        shape=(len(heights), len(directions)),
        most=_HARDEST * (robot.ball.mass + robot.body.mass),
    )
