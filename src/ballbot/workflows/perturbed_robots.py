"""Perturbed robots: how a robot may differ from its description, and what a controller costs on such robots.

    J = e / e_n + r / r_n,      10 to 20 for a robot that falls, the more the earlier

e is the root mean square distance from the reference over the run's last part, r the root mean square change of torque
from sample to sample; e_n and r_n are the nominal gain's medians over the same robots, whose J is therefore about 2.
All run on the compiled loop, with the sensors, drive and play of a scenario. A set of robots counts by its worst
tenth: the mean of the largest tenth of the J.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import hold
from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.robot.parameters import Value
from ballbot.robot.variations import draw_robots
from ballbot.rounding import percent
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import MAX_DELAY, MAX_SLOPE
from ballbot.twin.scenario import Scenario
from ballbot.workflows.comparison import LoopRobot

#: the ball lies so far from where it is asked to be at the start [m]
INITIAL_OFFSET = 0.3


#: the parameters of a robot file whose standard deviations may take the place of a range, by how their names begin
_STATED = {"mass": "body.mass", "height": "body.center_of_mass", "friction": "friction."}


def known_deviations(robot: Robot, start: str) -> dict[str, Value]:
    """Return the robot's standard deviations of the parameters whose names begin so, without those that are zero."""
    return {
        name: one
        for name, one in robot.standard_deviations.items()
        if name.startswith(start) and np.any(np.asarray(one) > 0.0)
    }


@dataclass(frozen=True, kw_only=True)
class PerturbationRanges:
    """How far robots may be from the one described. Each is uniform, and independent of the others.

    Mass, height or friction without a range follow the standard deviations in the robot's file, and their correlations.

    Raises
    ------
    InputError
        If a range is not possible.
    """

    #: of the body, either way, as a share; its inertia about its centre of mass goes with it
    mass: float | None = 0.2
    height: float | None = 0.2  #: of the centre of mass, either way, as a share
    friction: float | None = 0.2  #: of each wheel's and of the rolling friction, either way, as a share
    delay: int = 2  #: most samples by which torques come late
    tilt: float = 1.0  #: most of the floor, in any direction [degrees]

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if value is None and one.name in _STATED:
                continue
            if value is None or not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"The perturbed {one.name} is {value!r}; it must be zero or more.")
            if one.name in _STATED and value >= 1.0:
                raise InputError(
                    f"The perturbed {one.name} is {value:g}; it is a fraction and must be below 1."
                )
        if not isinstance(self.delay, int):
            raise InputError(f"The delay is {self.delay!r} samples; it must be a whole number.")
        if math.tan(math.radians(self.tilt)) > MAX_SLOPE:
            raise InputError(
                f"The floor's tilt is {self.tilt:g} degrees; it must be at most "
                f"{math.degrees(math.atan(MAX_SLOPE)):.1f}."
            )

    @property
    def stated(self) -> tuple[str, ...]:
        """Which of mass, height and friction follow the standard deviations in the robot's file."""
        return tuple(name for name in _STATED if getattr(self, name) is None)

    @staticmethod
    def parse(text: str, robot: Robot) -> PerturbationRanges:
        """Return the ranges that a text such as mass=0.2,tilt=1 states.

        Of the others, mass, height and friction follow the robot's standard deviations if its file states any of them,
        and else keep their defaults.

        Raises
        ------
        InputError
            If a name or a number is not valid.
        """
        names = [one.name for one in fields(PerturbationRanges)]
        given: dict[str, float | int] = {}
        for part in filter(None, text.split(",")):
            name, _, number = part.partition("=")
            if name not in names:
                raise InputError(
                    f"--perturb has no {name!r}; it has {', '.join(names)}, such as mass=0.2,delay=2."
                )
            try:
                given[name] = int(number) if name == "delay" else float(number)
            except ValueError:
                kind = "a whole number" if name == "delay" else "a number"
                raise InputError(f"--perturb gives {name} as {number!r}; it must be {kind}.") from None
        from_file = {
            name: None
            for name, known in _STATED.items()
            if name not in given and known_deviations(robot, known)
        }
        return replace(PerturbationRanges(), **from_file, **given)


@dataclass(frozen=True, kw_only=True, eq=False)
class PerturbedRobots:
    """Robots with what their loops bear, and where they start."""

    robots: tuple[LoopRobot, ...]
    #: (robots, 10), the ball `INITIAL_OFFSET` away from the origin in any direction, upright at rest
    starts: NDArray[np.float64]


def draw_perturbed(
    robot: Robot, count: int, *, spread: PerturbationRanges, scenario: Scenario, seed: int
) -> PerturbedRobots:
    """Draw robots from the ranges, under a scenario; the same seed gives the same robots and the same noise.

    Raises
    ------
    InputError
        If `count` is below 1, or a robot that is drawn is not possible.
    """
    if count < 1:
        raise InputError(
            f"The number of perturbed robots is {count}; it must be at least 1, and about a thousand for a "
            "meaningful worst tenth."
        )
    random = np.random.default_rng([seed, 71])
    bases = _by_deviations(robot, spread, count, seed)
    shares = [share or 0.0 for share in (spread.mass, spread.height, spread.friction)]
    robots, starts = [], np.zeros((count, 10))
    for lane in range(count):
        # mass, height and each friction: U(1 - share, 1 + share)
        mass, height = 1.0 + random.uniform(-1.0, 1.0, 2) * shares[:2]
        factors = 1.0 + shares[2] * random.uniform(-1.0, 1.0, robot.wheel_count + 1)
        # delay: any whole number of samples; tilt and its direction, and the start's: uniform
        delay = int(random.integers(0, spread.delay + 1))
        slope = math.tan(math.radians(spread.tilt * float(random.uniform(0.0, 1.0))))
        uphill, away = random.uniform(0.0, 2.0 * np.pi, 2)
        true = _scaled(bases[lane], float(mass), float(height), factors.tolist())
        made = LoopRobot.of(true, scenario, known=robot)
        assert made.imperfections is not None
        late = min(made.imperfections.delay + delay, MAX_DELAY)
        slopes = (slope * math.cos(uphill), slope * math.sin(uphill))
        borne = replace(made.imperfections, delay=late, slope=slopes, seed=seed + lane)
        robots.append(replace(made, imperfections=borne))
        starts[lane, :2] = INITIAL_OFFSET * math.cos(away), INITIAL_OFFSET * math.sin(away)
    return PerturbedRobots(robots=tuple(robots), starts=starts)


def _by_deviations(robot: Robot, spread: PerturbationRanges, count: int, seed: int) -> Sequence[Robot]:
    """Return the robots that the ranges scale: drawn from the standard deviations of what has no range."""
    deviations: dict[str, Value] = {}
    for name in spread.stated:
        deviations |= known_deviations(robot, _STATED[name])
    if not deviations:
        return [robot] * count
    drawn = draw_robots(robot.annotated(standard_deviations=deviations), count, seed=seed)
    return [robot.replace(body=one.body, friction=one.friction) for one in drawn]


def _scaled(robot: Robot, mass: float, height: float, friction: list[float]) -> Robot:
    """Return the robot with these factors on its body, and on the friction of each wheel and of the rolling ball."""
    *wheels, rolling = friction
    new = scaled_friction(robot.friction, wheels, rolling_factor=rolling)
    return robot.replace(body=scaled_body(robot.body, mass=mass, height=height), friction=new)


#: a run [s], and its last part, which counts as settled
RUN, SETTLED = 8.0, 2.0
#: the share of the robots that counts
TAIL = 0.1
_FALL = 10.0
_EVERY = 10  # samples between two that are looked at for the error


@dataclass(frozen=True, kw_only=True, eq=False)
class RunMeasures:
    """How controllers did, on each of the robots."""

    #: (controllers, robots), root mean square once settled [m]; NaN of one that fell
    error: NDArray[np.float64]
    roughness: NDArray[np.float64]  #: (controllers, robots), torque's change from sample to sample [N m]
    ended: NDArray[np.float64]  #: (controllers, robots), when it fell [s]; infinity where it stood

    @property
    def fell(self) -> NDArray[np.bool_]:
        """Whether it fell (controllers, robots)."""
        return np.isfinite(self.ended)


@dataclass(frozen=True, kw_only=True)
class CostUnits:
    """What J is counted in."""

    error: float  #: e_n [m]
    roughness: float  #: r_n [N m]

    def costs(self, marks: RunMeasures) -> NDArray[np.float64]:
        """Return J (controllers, robots)."""
        standing = marks.error / self.error + marks.roughness / self.roughness
        return np.where(marks.fell, _FALL * (2.0 - np.minimum(marks.ended / RUN, 1.0)), standing)


def measure_runs(
    controllers: Sequence[Controller], perturbed: PerturbedRobots, *, threads: int | None = None
) -> RunMeasures:
    """Run every controller on every perturbed robot, all in one batch; each robot has the same noise for all.

    Parameters
    ----------
    controllers : sequence of Controller
    perturbed : PerturbedRobots
    threads : int, optional
        All cores by default; the result does not depend on it.
    """
    robots = perturbed.robots * len(controllers)
    batch = simulate_batch(
        [one.model for one in robots],
        [one for one in controllers for _ in perturbed.robots],
        hold(),
        duration=RUN,
        initial_states=np.tile(perturbed.starts, (len(controllers), 1)),
        imperfections=[one.imperfections for one in robots if one.imperfections],
        every=_EVERY,
        threads=threads,
    )
    shape = (len(controllers), len(perturbed.robots))
    late = batch.t > RUN - SETTLED
    error = np.sqrt((batch.states[:, late, :2] ** 2).sum(axis=2).mean(axis=1))
    return RunMeasures(
        error=np.where(batch.survived, error, np.nan).reshape(shape),
        roughness=batch.torque_change.reshape(shape),
        ended=batch.ended.reshape(shape),
    )


def cost_units(nominal: RunMeasures) -> CostUnits:
    """Return what J is counted in, by the nominal gain's marks (1, robots).

    Raises
    ------
    InputError
        If it falls with half of the robots.
    """
    if (share := float(np.mean(nominal.fell))) > 0.5:
        raise InputError(
            f"The nominal gain falls with {percent(share)} of the perturbed robots, so costs "
            "cannot be compared with its cost. Reduce the perturbation."
        )
    stood = ~nominal.fell
    return CostUnits(
        error=float(np.median(nominal.error[stood])), roughness=float(np.median(nominal.roughness[stood]))
    )


def worst_tenth(costs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of the largest tenth of costs (..., robots), of one robot at least."""
    count = max(1, round(TAIL * costs.shape[-1]))
    return np.sort(costs, axis=-1)[..., -count:].mean(axis=-1)
