"""One comparison of controllers: the same courses, plants and seeds for each, run, scored and summarised.

A study, the league and every campaign list their runs as `ComparedRun` and give them to `run_comparison`. The runs of
Ballbot's controllers on a `LoopRobot` go through the compiled loop, many side by side. All others, on the twin or with
a controller or plant written in Python, are made one period at a time, in processes or threads. The result of a run
follows from its controller, plant, course and seed alone, wherever and in whatever order it is computed.

The statistics of a few runs are here too: means, medians and fractions with their 95 % intervals, and `Paired`, two
controllers compared run by run. What a seed does to both, it does not do to their difference or ratio: the interval
is narrower than that of two means.
"""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, betaincinv, stdtrit

from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback, estimator_of
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName
from ballbot.files import read_sealed, write_sealed
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.sweep import Processes
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
from ballbot.twin.imperfections import imperfections_of, true_model
from ballbot.twin.scenario import Scenario
from ballbot.workflows.metrics import SETTLE, Score, score

CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A mean over seeds and the interval that its expectation lies in; NaN where there are too few seeds."""

    mean: float
    low: float
    high: float
    runs: int  #: that it is the mean of

    @property
    def sign(self) -> int:
        """1 or -1 where the whole interval is above or below zero, else 0: nothing is shown."""
        return 1 if self.low > 0.0 else -1 if self.high < 0.0 else 0


@dataclass(frozen=True, kw_only=True)
class MedianEstimate:
    """The median over runs with the 95 % interval of their distribution's median; NaN without a run."""

    median: float
    low: float
    high: float
    runs: int  #: that it is the median of

    def overlaps(self, other: MedianEstimate) -> bool:
        """Return whether the two intervals have a value in common."""
        return self.low <= other.high and other.low <= self.high


def mean_with_interval(values: Sequence[float] | NDArray[np.float64]) -> Estimate:
    """Return the mean of the values that are numbers, with Student's interval.

    m +- t s / sqrt(n), with t of n - 1 degrees of freedom: exact for normal values, and good for the skewed ones of
    peaks from some ten seeds on. If all are equal, the interval has no width.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)]
    count = len(known)
    mean = float(known.mean()) if count else np.nan
    if count < 2:
        return Estimate(mean=mean, low=np.nan, high=np.nan, runs=count)
    half = student_quantile(count) * float(known.std(ddof=1) / np.sqrt(count))
    return Estimate(mean=mean, low=mean - half, high=mean + half, runs=count)


def student_quantile(count: int) -> float:
    """Return how many standard errors the interval of a mean of `count` values reaches to each side."""
    return float(stdtrit(count - 1, 0.5 + 0.5 * CONFIDENCE))


def median_with_interval(values: Sequence[float] | NDArray[np.float64]) -> MedianEstimate:
    """Return the median of the values that are numbers, with the interval between two of them by rank.

    The number of n independent values below their distribution's median is binomial, whatever that distribution is: of
    20 values the 6th and the 15th enclose it with 95.9 %. Below six values the smallest and the largest do, with less
    than 95 % (five: 93.8 %).
    """
    known = np.sort(np.asarray(values, dtype=np.float64))
    known = known[~np.isnan(known)]
    count = len(known)
    if count == 0:
        return MedianEstimate(median=np.nan, low=np.nan, high=np.nan, runs=0)
    skipped = max(int(np.searchsorted(bdtr(np.arange(count + 1), count, 0.5), 0.5 - 0.5 * CONFIDENCE)) - 1, 0)
    return MedianEstimate(
        median=float(np.median(known)),
        low=float(known[skipped]),
        high=float(known[count - 1 - skipped]),
        runs=count,
    )


@dataclass(frozen=True, eq=False)
class Paired:
    """One number of two controllers on the same runs, (runs,) or (courses, runs).

    A run is what both have in common: a seed, or a plant. One with NaN for either does not count.
    """

    values: NDArray[np.float64]
    others: NDArray[np.float64]

    @staticmethod
    def of(
        values: Sequence[ArrayLike] | NDArray[np.float64], others: Sequence[ArrayLike] | NDArray[np.float64]
    ) -> Paired:
        """Return the pairs of two sequences of numbers, or of rows of them."""
        return Paired(np.asarray(values, dtype=np.float64), np.asarray(others, dtype=np.float64))

    @property
    def difference(self) -> Estimate:
        """Mean of values - others, with Student's interval."""
        return mean_with_interval(self.values - self.others)

    @property
    def ratio(self) -> Estimate:
        """Geometric mean of values / others, over courses and runs; the interval is over the runs."""
        logs = np.ma.masked_invalid(np.atleast_2d(np.log(self.values / self.others)))
        found = mean_with_interval(logs.mean(axis=0).filled(np.nan))
        mean, low, high = np.exp([found.mean, found.low, found.high]).tolist()
        return Estimate(mean=mean, low=low, high=high, runs=found.runs)

    @property
    def median_ratio(self) -> MedianEstimate:
        """Median of values / others, with the interval between two of them by rank."""
        return median_with_interval(self.values / self.others)


def fraction_with_interval(count: int, runs: int) -> tuple[float, float]:
    """Return the interval of a probability of which `count` of `runs` came true (Clopper and Pearson's, exact).

    None of 100 leaves it below 3.7 %, none of 200 below 1.9 %.
    """
    beyond = 0.5 - 0.5 * CONFIDENCE
    low = betaincinv(count, runs - count + 1, beyond) if count else 0.0
    high = betaincinv(count + 1, runs - count, 1.0 - beyond) if count < runs else 1.0
    return float(low), float(high)


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopRobot:
    """A robot as the compiled loop runs it."""

    model: Model  #: the true one
    imperfections: Imperfections

    @staticmethod
    def of(robot: Robot, scenario: Scenario, *, known: Robot) -> LoopRobot:
        """Return a robot with its own friction and the rest of a scenario; its estimator knows another one."""
        return LoopRobot(
            model=true_model(robot, replace(scenario, friction=robot.friction)),
            imperfections=imperfections_of(scenario, known=known),
        )

    def __call__(self, estimator: EstimatorName) -> Plant:
        """Return the plant that is the same, one period at a time."""
        return SensedPlant(self.model, self.imperfections, estimator=estimator)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedRun:
    """One run of a comparison; it is pickled if there is more than one process."""

    candidate: str  #: the controller's name
    controller: Feedback  #: the run gets a copy
    #: the robot on the loop, or what makes a plant, its state by that estimator
    plant: LoopRobot | Callable[[EstimatorName], Plant | Model]
    reference: Callable[[], Reference]  #: makes the reference; the same for all runs of a course
    duration: float  #: [s]
    seed: int  #: of the initial state and of all that is random in the plant
    course: str = ""  #: its name, if there is more than one
    settle: float = SETTLE  #: see `ballbot.workflows.metrics.settled` [s]
    disturbed: tuple[float, ...] = ()  #: when something pushes the robot [s]
    measure: Callable[[Log], NDArray[np.float64]] | None = None  #: what else is kept of the run's log
    logged: bool = False  #: whether the log itself is kept

    def log(self) -> Log:
        """Make the run: from rest at the origin, leaning by up to 0.02 rad.

        InputError if the plant or the reference cannot be made, or the controller fails.
        """
        return simulate(
            self.plant(estimator_of(self.controller)),
            copy.deepcopy(self.controller),
            self.reference(),
            duration=self.duration,
            seed=self.seed,
        )

    def result(self) -> RunResult:
        """Make the run and return what is kept of it; InputError as of `log`, or if it cannot be scored."""
        return self.result_of(self.log())

    def result_of(self, log: Log) -> RunResult:
        """Return what is kept of the run's log; InputError if it cannot be scored."""
        try:
            found = score(log, settle=self.settle, disturbed=self.disturbed)
        except InputError as error:
            place = f"Course {self.course!r}: " if self.course else ""
            raise InputError(f"{place}{error}") from None
        return RunResult(
            score=found,
            measured=self.measure(log) if self.measure else np.empty(0),
            log=log if self.logged else None,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResult:
    """What is kept of a run."""

    score: Score
    measured: NDArray[np.float64]  #: by the run's `measure`; empty without one
    log: Log | None = None  #: if it was to be kept


def write_result(path: Path, result: RunResult) -> None:
    """Write the result of a run into a file, whole or not at all; a log is not kept."""
    text = json.dumps({"score": asdict(result.score), "measured": result.measured.tolist()})
    write_sealed(path, text.encode())


def read_result(path: Path) -> RunResult | None:
    """Return the result of a run from its file; None if that is not there or not whole."""
    try:
        kept = json.loads(read_sealed(path))
    except InputError:
        return None
    return RunResult(score=Score(**kept["score"]), measured=np.array(kept["measured"], dtype=np.float64))


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Runs with their results."""

    runs: tuple[ComparedRun, ...]
    results: tuple[RunResult, ...]  #: in the order of the runs

    def of(self, candidate: str, course: str = "") -> tuple[RunResult, ...]:
        """Return the results of a controller on a course, in the order of the runs."""
        return tuple(
            result
            for run, result in zip(self.runs, self.results, strict=True)
            if (run.candidate, run.course) == (candidate, course)
        )

    def scores_of(self, candidate: str, course: str = "") -> tuple[Score, ...]:
        """Return the scores of a controller on a course, in the order of the runs."""
        return tuple(result.score for result in self.of(candidate, course))


def run_comparison(
    runs: Sequence[ComparedRun],
    *,
    processes: int | None = None,
    run: Run = DEFAULT_RUN,
) -> Comparison:
    """Make all runs and score them.

    Parameters
    ----------
    runs : sequence of ComparedRun
        Those of one course, by its name and duration, follow one reference.
    processes : int, optional
        One for each core by default; with one, all is computed in this process. The result does not depend on it.
    run : Run, optional
        Its progress is reported; its seed is not used.

    Raises
    ------
    InputError
        If there is nothing to run, a plant or controller fails, or a run cannot be scored.
    ExecutorError
        If a process was killed.
    """
    if not runs:
        raise InputError("There is nothing to compare: controllers, courses and seeds are needed.")
    blocks = _loop_blocks(runs)
    on_loop = {place for block in blocks for place in block}
    alone = [place for place in range(len(runs)) if place not in on_loop]
    made: dict[int, RunResult] = {}

    def keep(places: Sequence[int], results: Sequence[RunResult]) -> None:
        made.update(zip(places, results, strict=True))
        run.progress(Progress(stage="comparing controllers", done=len(made), total=len(runs)))

    pool = ThreadPoolExecutor(processes or os.cpu_count())
    try:
        batches = pool.map(_run_block, [[runs[place] for place in block] for block in blocks])
        for block, results in zip(blocks, batches, strict=True):
            keep(block, results)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    slow = [runs[place] for place in alone]
    with closing(Processes(count=processes).each(ComparedRun.result, slow)) as made_alone:
        for place, result in made_alone:
            keep([alone[place]], [result])
    return Comparison(runs=tuple(runs), results=tuple(made[place] for place in range(len(runs))))


def _loop_blocks(runs: Sequence[ComparedRun]) -> list[list[int]]:
    """Return the places of the runs that go through the compiled loop, as many together as it steps side by side.

    Those of one controller lie together: what sticks in one lane and slides in the next takes longer.
    """
    # where each comes first
    controllers = {id(one.controller): place for place, one in reversed(list(enumerate(runs)))}
    alike: dict[tuple[object, ...], list[int]] = {}
    for place, one in enumerate(runs):
        if not (isinstance(one.plant, LoopRobot) and isinstance(one.controller, Controller)):
            continue
        model, borne, period = one.plant.model, one.plant.imperfections, one.controller.sample_time
        sampled = borne.sensors.sample_time if borne.sensors else period
        if borne.fix is None and abs(sampled - period) <= 1e-9 * sampled:
            key = (one.course, one.duration, period, one.controller.estimator)
            key += (model.formulation, model.step, model.pivots, borne.backlash > 0.0)
            alike.setdefault(key, []).append(place)
    grouped = [
        sorted(places, key=lambda place: controllers[id(runs[place].controller)]) for places in alike.values()
    ]
    return [places[k : k + LANES] for places in grouped for k in range(0, len(places), LANES)]


def _run_block(runs: Sequence[ComparedRun]) -> list[RunResult]:
    """Make runs of one course on the loop, and score them."""
    robots = [one.plant for one in runs if isinstance(one.plant, LoopRobot)]
    batch = simulate_batch(
        [one.model for one in robots],
        [one.controller for one in runs if isinstance(one.controller, Controller)],
        runs[0].reference(),
        duration=runs[0].duration,
        initial_states=np.array([initial_state_of(one.seed) for one in runs]),
        imperfections=[
            replace(robot.imperfections, seed=one.seed) for robot, one in zip(robots, runs, strict=True)
        ],
        threads=1,
    )
    return [one.result_of(batch.log(lane)) for lane, one in enumerate(runs)]
