"""Which controller a study recommends: candidates on the same perturbed plants, and what each part of the best gains.

The true robot is never the identified one. So the friction, and what else was identified, is drawn from the normal
distribution of its estimates, clipped to the physical range:

    p ~ N(p_hat, D C D)        D standard errors, C their correlation; a parameter without an error stays

and the plant has the delay, play, noise, sensors and floor of a scenario: the equations of motion (`SensedPlant`) or
the physics-engine twin, whose floor has only what its own rollers leave of the rolling friction
(`ballbot.workflows.twin_rolling`). Estimator and controller have the robot as identified. Every candidate runs the same
course on every plant with the same seeds.

- A candidate that falls on any plant is excluded.
- Of the others, the one with the smallest median peak error is the best. Those whose 95 % interval of the median
  overlaps the best one's count as equal to it.
- Among these the smoothest is chosen: the one whose torques change least from sample to sample (median of the RMS).

An ablation then removes one part of the precise controller at a time, on the same plants with the same seeds; the
paired ratios of peak errors are the gain of that part by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.overcompensation import certain_friction
from ballbot.control.presets import design_gain, design_integral_gain, precise_controller
from ballbot.errors import InputError, missing_package
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification import Identification
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.result import estimated_robot
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.progress import Progress, on_all_cores, part_of
from ballbot.robot import Robot
from ballbot.simulation.plant import Plant
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin.imperfections import imperfections_of
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin
from ballbot.workflows.comparison import (
    ComparedRun,
    MedianEstimate,
    Paired,
    RunResult,
    median_with_interval,
    run_comparison,
)
from ballbot.workflows.courses import PlantName, ReferenceSpec
from ballbot.workflows.metrics import Performance, Score, performance_of
from ballbot.workflows.twin_rolling import TwinRolling


def available_plant(name: PlantName | None) -> PlantName:
    """Return the plant of that name; without a name the twin if its engine is installed, else the model.

    Raises
    ------
    InputError
        If there is no such plant, or the twin's engine is not installed.
    """
    installed = find_spec("mujoco") is not None
    if name is None:
        return "twin" if installed else "model"
    if name not in get_args(PlantName):
        raise InputError(f"The plant is {name!r}; it must be 'model' or 'twin'.")
    if name == "twin" and not installed:
        raise missing_package("The twin", "MuJoCo", extra="twin")
    return name


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantDraw:
    """One robot to try controllers on."""

    robot: Robot  #: the true one
    known: Robot  #: as identified; what the estimator knows
    scenario: Scenario  #: with the true robot's friction; of the twin, without what its rollers add
    plant: PlantName
    seed: int  #: of noise, start and all else that is random in a run

    def make(self, estimator: EstimatorName) -> Plant:
        """Return the plant, its measured state by that estimator."""
        if self.plant == "model":
            imperfections = imperfections_of(self.scenario)
            return SensedPlant(Model(self.robot), imperfections, known=self.known, estimator=estimator)
        state = named_estimator(estimator, self.known, sample_time=self.scenario.sensors.sample_time)
        return Twin(self.robot, self.scenario, estimator=state)


def draw_plants(
    found: Identification,
    *,
    plant: PlantName,
    scenario: Scenario,
    count: int,
    seed: int,
    rolling: TwinRolling | None = None,
) -> tuple[PlantDraw, ...]:
    """Draw plants from what an identification leaves uncertain.

    Parameters
    ----------
    found : Identification
    plant : {"model", "twin"}
    scenario : Scenario
        Its imperfections; its friction is replaced by the one drawn.
    count : int
        Number of plants, 2 or more for an interval.
    seed : int
        Random seed; draw k has the seed `seed` + k. The same seed gives the same draws.
    rolling : TwinRolling, optional
        Of the twin: what its rollers add to C_rr, which each draw's floor then lacks.

    Raises
    ------
    InputError
        If `count` is below 1.
    """
    if count < 1:
        raise InputError(f"The number of draws is {count}; it must be 1 or more, such as 20.")
    random = np.random.default_rng([seed, 14])
    draws = []
    for k, values in enumerate(_parameters(found, count, random)):
        robot = _with_parameters(found, values)
        draws.append(
            PlantDraw(
                robot=robot,
                known=found.robot,
                scenario=replace(
                    scenario, friction=rolling.on_twin(robot.friction) if rolling else robot.friction
                ),
                plant=plant,
                seed=seed + k,
            )
        )
    return tuple(draws)


def _parameters(
    found: Identification, count: int, random: np.random.Generator
) -> Sequence[NDArray[np.float64]]:
    """Return parameter vectors (p,) drawn about the identified robot's, each within its quantity's bounds."""
    mean = found.layout.nominal(found.robot)
    if found.robot.friction.coulomb_asymmetry:  # estimated as a torque offset against it
        offsets = np.array(
            [name == "torque_offset" for name in found.layout.names for _ in _numbers_of(found, name)]
        )
        mean[offsets] = np.negative(found.robot.friction.coulomb_asymmetry)
    bounds = np.concatenate([BY_NAME[name].default_bounds(found.robot) for name in found.layout.names])
    drawn = random.multivariate_normal(mean, found.assumed_covariance, size=count, method="eigh")
    # a value identified beyond the default bounds, by bounds of the user's own, stays where it is
    lower, upper = np.minimum(bounds[:, 0], mean), np.maximum(bounds[:, 1], mean)
    return list(np.clip(drawn, lower, upper))


def _numbers_of(found: Identification, name: str) -> tuple[str, ...]:
    return BY_NAME[name].labels(found.layout.wheel_count)


def _with_parameters(found: Identification, values: NDArray[np.float64]) -> Robot:
    asymmetric = bool(found.robot.friction.coulomb_asymmetry)
    return estimated_robot(found.robot, found.layout, values, asymmetric=asymmetric)


#: the first is what the others are compared with
CANDIDATES = ("none", "full", "partial", "precise")
#: of the precise controller, by what is removed
ABLATIONS = (
    "estimator",
    "reference shaping",
    "feed-forward",
    "integral action",
    "disturbance observer",
    "friction compensation",
)


@dataclass(frozen=True, kw_only=True)
class NamedCourse:
    """A reference and how long it is followed."""

    name: str  #: of `ballbot.control.references`
    duration: float  #: [s]

    @property
    def reference_spec(self) -> ReferenceSpec:
        """The specification of the reference."""
        return ReferenceSpec(name=self.name)


#: the square of 0.5 m, once around
SQUARE = NamedCourse(name="square", duration=32.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A controller on every plant drawn, in the order of the draws."""

    controller: Controller
    scores: tuple[Score, ...]  #: by the true position
    performances: tuple[Performance, ...]  #: as the robot's own log shows them

    @property
    def falls(self) -> int:
        """Number of runs that ended early."""
        return sum(score.ended is not None for score in self.scores)

    @property
    def peaks(self) -> NDArray[np.float64]:
        """Peak position errors (draws,) [m]; NaN of a run that ended early."""
        return np.array([one.peak_position_error if one.ended is None else np.nan for one in self.scores])

    @property
    def peak(self) -> MedianEstimate:
        """Median peak error of the runs that did not end early, with its 95 % interval [m]."""
        return median_with_interval(self.peaks)

    @property
    def rms(self) -> MedianEstimate:
        """Median RMS error of the runs that did not end early, with its 95 % interval [m]."""
        return median_with_interval(
            [one.rms_position_error if one.ended is None else np.nan for one in self.scores]
        )

    @property
    def roughness(self) -> MedianEstimate:
        """Median RMS change of the torques from sample to sample, with its 95 % interval [N m]."""
        return median_with_interval([one.rms_torque_change for one in self.scores])

    def ratio_to(self, other: Trial) -> MedianEstimate:
        """Return the median of this trial's peak error over the other's, draw by draw, with its 95 % interval."""
        return Paired(self.peaks, other.peaks).median_ratio


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerChoice:
    """What the candidates did, and which was chosen."""

    plants: tuple[PlantDraw, ...]
    course: NamedCourse
    trials: Mapping[str, Trial]  #: by candidate
    equals: tuple[str, ...]  #: candidates that count as the best, the best one first; none if all fall
    chosen: str | None  #: None if every candidate falls on some plant
    ablation: Mapping[str, Trial]  #: of the precise controller, by what is removed, on the first plants
    runs: Mapping[str, Log]  #: by candidate, on the first plant

    @property
    def controller(self) -> Controller | None:
        """The chosen controller."""
        return None if self.chosen is None else self.trials[self.chosen].controller

    @property
    def gain(self) -> MedianEstimate | None:
        """By how much the chosen controller's peak error is smaller than that without compensation; None if none is."""
        if self.chosen is None:
            return None
        return self.trials["none"].ratio_to(self.trials[self.chosen])

    def share_of(self, part: str) -> MedianEstimate:
        """Return the peak error without a part over that of the whole precise controller, plant by plant."""
        without, whole = self.ablation[part], self.trials["precise"]
        return Paired(without.peaks, whole.peaks[: len(without.peaks)]).median_ratio


def candidates(found: Identification, *, sample_time: float) -> dict[str, Controller]:
    """Return the candidates by name, each with the on-board state that it is made for.

    All compensate the friction that is present with 95 % confidence (`ballbot.control.overcompensation`): more would
    inject energy where the robot has less friction than was identified.

    Parameters
    ----------
    found : Identification
    sample_time : float
        Of the controllers [s].
    """
    robot = compensated_robot(found)
    gain = design_gain(robot, sample_time=sample_time).gain
    nominal = Controller(robot, gain, sample_time=sample_time)
    return {
        "none": nominal,
        "full": nominal.with_compensation("full"),
        "partial": nominal.with_compensation("partial"),
        "precise": precise_controller(robot, design=design_integral_gain(robot, sample_time=sample_time)),
    }


def compensated_robot(found: Identification) -> Robot:
    """Return the identified robot with no more friction than is certain."""
    return found.robot.replace(friction=certain_friction(found.robot))


def without_part(precise: Controller, part: str) -> Controller:
    """Return the precise controller without one of `ABLATIONS`; without shaping it has no feed-forward either.

    Raises
    ------
    InputError
        If there is no such part.
    """
    parts = precise.parts
    removed = {
        "estimator": lambda: precise.with_estimator("onboard"),
        "reference shaping": lambda: precise.with_parts(replace(parts, shaping=None, feed_forward=None)),
        "feed-forward": lambda: precise.with_parts(replace(parts, feed_forward=None)),
        "integral action": lambda: precise.with_parts(replace(parts, integral=None)),
        "disturbance observer": lambda: precise.with_parts(replace(parts, disturbance_observer=None)),
        "friction compensation": lambda: precise.with_compensation("none"),
    }
    if part not in removed:
        raise InputError(f"The precise controller has no part {part!r}; there are {', '.join(ABLATIONS)}.")
    return removed[part]()


def choose_controller(
    controllers: Mapping[str, Controller],
    plants: Sequence[PlantDraw],
    *,
    course: NamedCourse = SQUARE,
    ablation_plants: int = 6,
    processes: int | None = None,
    run: Run = DEFAULT_RUN,
) -> ControllerChoice:
    """Run every candidate on every plant, choose one, and remove the parts of the precise one by turns.

    Parameters
    ----------
    controllers : mapping of str to Controller
        As `candidates` returns them.
    plants : sequence of PlantDraw
    course : NamedCourse
    ablation_plants : int
        Number of plants, the first ones, of the ablation; 0 leaves it out.
    processes : int, optional
        One for each core by default. The result does not depend on it.
    run : Run, optional
        Its checkpoint keeps each run's result; its seed is not used.

    Raises
    ------
    InputError
        If a plant cannot be made or a run cannot be scored.
    """
    parts = {part: without_part(controllers["precise"], part) for part in ABLATIONS if ablation_plants}
    runs = [
        _run(name, controller, plant, course) for plant in plants for name, controller in controllers.items()
    ]
    runs += [
        _run(part, controller, plant, course)
        for plant in plants[:ablation_plants]
        for part, controller in parts.items()
    ]
    compared = on_all_cores(len(runs)) / (on_all_cores(len(runs)) + len(controllers))
    comparing, logging = part_of(run.progress, 0.0, compared), part_of(run.progress, compared, 1.0)
    found = run_comparison(runs, processes=processes, run=replace(run, progress=comparing))
    logs: dict[str, Log] = {}
    for name, one in controllers.items():
        logs[name] = _run(name, one, plants[0], course).log()
        logging(Progress(stage="simulating the first plant", done=len(logs), total=len(controllers)))
    made = {name: _trial(one, found.of(name)) for name, one in {**controllers, **parts}.items()}
    named = {name: made[name] for name in controllers}
    equals = equal_best(named)
    return ControllerChoice(
        plants=tuple(plants),
        course=course,
        trials=named,
        equals=equals,
        chosen=min(equals, key=lambda name: named[name].roughness.median, default=None),
        ablation={part: made[part] for part in parts},
        runs=logs,
    )


def equal_best(trials: Mapping[str, Trial]) -> tuple[str, ...]:
    """Return the candidates that never fall and whose error's interval overlaps the best one's, the best one first."""
    standing = sorted(
        (name for name, trial in trials.items() if trial.falls == 0),
        key=lambda name: trials[name].peak.median,
    )
    return tuple(name for name in standing if trials[name].peak.overlaps(trials[standing[0]].peak))


def _run(name: str, controller: Controller, plant: PlantDraw, course: NamedCourse) -> ComparedRun:
    return ComparedRun(
        candidate=name,
        controller=controller,
        plant=plant.make,
        reference=course.reference_spec.reference,
        duration=course.duration,
        seed=plant.seed,
        measure=partial(_performance, controller),
    )


def _performance(controller: Controller, log: Log) -> NDArray[np.float64]:
    return performance_of(log, controller).to_array()


def _trial(controller: Controller, results: Sequence[RunResult]) -> Trial:
    return Trial(
        controller=controller,
        scores=tuple(one.score for one in results),
        performances=tuple(Performance.from_array(one.measured) for one in results),
    )
