"""LQR weights chosen by search over perturbed robots, for the worst tenth of them and not the mean.

A robot costs

    J = e / e_n + r / r_n,      10 to 20 for a robot that falls, the more the earlier

e is the root mean square distance from the reference over the run's last part, r the root mean square change of torque
from sample to sample; e_n and r_n are the nominal gain's medians over the same robots, whose J is therefore about 2. A
set of robots counts by the mean of the largest tenth of the J.

The search is an evolution over the logarithms of six state weights, those of x and y, of theta and phi, and of their
rates alike; the torque weight stays, since only ratios matter. Its middle is the nominal gain, its ends a hundredth and
a hundred times its weights. Every candidate runs on the same robots with the same noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydantic import ConfigDict, Field

from ballbot.arrays import MOST_TRIALS, Bools, Floats
from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign
from ballbot.control.margins import Margins, loop_margins
from ballbot.control.presets import NOMINAL_STATE_WEIGHTS, NOMINAL_TORQUE_WEIGHT, design_gain
from ballbot.control.references import hold
from ballbot.errors import InputError
from ballbot.files import parse_toml
from ballbot.fitting.fit import evolve
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.progress import Progress
from ballbot.results import key, left_out, to_results
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.rounding import percent
from ballbot.schema import validate_table
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import MAX_DELAY, MAX_SLOPE
from ballbot.summary import Reported
from ballbot.twin.scenario import Scenario
from ballbot.workflows.controller_design import design_results
from ballbot.workflows.grid import LoopRobot

#: the ball lies so far from where it is asked to be at the start [m]
INITIAL_OFFSET = 0.3
#: a run [s], and its last part, which counts as settled
RUN, SETTLED = 8.0, 2.0
#: the share of the robots that counts
TAIL = 0.1
#: places of the state that share a weight
GROUPS = ((0, 1), (2, 3), (4,), (5, 6), (7, 8), (9,))
#: decades to either side of the nominal weights
DECADES = 2.0
_FALL = 10.0
_EVERY = 10  # samples between two that are looked at for the error
_NO_GAIN = 100.0  # the cost of weights that have none


_Share = Annotated[float, Field(ge=0.0, lt=1.0)]
_STEEPEST = math.degrees(math.atan(MAX_SLOPE))


@dataclass(frozen=True, kw_only=True)
class PerturbationRanges:
    """Ranges of the perturbed robots about the one described, each uniform and independent of the others."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    #: of the body, either way, as a share; its inertia about its centre of mass goes with it
    mass: _Share = 0.2
    height: _Share = 0.2  #: of the centre of mass, either way, as a share
    friction: _Share = 0.2  #: of each wheel's and of the rolling friction, either way, as a share
    delay: Annotated[int, Field(ge=0)] = 2  #: most samples by which torques come late
    tilt: Annotated[float, Field(ge=0.0, le=_STEEPEST)] = 1.0  #: most of the floor [degrees]

    @staticmethod
    def parse(text: str) -> PerturbationRanges:
        """Return the ranges of a text such as mass=0.2,tilt=1; InputError if a name or a number is not valid."""
        tree = parse_toml(text.replace(",", "\n"), source=f"--perturb {text!r}, such as mass=0.2,tilt=1,")
        try:
            return validate_table(PerturbationRanges, tree, of="perturbed robots")
        except InputError as error:
            raise InputError(f"--perturb {text!r}: {error}") from None


def draw_perturbed(
    robot: Robot, count: int, *, spread: PerturbationRanges, scenario: Scenario, seed: int
) -> tuple[list[LoopRobot], Floats]:
    """Draw robots from the ranges, under a scenario, and starts (robots, 10), `INITIAL_OFFSET` from the origin."""
    random = np.random.default_rng([seed, 71])
    robots, starts = [], np.zeros((count, 10))
    for lane in range(count):
        # mass, height and each friction: U(1 - share, 1 + share)
        mass, height = (1.0 + random.uniform(-1.0, 1.0, 2) * (spread.mass, spread.height)).tolist()
        *wheels, rolling = 1.0 + spread.friction * random.uniform(-1.0, 1.0, robot.wheel_count + 1)
        # delay: any whole number of samples; tilt and its direction, and the start's: uniform
        delay = int(random.integers(0, spread.delay + 1))
        slope = math.tan(math.radians(spread.tilt * float(random.uniform(0.0, 1.0))))
        uphill, away = random.uniform(0.0, 2.0 * np.pi, 2)
        true = robot.replace(
            body=scaled_body(robot.body, mass=mass, height=height),
            friction=scaled_friction(robot.friction, wheels, rolling_factor=float(rolling)),
        )
        loop_robot = LoopRobot.of(true, scenario, known=robot)
        borne = replace(
            loop_robot.imperfections,
            delay=min(loop_robot.imperfections.delay + delay, MAX_DELAY),
            slope=(slope * math.cos(uphill), slope * math.sin(uphill)),
            seed=seed + lane,
        )
        robots.append(replace(loop_robot, imperfections=borne))
        starts[lane, :2] = INITIAL_OFFSET * math.cos(away), INITIAL_OFFSET * math.sin(away)
    return robots, starts


@dataclass(frozen=True, kw_only=True, eq=False)
class RunMeasures:
    """How controllers did on each of the robots: arrays (controllers, robots)."""

    error: Floats  #: root mean square once settled [m]; NaN of one that fell
    roughness: Floats  #: torque's change from sample to sample [N m]
    ended: Floats  #: when it fell [s]; infinity where it stood

    @property
    def fell(self) -> Bools:
        """Whether each run fell."""
        return np.isfinite(self.ended)


def measure_runs(
    controllers: Sequence[Controller], robots: Sequence[LoopRobot], starts: Floats
) -> RunMeasures:
    """Run every controller on every perturbed robot, all in one batch; each robot has the same noise for all."""
    shape = (len(controllers), len(robots))
    lanes = [*robots] * len(controllers)
    batch = simulate_batch(
        [robot.model for robot in lanes],
        [controller for controller in controllers for _ in robots],
        hold(),
        duration=RUN,
        initial_states=np.tile(starts, (len(controllers), 1)),
        imperfections=[robot.imperfections for robot in lanes],
        every=_EVERY,
    )
    late = batch.t >= RUN - SETTLED  # as the rows' ends are beyond it
    error = np.sqrt((batch.next_states[:, late, :2] ** 2).sum(axis=2).mean(axis=1))
    return RunMeasures(
        error=np.where(batch.survived, error, np.nan).reshape(shape),
        roughness=batch.torque_change.reshape(shape),
        ended=batch.ended.reshape(shape),
    )


@dataclass(frozen=True, kw_only=True)
class CostUnits:
    """The units of J's two terms."""

    error: float  #: e_n [m]
    roughness: float  #: r_n [N m]

    @staticmethod
    def of(nominal: RunMeasures) -> CostUnits:
        """Return the units by the nominal gain's runs (1, robots). InputError if it falls with half of the robots."""
        if (share := float(np.mean(nominal.fell))) > 0.5:
            raise InputError(
                f"The nominal gain falls with {percent(share)} of the perturbed robots, so costs "
                "cannot be compared with its cost. Reduce the perturbation."
            )
        roughness = float(np.median(nominal.roughness[~nominal.fell]))
        return CostUnits(error=float(np.nanmedian(nominal.error)), roughness=roughness)

    def costs(self, seen: RunMeasures) -> Floats:
        """Return J (controllers, robots)."""
        standing = seen.error / self.error + seen.roughness / self.roughness
        return np.where(seen.fell, _FALL * (2.0 - np.minimum(seen.ended / RUN, 1.0)), standing)


def worst_tenth(costs: Floats) -> Floats:
    """Return the mean of the largest tenth of costs (..., robots), of one robot at least; NaN of no robot."""
    count = max(1, round(TAIL * costs.shape[-1]))
    return np.sort(costs, axis=-1)[..., -count:].mean(axis=-1) if costs.size else np.array(np.nan)


@dataclass(frozen=True, kw_only=True)
class Effort:
    """The size of the search. Raise InputError if a number is below its minimum or above the largest."""

    robots: int = 200  #: perturbed robots on which every candidate runs
    generations: int = 30
    population: int = 12  #: candidates of a generation
    fresh: int = 500  #: other robots on which what was found is compared

    def __post_init__(self) -> None:
        for name, least in (("robots", 10), ("generations", 1), ("population", 4), ("fresh", 10)):
            if not least <= getattr(self, name) <= MOST_TRIALS:
                raise InputError(
                    f"The number of {name} is {getattr(self, name)}; it must be {least} to {MOST_TRIALS}."
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedDesign:
    """The results of one design on the fresh robots."""

    gain: Floats
    worst_tenth: float  #: of J
    mean: float  #: of J
    worst_error: float  #: mean of the largest tenth of the settled errors of those that stood [m]
    worst_roughness: float  #: the same of the torque's change [N m]
    falls: int
    costs: Floats = field(metadata=left_out)  #: (fresh robots,) J of each


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobustDesign(Reported):
    """A gain found by search over perturbed robots, compared with the nominal one."""

    design: LqrDesign = field(metadata=left_out)
    controller: Controller = field(metadata=left_out)
    state_weights: tuple[float, ...]
    torque_weight: float
    units: CostUnits  #: of J's terms
    history: tuple[float, ...]  #: best worst tenth after each generation, on the robots of the search
    compared: dict[str, ComparedDesign] = field(metadata=key("on_fresh_robots"))  #: "robust", "nominal"
    fresh: int = field(metadata=key("fresh_robots"))  #: number of these robots
    spread: PerturbationRanges = field(metadata=key("perturbed"))
    scenario: str  #: its name

    @property
    def loop_margins(self) -> Margins:
        """The margins of the loop."""
        return loop_margins(self.controller)

    def to_dict(self) -> dict[str, object]:
        """Return the entries of results.json."""
        return design_results(self.controller, self.design, self.loop_margins) | to_results(self)


def robust_design(
    robot: RobotLike,
    *,
    compensation: Compensation,
    spread: PerturbationRanges,
    scenario: Scenario,
    effort: Effort,
    run: Run = DEFAULT_RUN,
) -> RobustDesign:
    """Search for the weights whose worst tenth over perturbed robots is best, and compare them on fresh robots.

    The gain is designed for the nominal robot, whose friction is compensated; all robots have the scenario's sensors,
    drive and play. The run's seed fixes the result. InputError if the nominal gain falls with half of the robots.
    """
    robot = as_robot(robot)
    drawn = draw_perturbed(robot, effort.robots, spread=spread, scenario=scenario, seed=run.seed)

    def controller_of(weights: tuple[float, ...]) -> Controller:
        gain = design_gain(robot, state_weights=weights).gain
        return Controller(robot, gain, compensation=compensation, estimator="kalman")

    nominal = controller_of(NOMINAL_STATE_WEIGHTS)
    units = CostUnits.of(measure_runs([nominal], *drawn))

    def cost_of(candidates: Floats) -> Floats:
        costs, by_row = np.full(len(candidates), _NO_GAIN), dict[int, Controller]()
        for row, candidate in enumerate(candidates):
            # weights may be so far apart that the equations have no solution in these digits
            with suppress(InputError):
                by_row[row] = controller_of(weights_of(candidate))
        if by_row:
            costs[list(by_row)] = worst_tenth(units.costs(measure_runs(list(by_row.values()), *drawn)))
        return costs

    optimum = evolve(
        cost_of, size=len(GROUPS), generations=effort.generations, population=effort.population, run=run
    )
    weights = weights_of(optimum.best)
    run.progress(Progress(stage="comparison"))
    fresh = draw_perturbed(robot, effort.fresh, spread=spread, scenario=scenario, seed=run.seed + 1_000_003)
    controllers = {"robust": controller_of(weights), "nominal": nominal}
    seen = measure_runs(list(controllers.values()), *fresh)
    costs, stood = units.costs(seen), ~seen.fell
    return RobustDesign(
        design=design_gain(robot, state_weights=weights),
        controller=controllers["robust"],
        state_weights=weights,
        torque_weight=NOMINAL_TORQUE_WEIGHT,
        units=units,
        history=optimum.history,
        compared={
            name: ComparedDesign(
                gain=controller.gain,
                worst_tenth=float(worst_tenth(costs[k])),
                mean=float(costs[k].mean()),
                worst_error=float(worst_tenth(seen.error[k, stood[k]])),
                worst_roughness=float(worst_tenth(seen.roughness[k, stood[k]])),
                falls=int(seen.fell[k].sum()),
                costs=costs[k],
            )
            for k, (name, controller) in enumerate(controllers.items())
        },
        fresh=effort.fresh,
        spread=spread,
        scenario=scenario.name,
    )


def weights_of(candidate: Floats) -> tuple[float, ...]:
    """Return the ten state weights of a point (6,) of the unit cube."""
    weights = np.array(NOMINAL_STATE_WEIGHTS)
    for group, coordinate in zip(GROUPS, candidate, strict=True):
        weights[list(group)] *= 10.0 ** (DECADES * (2.0 * float(coordinate) - 1.0))
    return tuple(weights.tolist())
