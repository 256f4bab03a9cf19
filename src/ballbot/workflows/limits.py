"""The largest tilts and impulses that a robot with a controller recovers from, on the model and on the twin.

They are found three ways: tilts at rest, impulses on the body, and a plane of lean and lean rate. On the model each is
found twice, and the truth lies between: `sure`, where no wheel ever lets go of the ball, and `most`, where the wheels
are taken to hold whatever they push (the equations of motion know no slip). The twin's wheels can slip and lift, and
its controller sees its sensors only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import hold
from ballbot.estimation import named_estimator
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.model import Model
from ballbot.progress import Progress
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Push
from ballbot.workflows.recovery_region import Loop, Reach, Region, map_region, reach


def leaning_state(direction: ArrayLike, lean: ArrayLike, rate: ArrayLike = 0.0) -> NDArray[np.float64]:
    """Return states (..., 10) that lean towards a direction and move on towards it, the ball at rest.

    Parameters
    ----------
    direction : array_like (...)
        On the floor [rad].
    lean : array_like (...)
        phi cos(direction) - theta sin(direction) [rad].
    rate : array_like (...)
        Its rate [rad/s].
    """
    direction, lean, rate = np.broadcast_arrays(direction, lean, rate)
    states = np.zeros((*lean.shape, 10))
    for place, size in ((2, lean), (7, rate)):
        states[..., place] = -size * np.sin(direction)
        states[..., place + 1] = size * np.cos(direction)
    return states


def pushed_state(
    model: Model, direction: ArrayLike, impulse: ArrayLike, height: ArrayLike
) -> NDArray[np.float64]:
    """Return states (..., 10) just after a blow on a body that stood upright at rest.

    The blow J [N s] at the height h above the ball's centre is the generalised impulse p = (J, h e_z x J) on the
    ball's place and the body's turning, and M(0) q_dot = p. It is over before friction or the motors do anything.

    Parameters
    ----------
    model : Model
    direction : array_like (...)
        Of the blow, on the floor [rad].
    impulse : array_like (...)
        J [N s].
    height : array_like (...)
        h [m].
    """
    direction, impulse, height = np.broadcast_arrays(direction, impulse, height)
    J_x, J_y = impulse * np.cos(direction), impulse * np.sin(direction)
    p = np.stack([J_x, J_y, -height * J_y, height * J_x, np.zeros_like(J_x)], axis=-1)
    states = np.zeros((*impulse.shape, 10))
    states[..., 5:] = p @ np.linalg.inv(model.mass_matrix(np.zeros(5)))
    return states


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


def find_limits(loop: Loop, *, refinements: int = 5, run: Run = DEFAULT_RUN) -> RobotLimits:
    """Return how far a robot may lean and how hard it may be hit.

    Parameters
    ----------
    loop : Loop
        Its grip is that of `sure`.
    refinements : int
        Of the planes' grid; 5 make a million points each.
    run : Run, optional
        Its progress is reported after each stage; nothing is random, and nothing is kept.
    """
    held = replace(loop, grip=np.inf)
    directions = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    lean = Edges(sure=_lean_reach(loop, directions), most=_lean_reach(held, directions))
    run.progress(Progress(stage="limits", done=0.05, total=1.0))
    body = loop.robot.body
    heights = body.center_of_mass * np.array(HEIGHTS)
    blow = Edges(
        sure=_impulse_reach(loop, directions, heights), most=_impulse_reach(held, directions, heights)
    )
    run.progress(Progress(stage="limits", done=0.2, total=1.0))
    worst = float(directions[lean.sure.sizes.argmin()])
    widest = float(lean.most.sizes[lean.sure.sizes.argmin()])
    growth = float(loop.model.linearize().poles().real.max())
    most = (min(1.6 * widest, LARGEST_LEAN), 2.2 * growth * widest)
    planes = []
    for done, one in ((0.6, loop), (1.0, held)):
        planes.append(
            map_region(
                one.survives, lambda a, b: leaning_state(worst, a, b), most=most, refinements=refinements
            )
        )
        run.progress(Progress(stage="limits", done=done, total=1.0))
    return RobotLimits(
        directions=directions,
        heights=heights,
        lean=lean,
        blow=blow,
        plane_direction=worst,
        sure_plane=planes[0],
        most_plane=planes[1],
    )


def _lean_reach(loop: Loop, directions: NDArray[np.float64]) -> Reach:
    return reach(
        loop.survives,
        lambda sizes: leaning_state(directions, sizes),
        shape=directions.shape,
        most=LARGEST_LEAN,
    )


def _impulse_reach(loop: Loop, directions: NDArray[np.float64], heights: NDArray[np.float64]) -> Reach:
    robot = loop.robot
    return reach(
        loop.survives,
        lambda sizes: pushed_state(loop.model, directions, sizes, heights[:, None]),
        shape=(len(heights), len(directions)),
        most=_HARDEST * (robot.ball.mass + robot.body.mass),
    )


#: a blow on the twin is a force of so long [s], four samples of the nominal scenario
PUSH_DURATION = 0.02
_PUSH_TIME = 0.5  # when it comes [s]
_STANDING_TIME = 3.0  # and how long a robot must stand from then on [s]
_HALVINGS = 5


def twin_edges(
    robot: Robot,
    controller: Controller,
    scenario: Scenario,
    found: RobotLimits,
    *,
    directions: Sequence[int],
    run: Run = DEFAULT_RUN,
) -> list[TwinEdge]:
    """Return the twin's limits beside the model's, by halving between none and a tenth more than the model's most.

    Parameters
    ----------
    robot : Robot
    controller : Controller
    scenario : Scenario
        What is true of the twin; it counts as fallen where the model does.
    found : RobotLimits
        The model's.
    directions : sequence of int
        Places among its directions.
    run : Run, optional
        Its seed is that of every simulated run; its progress is reported after each direction.
    """
    lenient = replace(scenario, fallen_lean=LARGEST_LEAN)
    state = named_estimator(controller.estimator, robot, sample_time=scenario.sensors.sample_time)
    twin = Twin(robot, lenient, estimator=state)
    edges = []
    for done, place in enumerate(directions, start=1):
        direction = float(found.directions[place])

        def leans(size: float, direction: float = direction) -> bool:
            start = leaning_state(direction, size)
            log = simulate(
                twin, controller, hold(), duration=_STANDING_TIME, initial_state=start, seed=run.seed
            )
            return log.ended is None

        def stands(size: float, direction: float = direction) -> bool:
            struck = Twin(robot, replace(lenient, pushes=(_push(robot, direction, size),)), estimator=state)
            log = simulate(struck, controller, hold(), duration=_PUSH_TIME + _STANDING_TIME, seed=run.seed)
            return log.ended is None

        sizes = {
            "lean": (found.lean.sure.sizes[place], found.lean.most.sizes[place]),
            "blow": (
                found.blow_at_center(found.blow.sure)[place],
                found.blow_at_center(found.blow.most)[place],
            ),
        }
        edges += [
            _edge("lean", direction, *sizes["lean"], leans),
            _edge("blow", direction, *sizes["blow"], stands),
        ]
        run.progress(Progress(stage="limits on the twin", done=done, total=len(directions)))
    return edges


def _edge(
    kind: Kind, direction: float, sure: float, most: float, stands: Callable[[float], bool]
) -> TwinEdge:
    low, high = 0.0, 1.1 * float(most)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stands(middle) else (low, middle)
    return TwinEdge(kind=kind, direction=direction, sure=float(sure), twin=low, most=float(most))


def _push(robot: Robot, direction: float, impulse: float) -> Push:
    force = impulse / PUSH_DURATION
    return Push(
        time=_PUSH_TIME,
        duration=PUSH_DURATION,
        force=(force * math.cos(direction), force * math.sin(direction), 0.0),
        height=robot.body.center_of_mass,
    )
