"""Progress of long work: one message, one shape of callback, and an estimate of the time left."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import monotonic

from ballbot.printable import printable_line


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far work has come."""

    stage: str  #: what is being done, such as "evolution"
    done: float  #: steps of the stage that are done
    total: float  #: steps that the stage takes at most
    cost: float = math.nan  #: the best cost so far, where the work minimises one
    share: float = math.nan  #: fraction of the whole work, 0 to 1; that of the stage if it is not given
    #: how much the share grew since the last report without work, as a stage ended early
    skipped: float = 0.0
    seconds_left: float | None = None  #: at most, at the present pace; None if that is not known yet
    note: str = ""  #: a few words to show beside it

    def __post_init__(self) -> None:
        if math.isnan(self.share):
            object.__setattr__(self, "share", self.done / self.total if self.total else 0.0)


ProgressCallback = Callable[[Progress], None]


def ignore_progress(progress: Progress) -> None:
    """Do nothing: the callback of work that nobody watches."""


def part_of(callback: ProgressCallback, first: float, last: float, *, stage: str = "") -> ProgressCallback:
    """Return a callback for a part of the work, which maps the part's share onto `first` to `last` of the whole.

    Parameters
    ----------
    callback : callable
        Takes the progress of the whole work.
    first, last : float
        Shares of the whole work at which the part begins and ends.
    stage : str, optional
        Replaces the stage of what the part reports.
    """

    def report(progress: Progress) -> None:
        part = last - first
        share, skipped = first + part * progress.share, part * progress.skipped
        callback(
            replace(progress, stage=stage or progress.stage, share=share, skipped=skipped, seconds_left=None)
        )

    return report


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of the work that a `ProgressReporter` watches."""

    name: str
    steps: int  #: at most
    work: float  #: of a step; in any unit, the same for all stages


class ProgressReporter:
    """Turns the progress of single stages into that of the whole work, whose share never falls.

    A stage that ends before its last step counts as done when the next one begins, and that part as skipped.

    Parameters
    ----------
    callback : callable
        Takes the progress of the whole work after each step.
    stages : sequence of Stage
        In their order; every `Progress` that is reported names one of them.
    """

    def __init__(self, callback: ProgressCallback, stages: Sequence[Stage]) -> None:
        self._callback, self._eta = callback, EtaEstimator()
        self._share, self._stage = 0.0, ""
        self._stages: dict[str, tuple[Stage, float]] = {}
        before = 0.0
        for stage in stages:
            self._stages[stage.name] = (stage, before)
            before += stage.steps * stage.work
        self._whole = before

    def __call__(self, progress: Progress) -> None:
        """Report a step of a stage."""
        stage, before = self._stages[progress.stage]
        done = progress.done * stage.work
        share = max(self._share, (before + done) / self._whole)
        grown, self._share = share - self._share, share
        worked = grown if self._stage == stage.name else min(grown, done / self._whole)
        self._stage = stage.name
        skipped = grown - worked
        left = self._eta.seconds_left(share, skipped=skipped)
        self._callback(replace(progress, total=stage.steps, share=share, skipped=skipped, seconds_left=left))

    def end(self) -> None:
        """Report that the work is done, whatever its stages left out."""
        stage = list(self._stages)[-1]
        skipped, self._share = 1.0 - self._share, 1.0
        steps = self._stages[stage][0].steps
        self._callback(Progress(stage=stage, done=steps, total=steps, share=1.0, skipped=skipped))


#: no estimate from less than this [s]: parallel work ends in bursts
_SHORTEST = 1.0


class EtaEstimator:
    """Estimates the time left from a share that grows from 0 to 1.

    It is right within a factor of two from a tenth of the run on if the shares are, stage by stage, those of the time.
    The estimate is the average over the later half of the time since the first step. The first step itself does
    not count, because it compiles; steps read from a checkpoint or of another stage are forgotten as time goes by,
    and steps that end together, on many threads, count as one.

    Parameters
    ----------
    clock : callable
        Gives the time [s]; another one is for tests.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._skipped, self._share = 0.0, 0.0
        self._times: list[float] = []  # [s], when work was done
        self._worked: list[float] = []  # which share of the whole until then

    def seconds_left(self, share: float, *, skipped: float = 0.0) -> float | None:
        """Note that a share is done now, and return how long the rest takes [s]; None if that is not known yet.

        Parameters
        ----------
        share : float
            Of the whole work, 0 to 1.
        skipped : float
            How much the share grew since the last call without work.
        """
        now = self._clock()
        self._skipped += skipped
        self._share = max(self._share, share)
        worked = self._share - self._skipped
        if worked > (self._worked[-1] if self._worked else 0.0):
            self._times.append(now)
            self._worked.append(worked)
        if len(self._times) < 2 or now - self._times[0] < _SHORTEST:
            return None
        middle = 0.5 * (self._times[0] + now)
        since, done = (
            (middle, self._worked_at(middle))
            if middle < self._times[-1]
            else (self._times[0], self._worked[0])
        )
        return (now - since) / (self._worked[-1] - done) * (1.0 - self._share)

    def _worked_at(self, time: float) -> float:
        """Return the work until a time between the first and the last step, as if it grew evenly between steps."""
        after = bisect_left(self._times, time)
        earlier, later = self._times[after - 1], self._times[after]
        part = (time - earlier) / (later - earlier)
        return self._worked[after - 1] + part * (self._worked[after] - self._worked[after - 1])


def time_left(progress: Progress, pace: EtaEstimator) -> str:
    """Return the time left in words, by the pace so far; empty if it is not known or nothing is left."""
    seconds = pace.seconds_left(progress.share, skipped=progress.skipped)
    return "" if seconds is None or progress.share >= 1.0 else f"about {as_clock(seconds)} left"


def stage_words(progress: Progress) -> str:
    """Return what is being done, in words."""
    return printable_line(progress.stage).replace("_", " ")


def progress_line(progress: Progress, left: str, *, doing: str = "") -> str:
    """Return how far work has come as a line; `doing` stands for a stage without a name."""
    parts = (stage_words(progress) or doing, f"{100.0 * progress.share:.0f} %", progress.note, left)
    return ", ".join(filter(None, parts))


def as_clock(seconds: float) -> str:
    """Return seconds as minutes:seconds, with hours before them where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
