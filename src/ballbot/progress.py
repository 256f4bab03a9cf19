"""Progress of long work: one message, one shape of callback, and an estimate of the time left."""

from __future__ import annotations

import math
import os
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from time import monotonic, process_time

from ballbot.printable import printable_line


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far work has come."""

    stage: str  #: what is being done, such as "evolution"
    done: float  #: steps of the stage that are done
    total: float  #: steps that the stage takes at most
    cost: float = math.nan  #: the best cost so far, where the work minimises one
    share: float = math.nan  #: fraction of the whole work, 0 to 1; that of the stage if it is not given
    #: how much the share grew since the last report without work, as a stage ended early; negative if a stage took
    #: more steps than usual
    skipped: float = 0.0
    planned: float = math.nan  #: time that the whole work usually takes [s]; NaN if that is not known
    seconds_left: float | None = None  #: by the work's own estimate; None if that is not known yet
    note: str = ""  #: a few words to show beside it
    #: steps still to be expected of this stage and of later ones, by name, if the work knows more than its plan
    expected: Mapping[str, float] = field(default_factory=dict[str, float])

    def __post_init__(self) -> None:
        if math.isnan(self.share):
            object.__setattr__(self, "share", self.done / self.total if self.total else 0.0)


ProgressCallback = Callable[[Progress], None]


def ignore_progress(progress: Progress) -> None:
    """Do nothing: the callback of work that nobody watches."""


def part_of(
    callback: ProgressCallback, first: float, last: float, *, stage: str = "", planned: float = math.nan
) -> ProgressCallback:
    """Return a callback for a part of the work, which maps the part's share onto `first` to `last` of the whole.

    Parameters
    ----------
    callback : callable
        Takes the progress of the whole work.
    first, last : float
        Shares of the whole work at which the part begins and ends.
    stage : str, optional
        Replaces the stage of what the part reports.
    planned : float, optional
        Time that the whole work usually takes [s]; by default what the part's own takes, in proportion.
    """
    part = last - first

    def report(progress: Progress) -> None:
        callback(
            replace(
                progress,
                stage=stage or progress.stage,
                share=first + part * progress.share,
                skipped=part * progress.skipped,
                planned=progress.planned / part if math.isnan(planned) and part > 0.0 else planned,
                seconds_left=None,
            )
        )

    return report


def in_parts(callback: ProgressCallback, seconds: Sequence[float]) -> tuple[ProgressCallback, ...]:
    """Return a callback for each part of the work, which follow one another and usually take so many seconds each."""
    ends = [sum(seconds[:count]) for count in range(len(seconds) + 1)]
    whole = ends[-1]
    return tuple(
        part_of(callback, first / whole, last / whole, planned=whole) for first, last in pairwise(ends)
    )


@dataclass(frozen=True, kw_only=True)
class TimedStage:
    """A stage of work that reports when it begins."""

    seconds: float  #: time that it usually takes
    follows: str = ""  #: an earlier stage; the more time that takes, the more takes this one
    typical: bool = True  #: whether its time says something about other stages; not if code is compiled in it


#: the time of stages that were measured is compared with the usual one together with so much of the whole plan
_SHARE_OF_PLAN = 0.05
#: a stage that takes longer than expected takes at least this share of its time so far once more
_STAGE_LEFT = 1 / 3


def by_stage_times(
    callback: ProgressCallback, stages: Mapping[str, TimedStage], *, clock: Callable[[], float] = monotonic
) -> ProgressCallback:
    """Return a callback that replaces the share by that of the usual times, and gives the time left by measured ones.

    For work whose own shares count its stages, however long each of them takes. A stage to come takes its usual time,
    in proportion to what the stage that it follows took, or to what all stages so far took.

    Parameters
    ----------
    callback : callable
    stages : mapping of str to TimedStage
        In their order, by name; stages of which only the first word is here are one, done by their steps. During a
        stage that is not here, the one before goes on. A report of share 1 stays.
    clock : callable, optional
        Gives the time [s]; another one is for tests.
    """
    names, taken = list(stages), dict.fromkeys(stages, 0.0)
    whole = sum(one.seconds for one in stages.values())
    current, step, last, share = names[0], 0.0, clock(), 0.0

    def expected(name: str) -> float:
        """Return how long a stage takes [s] by those before the present one."""
        before = names[: names.index(current)]
        own = stages[name]
        alike = [one for one in before if taken[one] > 0.0 and own.follows in (one, stages[one].follows)]
        if own.follows and alike:
            usual = sum(stages[one].seconds for one in alike)
            return own.seconds * sum(taken[one] for one in alike) / usual
        prior = _SHARE_OF_PLAN * whole
        measured = [one for one in before if taken[one] > 0.0 and stages[one].typical]
        usual = sum(stages[one].seconds for one in measured)
        return own.seconds * (prior + sum(taken[one] for one in measured)) / (prior + usual)

    def report(progress: Progress) -> None:
        nonlocal current, step, last, share
        now = clock()
        taken[current] += now - last
        last, name, done = now, progress.stage, 0.0
        if name not in stages and progress.total:
            name, done = name.partition(" ")[0], progress.done / progress.total
        if name in stages and names.index(name) >= names.index(current):
            current, step = name, done
        own = taken[current] / step if step > 0.0 else expected(current)
        left = max(own - taken[current], _STAGE_LEFT * taken[current])
        left += sum(expected(one) for one in names[names.index(current) + 1 :])
        done = (
            sum(stages[one].seconds for one in names[: names.index(current)]) + step * stages[current].seconds
        )
        share, left = (1.0, 0.0) if progress.share >= 1.0 else (max(share, done / whole), left)
        callback(replace(progress, share=share, planned=whole, seconds_left=left))

    return report


def on_all_cores(seconds: float) -> float:
    """Return how long work takes that all cores share, from its processor time [s]."""
    return seconds / (os.cpu_count() or 1)


#: work is not expected to take more than so many times its usual time for what else the machine does
_SLOWEST = 4.0
#: over which the system averages what is ready to run [s], and when this process began
_AVERAGED, _BEGUN = 60.0, monotonic()


def slowdown_now() -> float:
    """Return how many times its usual time work takes that shares the cores with what ran in the last minute.

    With as many threads as there are cores, and as many of others that are ready to run, it takes twice its time. The
    threads of this process do not count: a later stage would take its own earlier ones for others. 1 if the system does
    not count them.
    """
    try:
        ready = os.getloadavg()[0]
    except (AttributeError, OSError):  # Windows
        return 1.0
    own = process_time() / max(monotonic() - _BEGUN, _AVERAGED)
    return min(1.0 + max(ready - own, 0.0) / (os.cpu_count() or 1), _SLOWEST)


#: a stage that ends by itself is expected to take at least this share of the steps so far once more
_ALWAYS_LEFT = 1 / 3


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of the work that a `ProgressReporter` watches."""

    name: str
    steps: int  #: at most
    work: float  #: usual time of a step [s]; the ratios between stages are what counts
    #: steps until it ends by itself, as a search that converges; None: it takes all steps
    usual: float | None = None

    @property
    def seconds(self) -> float:
        """The time that the stage usually takes."""
        return self.steps_left(0) * self.work

    def steps_left(self, done: float) -> float:
        """Return how many more steps are to be expected after so many."""
        if self.usual is None:
            return max(self.steps - done, 0.0)
        return steps_left(done, usual=self.usual, most=self.steps)


def steps_left(done: float, *, usual: float, most: float) -> float:
    """Return how many more steps are to be expected, after so many, of work that ends by itself or after the most."""
    expected = max(usual - done, _ALWAYS_LEFT * done)
    return min(expected, most - done) if done <= most else expected


class ProgressReporter:
    """Turns the progress of single stages into that of the whole work, whose share never falls.

    The share is one less that of the work still to be expected. A stage that ends before its usual number of steps
    counts as done when the next one begins, and that part as skipped. If a stage begins again at its first step, all
    its steps count. What a report expects of a later stage takes the place of the stage's usual number.

    Parameters
    ----------
    callback : callable
        Takes the progress of the whole work after each step.
    stages : sequence of Stage
        In their order; every `Progress` that is reported names one of them.
    """

    def __init__(self, callback: ProgressCallback, stages: Sequence[Stage]) -> None:
        self._callback, self._eta = callback, EtaEstimator(slowdown=slowdown_now())
        self._stages = {stage.name: stage for stage in stages}
        self._to_come = {stage.name: stage.seconds for stage in stages}  # [s], of stages that have not begun
        self._whole, self._last = sum(self._to_come.values()), stages[-1]
        self._share, self._stage = 0.0, ""
        # of the stage: the step that was reported last, and steps done
        self._reported, self._steps = 0.0, 0.0

    def __call__(self, progress: Progress) -> None:
        """Report a step of a stage."""
        stage = self._stages[progress.stage]
        if self._stage != stage.name:
            self._stage, self._reported, self._steps = stage.name, 0.0, 0.0
        begins_again = progress.done <= self._reported
        steps = progress.done - (0.0 if begins_again else self._reported)
        self._reported, self._steps = progress.done, self._steps + steps
        for name in self._stages.keys() & progress.expected:
            self._to_come[name] = progress.expected[name] * self._stages[name].work
        if stage.name not in progress.expected:
            self._to_come[stage.name] = stage.steps_left(self._steps) * stage.work
        names = list(self._stages)
        left = sum(self._to_come[name] for name in names[names.index(stage.name) :])
        share = max(self._share, 1.0 - left / self._whole)
        skipped = share - self._share - steps * stage.work / self._whole
        self._share = share
        now = replace(progress, total=stage.steps, share=share, skipped=skipped, planned=self._whole)
        self._callback(replace(now, seconds_left=self._eta.seconds_left(now)))

    def end(self) -> None:
        """Report that the work is done, whatever its stages left out."""
        skipped, self._share = 1.0 - self._share, 1.0
        steps = self._last.steps
        self._callback(
            Progress(
                stage=self._last.name,
                done=steps,
                total=steps,
                share=1.0,
                skipped=skipped,
                planned=self._whole,
            )
        )


#: no pace is taken from less time than this [s]: parallel work ends in bursts
_SHORTEST = 1.0
#: the plan counts as much as this much of it [s] that has been timed
_PRIOR = 0.3
#: the first step of a stage counts as at most so many times as long as the pace before it gives
_SLOWEST_FIRST_STEP = 2.0


class EtaEstimator:
    """Estimates the time left from shares that grow from 0 to 1.

    It is right within a factor of two from a tenth of the run on if the shares are, stage by stage, those of the time.
    The estimate is what was planned, if anything was, times the slowdown, and after a second the average over the
    later half of the time since the first step. The first step itself does not count, because it compiles, and of the
    first step of a later stage no more than twice what the pace gives. Steps read from a checkpoint or of another
    stage are forgotten as time goes by, and steps that end together, on many threads, count as one.

    Parameters
    ----------
    clock : callable
        Gives the time [s]; another one is for tests.
    slowdown : float, optional
        How many times what was planned the work takes for what else the machine does; see `slowdown_now`.
    """

    def __init__(self, clock: Callable[[], float] = monotonic, *, slowdown: float = 1.0) -> None:
        self._clock, self._slowdown = clock, slowdown
        self._skipped, self._share = 0.0, 0.0
        self._times: list[float] = []  # [s], when work was done
        self._worked: list[float] = []  # which share of the whole until then
        self._not_counted, self._stage = 0.0, ""  # [s] of the first steps of stages, and the last stage
        self._answered = 0.0  # [s], when
        self._answer: float | None = None  # [s], the last estimate

    def seconds_left_now(self) -> float | None:
        """Return how long the rest takes [s] by the last estimate and the time since; None if that is not known."""
        if self._answer is None:
            return None
        return steps_left(self._clock() - self._answered, usual=self._answer, most=math.inf)

    def seconds_left(self, progress: Progress) -> float | None:
        """Note what is done now, and return how long the rest takes [s]; None if that is not known yet."""
        now = self._clock() - self._not_counted
        self._skipped += progress.skipped
        self._share = max(self._share, progress.share)
        worked = self._share - self._skipped
        begun, self._stage = progress.stage != self._stage, progress.stage
        if worked > (self._worked[-1] if self._worked else 0.0):
            if begun and self._times:
                longest = self._longest_first_step(worked - self._worked[-1], progress.planned)
                excess = max(now - self._times[-1] - longest, 0.0)
                self._not_counted += excess
                now -= excess
            self._times.append(now)
            self._worked.append(worked)
        pace = self._pace(now, progress.planned)
        self._answered = self._clock()
        self._answer = None if pace is None else pace * (1.0 - self._share)
        if progress.seconds_left is not None:  # the work knows better
            self._answer = progress.seconds_left
        return self._answer

    def _longest_first_step(self, work: float, planned: float) -> float:
        """Return how long a stage's first step is counted at most [s]."""
        pace = self._pace(self._times[-1], planned)
        return math.inf if pace is None else _SLOWEST_FIRST_STEP * pace * work

    def _pace(self, now: float, planned: float) -> float | None:
        """Return the time of the whole work at the present pace [s]; None if that is not known."""
        is_planned = planned > 0.0
        planned *= self._slowdown
        if not self._times or now - self._times[0] < _SHORTEST or (len(self._times) < 2 and not is_planned):
            return planned if is_planned else None
        middle = 0.5 * (self._times[0] + now)
        since, before = (
            (middle, self._worked_at(middle))
            if middle < self._times[-1]
            else (self._times[0], self._worked[0])
        )
        timed, worked = now - since, self._worked[-1] - before
        return (_PRIOR + timed) / (_PRIOR / planned + worked) if is_planned else timed / worked

    def _worked_at(self, time: float) -> float:
        """Return the work until a time between the first and the last step, as if it grew evenly between steps."""
        after = bisect_left(self._times, time)
        earlier, later = self._times[after - 1], self._times[after]
        part = (time - earlier) / (later - earlier)
        return self._worked[after - 1] + part * (self._worked[after] - self._worked[after - 1])


def time_left(progress: Progress, pace: EtaEstimator) -> str:
    """Return the time left in words, by the pace so far; empty if it is not known or nothing is left."""
    seconds = pace.seconds_left(progress)
    return "" if seconds is None or progress.share >= 1.0 else _left_in_words(seconds)


def time_left_now(pace: EtaEstimator) -> str:
    """Return the time left in words between two reports of progress; empty if it is not known."""
    seconds = pace.seconds_left_now()
    return "" if seconds is None else _left_in_words(seconds)


def _left_in_words(seconds: float) -> str:
    return f"about {as_clock(seconds)} left"


def stage_words(progress: Progress) -> str:
    """Return what is being done, in words."""
    return _METHODS.get(progress.stage, printable_line(progress.stage).replace("_", " "))


#: stages that are methods with a name
_METHODS = {"gauss_newton": "Gauss-Newton"}


def progress_line(progress: Progress, left: str, *, doing: str = "") -> str:
    """Return how far work has come as a line; `doing` stands for a stage without a name."""
    parts = (stage_words(progress) or doing, f"{100.0 * progress.share:.0f} %", progress.note, left)
    return ", ".join(filter(None, parts))


def as_clock(seconds: float) -> str:
    """Return seconds as minutes:seconds, with hours before them where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
