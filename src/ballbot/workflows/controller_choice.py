"""Which controller a study recommends: candidates on the same perturbed robots.

The true robot is never the identified one. So its numbers are drawn from their standard deviations and correlations
(`ballbot.robot.variations`), and the robot has the delay, play, noise, sensors and floor of a scenario, on the compiled
loop. The estimator has the robot as identified, the controller its friction at the lower 95 % bound. Every candidate
runs the same course on every robot with the same seeds. A candidate that falls on any robot is excluded. Of the others,
those whose 95 % interval of the median peak error overlaps the best one's count as equal to it, and among these the one
whose torques change least from sample to sample (median of the RMS) is chosen.

The loop has no slip and, with identified friction, no rollers. So the chosen controller and the soft gain run on the
physics-engine twin too (`confirm`), on the first robots drawn. The twin contradicts the loop if a run falls there that
falls nowhere on the loop, or if there the other of the two is better. Nothing else is taken from it: its rollers, play
and noise cost energy that the identified C_rr already contains, so that errors are too large (the precise controller's
peak by 1.7 in ten logs).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from ballbot.arrays import Floats, whole_number
from ballbot.control.controller import Compensation, Controller
from ballbot.control.overcompensation import certain_friction
from ballbot.control.presets import KINDS, ControllerKind
from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Run, Threads
from ballbot.identification import Identification
from ballbot.log import Log
from ballbot.progress import ignore_progress
from ballbot.robot import Robot
from ballbot.robot.variations import draw_robots
from ballbot.twin.imperfections import with_identified
from ballbot.twin.scenario import Scenario
from ballbot.workflows.courses import ReferenceSpec
from ballbot.workflows.grid import (
    Condition,
    GridRun,
    LoopRobot,
    Name,
    TwinRobot,
    grid_runs,
    run_grid,
)
from ballbot.workflows.metrics import LogScore, Score, falls_of, values_of
from ballbot.workflows.statistics import MedianEstimate, median_with_interval


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantDraw:
    """A robot drawn from the identified uncertainty, to try controllers on."""

    robot: Robot  #: the true one
    known: Robot  #: as identified; what the estimator knows
    scenario: Scenario  #: its friction is not used
    seed: int  #: of everything random in a run, such as noise and start

    @cached_property
    def on_loop(self) -> LoopRobot:
        """The robot on the compiled loop."""
        scenario = with_identified(self.scenario, self.robot.friction)
        return LoopRobot.of(self.robot, scenario, known=self.known)

    @property
    def on_twin(self) -> TwinRobot:
        """The robot on the physics engine."""
        scenario = replace(self.scenario, friction=self.robot.friction)
        return TwinRobot(robot=self.robot, scenario=scenario, known=self.known)


def draw_plants(fit: Identification, *, scenario: Scenario, count: int, seed: int) -> tuple[PlantDraw, ...]:
    """Draw robots from what an identification, and the robot's file, leave uncertain, with a scenario's imperfections.

    Draw k has the seed `seed` + k. InputError if `count` is below 1, or the deviations are too large for a robot.
    """
    whole_number(count, "The number of draws", least=1)
    return tuple(
        PlantDraw(robot=robot, known=fit.robot, scenario=scenario, seed=seed + k)
        for k, robot in enumerate(draw_robots(fit.robot, count, seed=seed))
    )


#: how each candidate is made, of every kind; "none" is what the others are compared with
CANDIDATES: dict[str, tuple[ControllerKind, Compensation]] = {
    name: (kind, compensation) for kind in KINDS.values() for name, compensation in kind.candidates.items()
}


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
    performances: tuple[LogScore, ...] = ()  #: as the robot's own log shows them
    log: Log | None = None  #: of the first run, if it is kept

    @property
    def falls(self) -> int:
        """Number of runs that ended early."""
        return falls_of(self.scores)

    @property
    def peaks(self) -> Floats:
        """Peak position errors (draws,) [m]; NaN of a run that ended early."""
        return values_of(self.scores, "peak_position_error")

    @property
    def peak(self) -> MedianEstimate:
        """Median peak error of the runs that did not end early, with its 95 % interval [m]."""
        return median_with_interval(self.peaks)

    @property
    def rms(self) -> MedianEstimate:
        """Median RMS error of the runs that did not end early, with its 95 % interval [m]."""
        return median_with_interval(values_of(self.scores, "rms_position_error"))

    @property
    def roughness(self) -> MedianEstimate:
        """Median RMS change of the torques from sample to sample, with its 95 % interval [N m]."""
        return median_with_interval([score.rms_torque_change for score in self.scores])

    def ratio_to(self, other: Trial) -> MedianEstimate:
        """Return the median of this trial's peak error over the other's, draw by draw, with its 95 % interval."""
        return median_with_interval(self.peaks / other.peaks)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerChoice:
    """The candidates' trials and the chosen controller."""

    plants: tuple[PlantDraw, ...]
    course: NamedCourse
    trials: Mapping[str, Trial]  #: by candidate
    equals: tuple[str, ...]  #: candidates that count as the best, the best one first; none if all fall
    chosen: str | None  #: None if every candidate falls on some plant

    @property
    def runs(self) -> dict[str, Log]:
        """The candidates' runs on the first plant."""
        return {name: trial.log for name, trial in self.trials.items() if trial.log is not None}

    @property
    def controller(self) -> Controller | None:
        """The chosen controller."""
        return None if self.chosen is None else self.trials[self.chosen].controller

    @property
    def gain(self) -> MedianEstimate | None:
        """How many times smaller the chosen controller's peak error is than the soft gain's; None if none is chosen."""
        if self.chosen is None:
            return None
        return self.trials["none"].ratio_to(self.trials[self.chosen])

    @property
    def compensated(self) -> str | None:
        """The best candidate that compensates friction; None if all of them fall on some plant."""
        named = self.trials.items()
        return smoothest_of_best(
            {name: trial for name, trial in named if trial.controller.compensation != "none"}
        )


def candidates(fit: Identification, *, sample_time: float) -> dict[str, Controller]:
    """Return the candidates, sampled at that time [s]; all compensate the friction that is 95 % certain.

    Kinds that this robot cannot have are left out; InputError if the nominal one is.
    """
    certain, made = certain_friction(fit.robot), dict[str, Controller]()
    for kind in {kind.name: kind for kind, _ in CANDIDATES.values()}.values():
        try:
            made[kind.name] = kind.made(fit.robot, compensated=certain, sample_time=sample_time)
        except InputError:
            if "none" in kind.candidates:
                raise
    return {
        name: made[kind.name].with_compensation(compensation)
        for name, (kind, compensation) in CANDIDATES.items()
        if kind.name in made
    }


def choose_controller(
    controllers: Mapping[str, Controller],
    plants: Sequence[PlantDraw],
    *,
    course: NamedCourse = SQUARE,
    run: Run = DEFAULT_RUN,
) -> ControllerChoice:
    """Run every candidate on every robot and choose one; InputError if a robot cannot be run or a run not be scored."""
    trials = run_trials(controllers, course, plants, logged=True, run=run)
    return ControllerChoice(
        plants=tuple(plants),
        course=course,
        trials=trials,
        equals=equal_best(trials),
        chosen=smoothest_of_best(trials),
    )


def run_trials(
    controllers: Mapping[Name, Controller],
    course: NamedCourse,
    plants: Sequence[PlantDraw],
    *,
    on_twin: bool = False,
    logged: bool = False,
    run: Run = DEFAULT_RUN,
) -> dict[Name, Trial]:
    """Run controllers on a course with every robot, on the loop or the twin; `logged` trials keep their first log."""
    conditions = [
        Condition(
            plant=draw.on_twin if on_twin else draw.on_loop,
            reference=course.reference_spec.reference,
            duration=course.duration,
            seed=draw.seed,
            course=course.name,
        )
        for draw in plants
    ]

    def ask(grid_run: GridRun, log: Log) -> tuple[Score, LogScore, Log | None]:
        assert isinstance(grid_run.controller, Controller)
        kept = log if logged and grid_run.condition is conditions[0] else None
        return grid_run.score(log), LogScore.of(log, torque_limit=grid_run.controller.torque_limit), kept

    table = run_grid(grid_runs(controllers, conditions), ask, workers=Threads(), run=run)
    trials = {}
    for name, controller in controllers.items():
        scores, performances, logs = zip(*table.of(name), strict=True)
        trials[name] = Trial(controller=controller, scores=scores, performances=performances, log=logs[0])
    return trials


def equal_best(trials: Mapping[str, Trial]) -> tuple[str, ...]:
    """Return the candidates that never fall and whose error's interval overlaps the best one's, the best one first."""
    standing = sorted(
        (name for name, trial in trials.items() if trial.falls == 0),
        key=lambda name: trials[name].peak.median,
    )
    return tuple(name for name in standing if trials[name].peak.overlaps(trials[standing[0]].peak))


def smoothest_of_best(trials: Mapping[str, Trial]) -> str | None:
    """Return the smoothest of the candidates that count as the best; None if every one falls on some plant."""
    return min(equal_best(trials), key=lambda name: trials[name].roughness.median, default=None)


#: one side of the square, of which the last two seconds count
CONFIRMED_ON = NamedCourse(name="square", duration=8.0)
#: robots on which the twin runs
CONFIRMED_RUNS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Confirmation:
    """The chosen controller and the soft gain on the twin and on the loop."""

    course: NamedCourse
    on_loop: Mapping[str, Trial]  #: by candidate, on every robot drawn
    on_twin: Mapping[str, Trial]  #: on the first of them

    @property
    def contradiction(self) -> str | None:
        """The sentence on how the twin contradicts the loop; None if it does not."""
        for name, trial in self.on_twin.items():
            if trial.falls and not self.on_loop[name].falls:
                return (
                    f"On the physics-engine twin the candidate {name} fell in {trial.falls} of "
                    f"{len(trial.scores)} runs, and in none on the compiled loop: do not trust this choice."
                )
        names = list(self.on_twin)
        if len(names) == 2:
            soft, chosen = names
            loop, twin = (on[soft].ratio_to(on[chosen]) for on in (self.on_loop, self.on_twin))
            if twin.runs and loop.low > 1.0 > twin.high:
                return (
                    f"On the physics-engine twin the candidate {chosen} was worse than {soft} in every run, and better "
                    "on the compiled loop: do not trust this choice."
                )
        return None


def confirm(choice: ControllerChoice, *, run: Run = DEFAULT_RUN) -> Confirmation | None:
    """Run the chosen controller and the soft gain on the twin; None if every candidate fell."""
    if choice.chosen is None:
        return None
    names = dict.fromkeys(("none", choice.chosen))
    asked = {name: choice.trials[name].controller for name in names}
    return Confirmation(
        course=CONFIRMED_ON,
        on_twin=run_trials(asked, CONFIRMED_ON, choice.plants[:CONFIRMED_RUNS], on_twin=True, run=run),
        on_loop=run_trials(asked, CONFIRMED_ON, choice.plants, run=replace(run, progress=ignore_progress)),
    )
