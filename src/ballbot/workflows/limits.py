"""The largest tilts and impulses that a robot with a controller recovers from, on the loop and on the twin.

They are found for tilts at rest, for impulses on the body, and over a plane of lean and lean rate, on the compiled loop
with the sensors of a scenario; every run has noise of its own. The equations of motion have no slip, so the loop gives
two bounds of each: `lower`, from runs in which no wheel exceeds its grip, and `upper`, from runs in which grip is
unlimited. The twin's wheels can slip and lift.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.control.references import hold
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.sweep import Processes
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.model import Model
from ballbot.progress import Progress
from ballbot.results import left_out, reported
from ballbot.simulation.imperfections import Push
from ballbot.summary import Summary, plotted, report_summary, summarized
from ballbot.workflows.grid import Condition, GridRun, TwinRobot, run_grid
from ballbot.workflows.recovery_region import (
    DURATION,
    Loop,
    Region,
    StartOf,
    map_region,
    reach,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    """Return states (..., 10) just after an impulse on a body that is upright and at rest.

    The impulse J [N s] at the height h above the ball's centre is the generalised impulse p = (J, h e_z x J) on the
    ball's position and the body's rotation, and M(0) q_dot = p. Friction and motors have no time to act.

    Parameters
    ----------
    model : Model
    direction : array_like (...)
        Of the impulse, on the floor [rad].
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


#: number of directions of tilts and impulses, evenly spread
DIRECTIONS = 36
#: heights of an impulse above the ball's centre, in heights of the centre of mass
HEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0)
_CENTER = HEIGHTS.index(1.0)
#: the largest impulse that is tried is this speed [m/s] times the whole mass; no robot recovers from it
_FASTEST = 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LimitBounds:
    """The largest size from which a robot recovers, by direction."""

    lower: NDArray[np.float64]  #: no wheel slips
    upper: NDArray[np.float64]  #: if wheels never slip


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """The states of lean [rad] and lean rate [rad/s] in one direction from which a robot recovers."""

    direction: float  #: on the floor [rad]
    lower: Region = field(metadata=left_out)  #: no wheel slips
    upper: Region = field(metadata=left_out)  #: if wheels never slip

    @reported
    def lean(self) -> float:
        """Largest lean of the plane [rad]."""
        return float(self.lower.across[-1])

    @reported
    def rate(self) -> float:
        """Largest lean rate of the plane [rad/s]."""
        return float(self.lower.along[-1])

    @reported
    def lower_area(self) -> float:
        """Area of recovery in which no wheel slips [rad^2/s]."""
        return self.lower.area

    @reported
    def upper_area(self) -> float:
        """Area of recovery if wheels never slip [rad^2/s]."""
        return self.upper.area


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLimits:
    """The limits of one closed loop."""

    directions: NDArray[np.float64]  #: (d,) on the floor, from x towards y [rad]
    heights: NDArray[np.float64]  #: (h,) of impulses above the ball's centre [m]
    lean: LimitBounds  #: (d,): the lean at rest [rad]
    impulse: LimitBounds  #: (h, d) [N s]
    plane: Plane  #: in the direction of the least lower bound of the lean

    @property
    def central_impulse(self) -> LimitBounds:
        """The impulses (d,) [N s] at the height of the centre of mass."""
        one = self.impulse
        return LimitBounds(lower=one.lower[_CENTER], upper=one.upper[_CENTER])

    def summary(self) -> Summary:
        """Return the largest tilt and impulse that are recovered from in every direction."""
        return report_summary(self)

    def plot(self) -> Figure:
        """Return a figure of the tilts and tilt rates that are recovered from, in the worst direction."""
        return plotted(self)


Kind = Literal["lean", "impulse"]


@dataclass(frozen=True, kw_only=True)
class TwinLimit:
    """A limit on loop and twin: a lean at rest [rad], or an impulse at the centre of mass's height [N s]."""

    kind: Kind
    direction: float  #: [rad]
    lower: float  #: of the model, no wheel slips
    twin: float  #: to 1/29 of the upper bound
    upper: float  #: of the model if wheels never slip

    @reported
    def agrees(self) -> bool:
        """Whether the twin's limit is between the model's bounds, to within 5 %."""
        return 0.95 * self.lower <= self.twin <= 1.05 * self.upper


def find_limits(loop: Loop, *, run: Run = DEFAULT_RUN) -> RobotLimits:
    """Return the largest tilts and impulses from which a robot recovers.

    Parameters
    ----------
    loop : Loop
        Its grip is that of the lower bounds.
    run : Run, optional
        Its progress is reported; the loop has its own seed.
    """
    unlimited = replace(loop, grip=np.inf)
    directions = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    heights = loop.robot.body.center_of_mass * np.array(HEIGHTS)

    def bounds(start_of: StartOf, shape: tuple[int, ...], end: float) -> LimitBounds:
        lower, upper = (reach(one.recovers, start_of, shape=shape, end=end) for one in (loop, unlimited))
        return LimitBounds(lower=lower, upper=upper)

    run.progress(Progress(stage="tilts"))
    lean = bounds(lambda sizes: leaning_state(directions, sizes), directions.shape, LARGEST_LEAN)
    run.progress(Progress(stage="impulses"))
    impulse = bounds(
        lambda sizes: pushed_state(loop.model, directions, sizes, heights[:, None]),
        (len(heights), len(directions)),
        _FASTEST * (loop.robot.ball.mass + loop.robot.body.mass),
    )
    run.progress(Progress(stage="tilts and tilt rates"))
    worst = float(directions[lean.lower.argmin()])
    widest = float(lean.upper[lean.lower.argmin()])
    growth = float(loop.model.linearize().poles().real.max())
    ends = (min(1.6 * widest, LARGEST_LEAN), 2.2 * growth * widest)
    lower, upper = (
        map_region(one.recovers, lambda a, b: leaning_state(worst, a, b), ends=ends)
        for one in (loop, unlimited)
    )
    return RobotLimits(
        directions=directions,
        heights=heights,
        lean=lean,
        impulse=impulse,
        plane=Plane(direction=worst, lower=lower, upper=upper),
    )


#: an impulse on the twin is a force of this duration [s], four samples of the nominal scenario
PUSH_DURATION = 0.02
_PUSH_TIME = 0.5  # when it begins [s]
_HALVINGS = 5


def twin_limits(
    loop: Loop, found: RobotLimits, *, directions: Sequence[int], run: Run = DEFAULT_RUN
) -> list[TwinLimit]:
    """Return the twin's limits beside the loop's, by bisection between zero and 1.1 times the loop's upper bound.

    Parameters
    ----------
    loop : Loop
        With a scenario; its lean of a fall is replaced by the model's, and it has its play.
    found : RobotLimits
        The loop's.
    directions : sequence of int
        Places among its directions.
    run : Run, optional
        Its seed is that of every simulated run; its progress is reported after each.
    """
    assert loop.scenario is not None
    scenario = replace(loop.scenario, fallen_lean=LARGEST_LEAN)
    bounds: dict[Kind, LimitBounds] = {"lean": found.lean, "impulse": found.central_impulse}
    rays: list[tuple[Kind, int]] = [(kind, place) for place in directions for kind in bounds]
    lower, upper = (
        np.array([getattr(bounds[kind], side)[place] for kind, place in rays]) for side in ("lower", "upper")
    )

    def tried(kind: Kind, direction: float, size: float) -> GridRun:
        start, pushes, duration = np.zeros(10), (), DURATION
        if kind == "lean":
            start = leaning_state(direction, size)
        else:
            force = size / PUSH_DURATION * np.array([math.cos(direction), math.sin(direction), 0.0])
            height = loop.robot.body.center_of_mass
            push = Push(time=_PUSH_TIME, duration=PUSH_DURATION, force=(*force.tolist(),), height=height)
            pushes, duration = (push,), _PUSH_TIME + DURATION
        plant = TwinRobot(robot=loop.robot, scenario=replace(scenario, pushes=pushes), known=loop.robot)
        condition = Condition(plant=plant, reference=hold, duration=duration, seed=run.seed, start=start)
        return GridRun(candidate=kind, controller=loop.controller, condition=condition)

    low, high = np.zeros(len(rays)), 1.1 * upper
    for halving in range(_HALVINGS):
        middle = 0.5 * (low + high)

        def report(now: Progress, before: int = halving * len(rays)) -> None:
            run.progress(
                Progress(stage="limits on the twin", done=before + now.done, total=_HALVINGS * len(rays))
            )

        runs = [
            tried(kind, float(found.directions[place]), size)
            for (kind, place), size in zip(rays, middle.tolist(), strict=True)
        ]
        # in this process: twins in threads wait for each other's Python
        asked = run_grid(
            runs,
            lambda _, log: log.ended is None,
            workers=Processes(count=1),
            run=replace(run, progress=report),
        )
        low, high = np.where(asked.answers, middle, low), np.where(asked.answers, high, middle)
    return [
        TwinLimit(kind=kind, direction=float(found.directions[place]), lower=least, twin=twin, upper=most)
        for (kind, place), least, twin, most in zip(
            rays, lower.tolist(), low.tolist(), upper.tolist(), strict=True
        )
    ]
