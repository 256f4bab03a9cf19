"""A grid of runs: controllers x courses x plants x seeds, each run's log reduced to an answer, one table out.

A study, the league, `excite` and the campaigns use it. Runs of Ballbot's controllers on a `LoopRobot` go through the
compiled loop, many side by side. All others, on the twin or with a controller or plant written in Python, are computed
one period at a time by workers: processes or threads. The answer of a run depends on its controller,
plant, course and seed only, not on where or in which order it is computed.

Robust design and limits need thousands of short runs and no logs; they call the loop itself: `simulate_batch`.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, TypeVar

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback, estimator_of
from ballbot.control.references import Reference
from ballbot.errors import InputError, about
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.fitting.run import ALL_CORES, DEFAULT_RUN, Executor, Run, Threads
from ballbot.log import Log
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.model import Model
from ballbot.progress import Progress
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import initial_state_of, simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin.imperfections import changes_of, imperfections_of, true_model
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin
from ballbot.workflows.metrics import DEFAULT_RULES, Rules, Score, score


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopRobot:
    """A robot as the compiled loop runs it."""

    model: Model  #: the true one
    imperfections: Imperfections

    @staticmethod
    def of(robot: Robot, scenario: Scenario, *, known: Robot) -> LoopRobot:
        """Return a robot on the loop with its own friction and the rest of a scenario.

        Parameters
        ----------
        robot : Robot
            The true one.
        scenario : Scenario
            Its friction is not used.
        known : Robot
            The one that the estimator knows.

        Returns
        -------
        LoopRobot

        Examples
        --------
        >>> from ballbot import Robot
        >>> robot = Robot.load("alten")
        >>> LoopRobot.of(robot, Scenario.nominal(robot), known=robot).model.robot.name
        'alten'
        """
        true = replace(scenario, friction=robot.friction)
        return LoopRobot(
            model=true_model(robot, true),
            imperfections=replace(imperfections_of(scenario, known=known), later=changes_of(robot, true)),
        )

    def __call__(self, estimator: EstimatorName) -> Plant:
        """Return the same plant for runs one period at a time."""
        return SensedPlant(self.model, self.imperfections, estimator=estimator)


@dataclass(frozen=True, kw_only=True, eq=False)
class TwinRobot:
    """A robot as the physics engine runs it, one period at a time."""

    robot: Robot  #: the true one, except for its friction
    scenario: Scenario  #: with the true friction
    known: Robot  #: known to the estimator

    def __call__(self, estimator: EstimatorName) -> Twin:
        """Return the twin with that estimator."""
        state = named_estimator(estimator, self.known, sample_time=self.scenario.sensors.sample_time)
        return Twin(self.robot, self.scenario, estimator=state)


@dataclass(frozen=True, kw_only=True, eq=False)
class Condition:
    """The conditions of a run, the same for every controller of a grid: a plant, a course and a seed."""

    #: the robot on the loop or on the twin, or a function that makes another plant with that estimator
    plant: LoopRobot | TwinRobot | Callable[[EstimatorName], Plant | Model]
    reference: Callable[[], Reference]  #: makes the reference; the same for all conditions of a course
    duration: float  #: [s]
    seed: int  #: of the initial state and of all that is random in the plant
    course: str = ""  #: its name, if there is more than one
    rules: Rules = DEFAULT_RULES  #: what counts
    #: true state (10,) at the start; by default at rest at the origin, leaning by up to 0.02 rad
    start: Floats | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class GridRun:
    """One run of a grid; it is pickled if there is more than one process."""

    candidate: Hashable  #: the controller's name
    controller: Feedback  #: the run gets a copy
    condition: Condition

    def log(self) -> Log:
        """Run it one period at a time; InputError if its plant, reference or controller fails."""
        condition = self.condition
        return simulate(
            condition.plant(estimator_of(self.controller)),
            copy.deepcopy(self.controller),
            condition.reference(),
            duration=condition.duration,
            initial_state=condition.start,
            seed=condition.seed,
        )

    def score(self, log: Log) -> Score:
        """Score the run by its log; raise InputError if it is too short."""
        course = self.condition.course
        with about(course and f"Course {course!r}"):
            return score(log, self.condition.rules)


Name = TypeVar("Name", bound=Hashable)
Answer = TypeVar("Answer")


def grid_runs(controllers: Mapping[Name, Feedback], conditions: Sequence[Condition]) -> list[GridRun]:
    """Return a run of every controller under every condition, controller by controller.

    Parameters
    ----------
    controllers : mapping of name to Feedback
    conditions : sequence of Condition

    Returns
    -------
    list of GridRun

    Examples
    --------
    Of two controllers, three seeds each:

    >>> from ballbot import Robot
    >>> from ballbot.control.presets import nominal_controller, precise_controller
    >>> from ballbot.control.references import hold
    >>> robot = Robot.load("alten")
    >>> plant = LoopRobot.of(robot, Scenario.nominal(robot), known=robot)
    >>> conditions = [Condition(plant=plant, reference=hold, duration=2.0, seed=seed) for seed in range(3)]
    >>> len(grid_runs({"soft": nominal_controller(robot), "stiff": precise_controller(robot)}, conditions))
    6
    """
    return [
        GridRun(candidate=name, controller=controller, condition=condition)
        for name, controller in controllers.items()
        for condition in conditions
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class GridTable(Generic[Answer]):
    """Runs with their answers."""

    runs: tuple[GridRun, ...]
    answers: tuple[Answer, ...]  #: in the order of the runs

    def of(self, candidate: Hashable, course: str | None = None) -> tuple[Answer, ...]:
        """Return the answers of a controller, on one course if it is named, in the order of the runs."""
        return tuple(
            answer
            for run, answer in zip(self.runs, self.answers, strict=True)
            if run.candidate == candidate and course in (None, run.condition.course)
        )


def run_grid(
    runs: Sequence[GridRun],
    ask: Callable[[GridRun, Log], Answer] = GridRun.score,
    *,
    workers: Executor = ALL_CORES,
    run: Run = DEFAULT_RUN,
) -> GridTable[Answer]:
    """Compute all runs and reduce each to its answer.

    Parameters
    ----------
    runs : sequence of GridRun
        See `grid_runs`. Runs of one course, by its name and duration, follow one reference.
    ask : callable, optional
        Returns the answer of a run and its log; the score by default. Pickled if there is more than one process.
    workers : Executor, optional
        Computes the runs that are not on the compiled loop, which takes as many threads. The answers do not depend on
        it.
    run : Run, optional
        Progress.

    Returns
    -------
    GridTable
        The answers in the order of the runs; `of` returns those of one controller.

    Raises
    ------
    InputError
        If there is nothing to run, a plant or controller fails, or a run cannot be scored.
    ExecutorError
        If a process was killed.

    Examples
    --------
    >>> from ballbot import Robot
    >>> from ballbot.control.presets import precise_controller
    >>> from ballbot.control.references import hold
    >>> robot = Robot.load("alten")
    >>> plant = LoopRobot.of(robot, Scenario.nominal(robot), known=robot)
    >>> conditions = [Condition(plant=plant, reference=hold, duration=8.0, seed=seed) for seed in range(3)]
    >>> table = run_grid(grid_runs({"stiff": precise_controller(robot)}, conditions))
    >>> [score.ended for score in table.of("stiff")]
    [None, None, None]
    """
    if not runs:
        raise InputError("There is nothing to compare: controllers, courses and seeds are needed.")
    together = _loop_blocks(runs)
    alone = [[index] for index in sorted({*range(len(runs))}.difference(*together))]
    answers_by_index: dict[int, Answer] = {}
    for makers, on_loop, blocks in ((Threads(count=workers.count), True, together), (workers, False, alone)):
        pieces = [[runs[index] for index in block] for block in blocks]
        with closing(makers.each(partial(_asked, ask, on_loop), pieces)) as results:
            for piece, answers in results:
                answers_by_index.update(zip(blocks[piece], answers, strict=True))
                run.progress(
                    Progress(stage="comparing controllers", done=len(answers_by_index), total=len(runs))
                )
    return GridTable(runs=tuple(runs), answers=tuple(answers_by_index[index] for index in range(len(runs))))


def _loop_blocks(runs: Sequence[GridRun]) -> list[list[int]]:
    """Return the indices of the runs for the compiled loop, in blocks as wide as its lanes."""
    alike: dict[tuple[object, ...], list[int]] = {}
    for index, grid_run in enumerate(runs):
        condition, plant = grid_run.condition, grid_run.condition.plant
        if not (isinstance(plant, LoopRobot) and isinstance(grid_run.controller, Controller)):
            continue
        model, imperfections, period = plant.model, plant.imperfections, grid_run.controller.sample_time
        sampled = imperfections.sensors.sample_time if imperfections.sensors else period
        if imperfections.fix is None and abs(sampled - period) <= 1e-9 * sampled:
            key = (condition.course, condition.duration, period, grid_run.controller.estimator)
            key += (model.formulation, model.step, model.pivots, imperfections.backlash > 0.0)
            alike.setdefault(key, []).append(index)
    return [indices[k : k + LANES] for indices in alike.values() for k in range(0, len(indices), LANES)]


def _logs_of_block(runs: Sequence[GridRun]) -> list[Log]:
    """Compute runs of one course on the loop."""
    conditions = [grid_run.condition for grid_run in runs]
    plants = [condition.plant for condition in conditions if isinstance(condition.plant, LoopRobot)]
    batch = simulate_batch(
        [plant.model for plant in plants],
        [grid_run.controller for grid_run in runs],
        conditions[0].reference(),
        duration=conditions[0].duration,
        initial_states=[
            initial_state_of(condition.seed) if condition.start is None else condition.start
            for condition in conditions
        ],
        imperfections=[
            replace(plant.imperfections, seed=condition.seed)
            for plant, condition in zip(plants, conditions, strict=True)
        ],
        threads=1,
    )
    return [batch.log(lane) for lane in range(len(runs))]


def _asked(ask: Callable[[GridRun, Log], Answer], on_loop: bool, runs: Sequence[GridRun]) -> list[Answer]:
    logs = _logs_of_block(runs) if on_loop else [grid_run.log() for grid_run in runs]
    return [ask(grid_run, log) for grid_run, log in zip(runs, logs, strict=True)]
