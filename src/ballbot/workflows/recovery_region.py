"""From which initial states a closed loop recovers: runs that end early, and the edge of the region.

A run ends as soon as its outcome is known (`ballbot.simulation.verdict`):

    settled    the sampled linear closed loop e[k+1] = (F - G K) e[k] will from here on need no torque above 40 % of
               the limit or of the wheels' grip at rest, no wheel speed above 40 % of the motors' highest and
               no lean above 0.15 rad, by the rows K (F - G K)^k and so on. The law stays linear, and the robot
               comes to rest
    lost       leaning outward further than where the motors' full torque still turns the fall back

The first is exact for the linear loop without dry friction and noise, the second for a robot at rest. Most of the
torque and a tenth of the lean remain as a margin for what is neglected. Tests compare a sample of runs with runs not
cut short.

A ray is first tried in `LOOKS` places, so that a loss between two sizes from which the robot recovers is not
overlooked. The first loss is then bisected, all rays in one batch. A plane is tried on a grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.lqr import held
from ballbot.control.parts import Parts
from ballbot.control.references import hold
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.geometry import wheel_load
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.batch import Verdict
from ballbot.simulation.imperfections import Imperfections
from ballbot.twin.scenario import Scenario
from ballbot.validation.models import recoverable_leans
from ballbot.workflows.grid import LoopRobot, run_loop

#: a robot that has not fallen after this time [s] has recovered: a fall grows e times in a fifth of a second. Of 3840
#: runs of three controllers with sensors none ended differently after 5 s
DURATION = 3.0

_FRACTION = 0.4  # of torque limit and speed limit that a settled robot will need at most
_LEAN = 0.15  # [rad] that it will lean at most
_EVERY = 10  # samples at which its future is looked at
_FADED = 0.02  # of the largest row: what comes later is no more than that
_BEYOND = 1.1  # times the lean from which full torque does not turn a fall back
_DIRECTIONS = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """A robot with its controller, within its motors' limits, under a scenario."""

    robot: Robot  #: the true one; the controller has its own friction
    controller: Controller
    #: its sensors, delay, noise, floor and payload count, and its play does not: the impact at a stop would count as
    #: slip. None if the controller sees the true state
    scenario: Scenario | None = None
    grip: float = 1.0  #: friction coefficient of the wheels on the ball; a run in which a wheel slips is lost
    seed: int = 0  #: of the first run; the others' follow it
    step: float = 0.005  #: inner step [s]

    @cached_property
    def plant(self) -> LoopRobot:
        """The robot on the loop."""
        if self.scenario is None:
            return LoopRobot(model=Model(self.robot, step=self.step), imperfections=Imperfections())
        sensors = replace(self.scenario.sensors, sample_time=self.controller.sample_time)
        scenario = replace(
            self.scenario, sensors=sensors, fix=None, backlash=0.0, pushes=(), fallen_lean=LARGEST_LEAN
        )
        made = LoopRobot.of(self.robot, scenario, known=self.robot)
        return LoopRobot(
            model=Model(made.model.robot, step=self.step),
            imperfections=replace(made.imperfections, seed=self.seed),
        )

    @property
    def model(self) -> Model:
        """The exact model."""
        return self.plant.model

    @cached_property
    def verdict(self) -> Verdict:
        """When a run's outcome is known; the state alone does not determine the future of a loop that is late."""
        borne = self.plant.imperfections
        late = borne.delay > 0 or borne.lag > 0.0 or borne.sensor_faults is not None
        settled = settled_rows(self.model, self.controller, grip=self.grip)
        return Verdict(
            settled=np.full((1, 10), np.inf) if late else settled,
            lost=lost_lean(self.model),
            grip=self.grip,
        )

    def recovers(self, starts: NDArray[np.float64], *, cut_short: bool = True) -> NDArray[np.bool_]:
        """Return from which starts (runs, 10) the robot recovers, with the origin as its reference.

        Parameters
        ----------
        starts : ndarray (runs, 10)
        cut_short : bool
            End runs whose outcome is known.
        """
        whole = replace(self.verdict, settled=np.zeros((0, 10)), lost=LARGEST_LEAN)
        kept = np.abs(starts[:, 2:4]).max(axis=1) <= LARGEST_LEAN
        if kept.any():
            kept[kept] = run_loop(
                [self.plant],
                [self.controller],
                hold(),
                duration=DURATION,
                starts=starts[kept],
                verdict=self.verdict if cut_short else whole,
                every=0,
            ).survived
        return kept


#: from starts (runs, 10) to whether the robot recovers (runs,)
Recovers = Callable[[NDArray[np.float64]], NDArray[np.bool_]]
#: from sizes (k, *shape) along each of some rays to starts (k, *shape, 10)
StartOf = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def settled_rows(model: Model, controller: Controller, *, grip: float) -> NDArray[np.float64]:
    """Return the rows c (m, 10) of what counts as settled, |c e| <= 1.

    If the linear loop is unstable, or parts of the controller have a memory (the state alone then does not determine
    the future), the result is one row of infinities: nothing counts as settled.
    """
    linear, K = model.linearize(), controller.gain
    F, G = held(linear.A, linear.B, controller.sample_time)
    loop = F - G @ K
    if controller.parts != Parts() or np.abs(np.linalg.eigvals(loop)).max() >= 1.0:
        return np.full((1, 10), np.inf)
    speeds = np.hstack([np.zeros((len(K), 5)), model.wheel_jacobian(np.zeros(5))])
    slips = grip * wheel_load(model.robot) * model.robot.wheels.radius
    now = [
        K / (_FRACTION * min(controller.torque_limit, slips)),
        speeds / (_FRACTION * model.robot.drive.top_speed),
        np.eye(10)[2:4] / _LEAN,
    ]
    rows, ahead = [np.concatenate(now)], np.linalg.matrix_power(loop, _EVERY)
    while np.abs(rows[-1]).max() > _FADED * np.abs(rows[0]).max():
        rows.append(rows[-1] @ ahead)
    return np.concatenate(rows)


def lost_lean(model: Model) -> float:
    """Return the lean [rad] beyond which a robot that leans outward is lost, whatever its motors and friction do."""
    robot = model.robot
    largest = robot.drive.torque_limit + np.array(robot.friction.breakaway)
    return min(_BEYOND * float(recoverable_leans(model, _DIRECTIONS, largest=largest).max()), LARGEST_LEAN)


#: places at which a ray is first tried, evenly spread
LOOKS = 24
#: of each ray, each to half the interval left: 1/24 of the ray becomes 1/12288
_HALVINGS = 9
#: points of a map a side, about as fine as it is drawn
POINTS = 81


def reach(
    recovers: Recovers,
    start_of: StartOf,
    *,
    shape: tuple[int, ...],
    end: float,
) -> NDArray[np.float64]:
    """Return the sizes (*shape) up to which a robot recovered from every start tried along each of some rays.

    Parameters
    ----------
    recovers : callable
        From starts (runs, 10) to whether the robot recovers (runs,).
    start_of : callable
        From sizes (k, *shape) along each ray to starts (k, *shape, 10).
    shape : tuple of int
        Of the rays.
    end : float
        The rays' end, in the unit of the sizes.
    """

    def looked(sizes: NDArray[np.float64]) -> NDArray[np.bool_]:
        return recovers(start_of(sizes).reshape(-1, 10)).reshape(sizes.shape)

    looks = end * np.arange(1, LOOKS + 1) / LOOKS
    first = looked(np.broadcast_to(looks.reshape(-1, *(1,) * len(shape)), (LOOKS, *shape)))
    limited = np.logical_not(np.all(first, axis=0))
    kept = np.where(limited, first.argmin(axis=0), LOOKS) * (end / LOOKS)
    interval = end / LOOKS
    for _ in range(_HALVINGS):
        interval *= 0.5
        further = looked((kept + interval)[None])[0]
        kept = np.where(limited & further, kept + interval, kept)
    return kept


@dataclass(frozen=True, kw_only=True, eq=False)
class Region:
    """From which starts of a plane a robot recovers."""

    across: NDArray[np.float64]  #: (a,), the first coordinate
    along: NDArray[np.float64]  #: (b,), the second
    kept: NDArray[np.bool_]  #: (a, b)

    @property
    def area(self) -> float:
        """The area of recovery, in the product of both coordinates' units."""
        cell = (self.across[1] - self.across[0]) * (self.along[1] - self.along[0])
        return float(self.kept.sum() * cell)


def map_region(
    recovers: Recovers,
    start_of: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
    *,
    ends: tuple[float, float],
) -> Region:
    """Return from which starts of a rectangle about the origin a robot recovers.

    Parameters
    ----------
    recovers : callable
        From starts (runs, 10) to whether the robot recovers (runs,).
    start_of : callable
        From both coordinates (k,) to starts (k, 10).
    ends : tuple of float
        The rectangle reaches from minus to plus this in each coordinate.
    """
    across, along = (np.linspace(-end, end, POINTS) for end in ends)
    starts = start_of(np.repeat(across, POINTS), np.tile(along, POINTS))
    return Region(across=across, along=along, kept=recovers(starts).reshape(POINTS, POINTS))
