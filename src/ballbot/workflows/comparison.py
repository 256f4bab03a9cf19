"""Comparing controllers on one plant and one reference; the league has many of both.

The statistics of a few seeds are here: means, medians, paired differences and fractions with their 95 % intervals;
and the processes that compute runs ahead, so that a checkpoint gets their results in order.
"""

from __future__ import annotations

import copy
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import product
from types import TracebackType
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ballbot.control.interface import Feedback
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.fitting.run import ExecutorError
from ballbot.mechanics.model import Model
from ballbot.processes import uninterrupted, worker_pool
from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate
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
    peaks from some ten seeds on. Where all are equal the interval has no width.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)]
    count = len(known)
    mean = float(known.mean()) if count else np.nan
    if count < 2:
        return Estimate(mean=mean, low=np.nan, high=np.nan, runs=count)
    half = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1) * known.std(ddof=1) / np.sqrt(count))
    return Estimate(mean=mean, low=mean - half, high=mean + half, runs=count)


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
    skipped = max(int(stats.binom.ppf(0.5 - 0.5 * CONFIDENCE, count, 0.5)) - 1, 0)
    return MedianEstimate(
        median=float(np.median(known)),
        low=float(known[skipped]),
        high=float(known[count - 1 - skipped]),
        runs=count,
    )


def paired_difference(values: Sequence[float], others: Sequence[float]) -> Estimate:
    """Return the mean of values - others, seed by seed, with Student's interval.

    Both have the same seeds in the same order. What a seed does to both, it does not do to their difference: the
    interval is narrower than that of two means. A seed at which either is NaN does not count.
    """
    return mean_with_interval(np.subtract(values, others, dtype=np.float64))


def fraction_with_interval(count: int, runs: int) -> tuple[float, float]:
    """Return the interval of a probability of which `count` of `runs` came true (Clopper and Pearson's, exact).

    None of 100 leaves it below 3.7 %, none of 200 below 1.9 %.
    """
    found = stats.binomtest(count, runs).proportion_ci(CONFIDENCE, method="exact")
    return float(found.low), float(found.high)


Job = TypeVar("Job")
Result = TypeVar("Result")


class OrderedResults(Generic[Job, Result]):
    """Results of jobs, in order: from the first that is asked for, the rest are computed in other processes.

    A job whose result is on file is not asked for, and not computed. Use it in a `with` block.

    Parameters
    ----------
    work : callable
        Returns a job's result; it and the jobs are pickled if there is more than one process.
    jobs : sequence
    processes : int, optional
        One for each core by default; with one, all is computed in this process.
    """

    def __init__(
        self, work: Callable[[Job], Result], jobs: Sequence[Job], *, processes: int | None = None
    ) -> None:
        self._work, self._jobs, self._processes = work, jobs, processes or os.cpu_count() or 1
        self._pool: ProcessPoolExecutor | None = None
        self._ahead: dict[int, Future[Result]] = {}

    def __enter__(self) -> OrderedResults[Job, Result]:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool:
            self._pool.shutdown(wait=kind is None, cancel_futures=True)

    def result(self, place: int) -> Result:
        """Return the result of the job at that place; those before it are not computed any more.

        Raises
        ------
        SpreadError
            If a process was killed.
        """
        workers = min(self._processes, len(self._jobs) - place)
        if workers < 2 and not self._pool:
            return self._work(self._jobs[place])
        if not self._pool:
            self._pool = worker_pool(workers)
            with uninterrupted():
                for later in range(place, len(self._jobs)):
                    self._ahead[later] = self._pool.submit(self._work, self._jobs[later])
        try:
            return self._ahead.pop(place).result()
        except BrokenProcessPool:
            raise ExecutorError(
                "A worker process was killed, perhaps because memory ran out. Finished runs are kept; "
                "continue with --resume."
            ) from None


#: largest lean of a start [rad]
_MAX_INITIAL_LEAN = 0.02


@dataclass(frozen=True, kw_only=True)
class Summary:
    """A controller's scores over all seeds: means over the runs that did not end early, NaN where all did."""

    peak_position_error: float  #: [m]
    worst_position_error: float  #: the largest peak of any run that did not end early [m]
    rms_position_error: float  #: [m]
    rms_torque: float  #: [N m]
    rms_torque_change: float  #: [N m]
    falls: int  #: runs that ended early
    runs: int


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What `compare` returns."""

    seeds: tuple[int, ...]
    scores: Mapping[str, tuple[Score, ...]]  #: by controller, in the order of the seeds

    def summary(self, name: str) -> Summary:
        """Return one controller's scores over all seeds."""
        scores = self.scores[name]
        stood = [score for score in scores if score.ended is None]
        return Summary(
            peak_position_error=_mean([score.peak_position_error for score in stood]),
            worst_position_error=max((score.peak_position_error for score in stood), default=np.nan),
            rms_position_error=_mean([score.rms_position_error for score in stood]),
            rms_torque=_mean([score.rms_torque for score in stood]),
            rms_torque_change=_mean([score.rms_torque_change for score in stood]),
            falls=len(scores) - len(stood),
            runs=len(scores),
        )


def compare(
    plant_factory: Callable[[], Plant | Model],
    controllers: Mapping[str, Feedback],
    reference: Reference,
    *,
    duration: float,
    seeds: Sequence[int],
    settle: float = SETTLE,
    threads: int = 1,
    progress: ProgressCallback = ignore_progress,
) -> Comparison:
    """Run every controller with every seed and score the runs.

    A seed gives all that is random in the plant, and a start at rest at the origin with a lean of up to 0.02 rad,
    so that a plant without noise is tried more than once, too.

    Parameters
    ----------
    plant_factory : callable
        Makes a plant; each thread makes one of its own.
    controllers : mapping of str to Feedback
        By name; every run gets a copy.
    reference : callable
        f(t) -> (10,)
    duration : float
        Of a run [s].
    seeds : sequence of int
    settle : float
        See `ballbot.workflows.metrics.settled` [s].
    threads : int
        Runs at a time. Plants whose work is compiled gain from it.
    progress : callable, optional
        Called with the share that is done, from 0 to 1.

    Raises
    ------
    InputError
        Where there is nothing to run, or a run cannot be scored.
    """
    if not controllers or not seeds:
        raise InputError("There is nothing to compare: at least one controller and one seed are needed.")
    own = threading.local()
    runs = list(product(controllers, seeds))

    def run(job: tuple[str, int]) -> Score:
        name, seed = job
        if not hasattr(own, "plant"):
            own.plant = plant_factory()
        log = simulate(
            own.plant,
            copy.deepcopy(controllers[name]),
            reference,
            duration=duration,
            initial_state=initial_state_of(seed),
            seed=seed,
        )
        return score(log, settle=settle)

    scores: dict[str, list[Score]] = {name: [] for name in controllers}
    with ThreadPoolExecutor(threads) as pool:
        for done, ((name, _), result) in enumerate(zip(runs, pool.map(run, runs), strict=True), start=1):
            scores[name].append(result)
            progress(Progress(stage="comparing controllers", done=done, total=len(runs)))
    return Comparison(seeds=tuple(seeds), scores={name: tuple(found) for name, found in scores.items()})


def initial_state_of(seed: int) -> NDArray[np.float64]:
    """Return a start (10,) at rest at the origin: theta and phi ~ U(-0.02, 0.02) rad."""
    state = np.zeros(10)
    state[2:4] = np.random.default_rng(seed).uniform(-_MAX_INITIAL_LEAN, _MAX_INITIAL_LEAN, 2)
    return state


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
