"""The largest tilts and impulses that a robot with a controller recovers from, on the loop and on the twin.

They are found for tilts at rest, for impulses on the body, and over a plane of lean and lean rate, on the compiled loop
with the sensors of a scenario; every run has its own noise. The equations of motion have no slip, so the loop gives
two bounds of each: `lower`, from runs in which no wheel exceeds its grip, and `upper`, from runs with unlimited grip.

A ray is first tried at `LOOKS` sizes, so that a fall between two sizes from which the robot recovers is not overlooked;
the first fall is then bisected, all rays in one batch. A run ends early once it is lost:
leaning outward beyond the lean from which the motors' full torque can still recover. That is exact for a robot at rest;
a tenth of the lean is a margin for what is neglected.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ballbot.arrays import Bools, Floats
from ballbot.control.controller import Controller
from ballbot.control.references import hold
from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Processes, Run
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.model import Model
from ballbot.progress import Progress, in_stage
from ballbot.results import left_out, reported
from ballbot.robot import Robot
from ballbot.simulation.batch import OutcomeBounds, simulate_batch
from ballbot.simulation.imperfections import Imperfections, Push
from ballbot.summary import Plotted, Summary
from ballbot.twin.scenario import Scenario
from ballbot.validation.models import recoverable_leans
from ballbot.workflows.grid import Condition, GridRun, LoopRobot, TwinRobot, run_grid

#: a robot that has not fallen after this time [s] has recovered: a fall grows e times in a fifth of a second. Of 3840
#: runs of three controllers with sensors none ended differently after 5 s
DURATION = 3.0

_BEYOND = 1.1  # times the lean from which full torque does not turn a fall back
_DIRECTIONS = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlledRobot:
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
            self.scenario.at(0.0),
            sensors=sensors,
            fix=None,
            backlash=0.0,
            pushes=(),
            fallen_lean=LARGEST_LEAN,
        )
        robot = LoopRobot.of(self.robot, scenario, known=self.robot)
        return LoopRobot(
            model=Model(robot.model.robot, step=self.step),
            imperfections=replace(robot.imperfections, seed=self.seed),
        )

    @property
    def model(self) -> Model:
        """The exact model."""
        return self.plant.model

    @cached_property
    def verdict(self) -> OutcomeBounds:
        """When a run is lost."""
        return OutcomeBounds(lost=lost_lean(self.model), grip=self.grip)

    def recovers(self, starts: Floats) -> Bools:
        """Return from which starts (runs, 10) the robot recovers."""
        kept = np.abs(starts[:, 2:4]).max(axis=1) <= LARGEST_LEAN
        if kept.any():
            kept[kept] = simulate_batch(
                self.model,
                self.controller,
                hold(),
                duration=DURATION,
                initial_states=starts[kept],
                imperfections=self.plant.imperfections,
                verdict=self.verdict,
                every=0,
            ).survived
        return kept


#: from starts (runs, 10) to whether the robot recovers (runs,)
Recovers = Callable[[Floats], Bools]
#: from sizes (k, *shape) along each of some rays to starts (k, *shape, 10)
StartOf = Callable[[Floats], Floats]


def lost_lean(model: Model) -> float:
    """Return the lean [rad] beyond which a robot that leans outward is lost, whatever its motors and friction do."""
    robot = model.robot
    largest = robot.drive.torque_limit + np.array(robot.friction.breakaway)
    return min(_BEYOND * float(recoverable_leans(model, _DIRECTIONS, largest=largest).max()), LARGEST_LEAN)


#: number of sizes at which a ray is first tried, evenly spaced
LOOKS = 24
#: of each ray, each to half the interval left: 1/24 of the ray becomes 1/12288
_HALVINGS = 9
#: points of a map a side, about as fine as it is drawn
POINTS = 81


def reach(recovers: Recovers, start_of: StartOf, *, shape: tuple[int, ...], end: float) -> Floats:
    """Return the sizes (*shape) up to which a robot recovered from every start tried along some rays, up to an end."""

    def looked(sizes: Floats) -> Bools:
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


def leaning_state(direction: ArrayLike, lean: ArrayLike, rate: ArrayLike = 0.0) -> Floats:
    """Return states (..., 10) that lean, phi cos(direction) - theta sin(direction) [rad], at a rate, ball at rest."""
    direction, lean, rate = np.broadcast_arrays(direction, lean, rate)
    states = np.zeros((*lean.shape, 10))
    for index, size in ((2, lean), (7, rate)):
        states[..., index] = -size * np.sin(direction)
        states[..., index + 1] = size * np.cos(direction)
    return states


def pushed_state(model: Model, direction: ArrayLike, impulse: ArrayLike, height: ArrayLike) -> Floats:
    """Return states (..., 10) just after an impulse on a body that is upright and at rest.

    The impulse J [N s] at the height h above the ball's centre is the generalised impulse p = (J, h e_z x J) on the
    ball's position and the body's rotation, and M(0) q_dot = p. Its direction is on the floor [rad].
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

    lower: Floats  #: no wheel slips
    upper: Floats  #: if wheels never slip


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """The states of lean and lean rate in one direction from which a robot recovers."""

    direction: float  #: on the floor [rad]
    lean: float  #: largest of the plane, to both sides [rad]
    rate: float  #: the same of the lean's rate [rad/s]
    leans: Floats = field(metadata=left_out)  #: (`POINTS`,) [rad]
    rates: Floats = field(metadata=left_out)  #: (`POINTS`,) [rad/s]
    lower: Bools = field(metadata=left_out)  #: (leans, rates): no wheel slips
    upper: Bools = field(metadata=left_out)  #: if wheels never slip
    lower_area: float  #: of recovery in which no wheel slips [rad^2/s]
    upper_area: float  #: if wheels never slip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotLimits(Plotted):
    """The limits of one closed loop; `plot()` shows the leans and lean rates that it recovers from."""

    directions: Floats  #: (d,) on the floor, from x towards y [rad]
    heights: Floats  #: (h,) of impulses above the ball's centre [m]
    lean: LimitBounds  #: (d,): the lean at rest [rad]
    impulse: LimitBounds  #: (h, d) [N s]
    plane: Plane  #: in the direction of the least lower bound of the lean

    @property
    def central_impulse(self) -> LimitBounds:
        """The impulses (d,) [N s] at the height of the centre of mass."""
        return LimitBounds(lower=self.impulse.lower[_CENTER], upper=self.impulse.upper[_CENTER])

    @property
    def words(self) -> str:
        """The smallest limit of tilt and of impulse at the centre of mass over all directions, by both bounds."""
        leans, impulses = (
            " / ".join(f"{unit * bound.min():.1f}" for bound in (bounds.lower, bounds.upper))
            for unit, bounds in ((math.degrees(1.0), self.lean), (1.0, self.central_impulse))
        )
        return f"a tilt at rest of {leans} degrees and an impulse of {impulses} N s"

    def summary(self) -> Summary:
        """Return the smallest limits."""
        return Summary(title="The largest tilt and impulse in every direction", sentences=(self.words,))


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


def find_limits(loop: ControlledRobot, *, run: Run = DEFAULT_RUN) -> RobotLimits:
    """Return the largest tilts and impulses that a robot recovers from; the loop's grip is that of the lower bounds."""
    unlimited = replace(loop, grip=np.inf)
    directions = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    heights = loop.robot.body.center_of_mass * np.array(HEIGHTS)

    def bounds(start_of: StartOf, shape: tuple[int, ...], end: float) -> LimitBounds:
        lower, upper = (reach(case.recovers, start_of, shape=shape, end=end) for case in (loop, unlimited))
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
    worst = int(lean.lower.argmin())
    widest = float(lean.upper[worst])
    growth = float(loop.model.linearize().poles().real.max())
    lean_end, rate_end = min(1.6 * widest, LARGEST_LEAN), 2.2 * growth * widest
    leans, rates = (np.linspace(-end, end, POINTS) for end in (lean_end, rate_end))
    starts = leaning_state(directions[worst], np.repeat(leans, POINTS), np.tile(rates, POINTS))
    lower, upper = (each.recovers(starts).reshape(POINTS, POINTS) for each in (loop, unlimited))
    lean_step, rate_step = leans[1] - leans[0], rates[1] - rates[0]
    plane = Plane(
        direction=float(directions[worst]),
        lean=lean_end,
        rate=rate_end,
        leans=leans,
        rates=rates,
        lower=lower,
        upper=upper,
        lower_area=float(lower.sum() * lean_step * rate_step),
        upper_area=float(upper.sum() * lean_step * rate_step),
    )
    return RobotLimits(directions=directions, heights=heights, lean=lean, impulse=impulse, plane=plane)


#: a gain that recovers from smaller impulses than this share of the own gain's is not mixed with it
LEAST_RECOVERED = 0.95
#: directions in which they are compared
_COMPARED = 12


def recovered_shares(controller: Controller) -> Floats:
    """Return the impulses that each other gain of a controller recovers from over those of its own gain.

    The least over some directions (gains,), at the centre of mass's height, with unlimited grip and the true state.
    InputError if its own gain recovers from none in one of them.
    """
    directions = 2.0 * np.pi * np.arange(_COMPARED) / _COMPARED
    robot = controller.robot

    def largest(one: Controller) -> Floats:
        loop = ControlledRobot(robot=robot, controller=one, grip=np.inf)
        return reach(
            loop.recovers,
            lambda sizes: pushed_state(loop.model, directions, sizes, robot.body.center_of_mass),
            shape=directions.shape,
            end=_FASTEST * (robot.ball.mass + robot.body.mass),
        )

    own = largest(controller)
    if not own.min() > 0.0:
        raise InputError(
            "The controller's own gain recovers from no impulse, so that no other gain can be compared with it. Give "
            "it other weights or a higher torque limit."
        )
    return np.array([(largest(other) / own).min() for other in controller.others])


def refuse_weaker_gains(controller: Controller) -> None:
    """Raise InputError if another gain of a controller recovers from clearly smaller impulses than its own."""
    for number, share in enumerate(recovered_shares(controller), 2):
        if share < LEAST_RECOVERED:
            raise InputError(
                f"Gain {number} recovers from {100.0 * share:.0f} % of the impulse that the controller's own gain "
                f"recovers from; mixed in while the robot balances, it must be {100.0 * LEAST_RECOVERED:.0f} % or more."
            )


#: an impulse on the twin is a force of this duration [s], four samples of the nominal scenario
PUSH_DURATION = 0.02
_PUSH_TIME = 0.5  # when it begins [s]
_TWIN_HALVINGS = 5


def twin_limits(
    loop: ControlledRobot, on_loop: RobotLimits, *, directions: Sequence[int], run: Run = DEFAULT_RUN
) -> list[TwinLimit]:
    """Return the twin's limits beside the loop's, in directions by index, by bisection up to 1.1 times these."""
    assert loop.scenario is not None
    scenario = replace(loop.scenario, fallen_lean=LARGEST_LEAN)
    bounds: dict[Kind, LimitBounds] = {"lean": on_loop.lean, "impulse": on_loop.central_impulse}
    towards = on_loop.directions.tolist()
    rays = [
        TwinLimit(
            kind=kind, direction=towards[k], lower=float(each.lower[k]), twin=0.0, upper=float(each.upper[k])
        )
        for k in directions
        for kind, each in bounds.items()
    ]

    def tried(ray: TwinLimit, size: float) -> GridRun:
        start, pushes, duration = leaning_state(ray.direction, size), (), DURATION
        if ray.kind == "impulse":
            height = loop.robot.body.center_of_mass
            push = Push.of_impulse(
                size, ray.direction, time=_PUSH_TIME, duration=PUSH_DURATION, height=height
            )
            start, pushes, duration = np.zeros(10), (push,), _PUSH_TIME + DURATION
        plant = TwinRobot(robot=loop.robot, scenario=replace(scenario, pushes=pushes), known=loop.robot)
        condition = Condition(plant=plant, reference=hold, duration=duration, seed=run.seed, start=start)
        return GridRun(candidate=ray.kind, controller=loop.controller, condition=condition)

    low, high = np.zeros(len(rays)), 1.1 * np.array([ray.upper for ray in rays])
    for halving in range(_TWIN_HALVINGS):
        middle = 0.5 * (low + high)
        stage = f"limits on the twin, step {halving + 1} of {_TWIN_HALVINGS}"
        kept = run_grid(
            [tried(ray, size) for ray, size in zip(rays, middle.tolist(), strict=True)],
            lambda _, log: log.ended is None,
            workers=Processes(count=1),  # twins in threads wait for each other's Python
            run=replace(run, progress=in_stage(run.progress, stage)),
        ).answers
        low, high = np.where(kept, middle, low), np.where(kept, high, middle)
    return [replace(ray, twin=size) for ray, size in zip(rays, low.tolist(), strict=True)]
