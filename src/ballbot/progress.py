"""Progress of long work: one message, one shape of callback, and an estimate of the time left."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import monotonic


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far work has come."""

    stage: str  #: what is being done, such as "evolution"
    done: float  #: steps of the stage that are done
    total: float  #: steps that the stage takes at most
    cost: float = math.nan  #: the best cost so far, where the work minimises one
    share: float = math.nan  #: fraction of the whole work, 0 to 1; that of the stage if it is not given
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
        share = first + (last - first) * progress.share
        callback(replace(progress, stage=stage or progress.stage, share=share, seconds_left=None))

    return report


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of the work that a `ProgressReporter` watches."""

    name: str
    steps: int  #: at most
    work: float  #: of a step; in any unit, the same for all stages


class ProgressReporter:
    """Turns the progress of single stages into that of the whole work, whose share never falls.

    Parameters
    ----------
    callback : callable
        Takes the progress of the whole work after each step.
    stages : sequence of Stage
        In their order; every `Progress` that is reported names one of them.
    """

    def __init__(self, callback: ProgressCallback, stages: Sequence[Stage]) -> None:
        self._callback, self._eta, self._share = callback, EtaEstimator(), 0.0
        self._stages: dict[str, tuple[Stage, float]] = {}
        before = 0.0
        for stage in stages:
            self._stages[stage.name] = (stage, before)
            before += stage.steps * stage.work
        self._whole = before

    def __call__(self, progress: Progress) -> None:
        """Report a step of a stage."""
        stage, before = self._stages[progress.stage]
        self._share = max(self._share, (before + progress.done * stage.work) / self._whole)
        left = self._eta.seconds_left(self._share)
        self._callback(replace(progress, total=stage.steps, share=self._share, seconds_left=left))


#: no estimate from less than this [s]: parallel work ends in bursts
_SHORTEST = 1.0


class EtaEstimator:
    """Estimates the time left from a share that grows from 0 to 1.

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
        self._times: list[float] = []  # [s], when the share grew
        self._shares: list[float] = []  # to what

    def seconds_left(self, share: float) -> float | None:
        """Note that a share is done now, and return how long the rest takes [s]; None if that is not known yet."""
        now = self._clock()
        if share > (self._shares[-1] if self._shares else 0.0):
            self._times.append(now)
            self._shares.append(share)
        if len(self._times) < 2 or now - self._times[0] < _SHORTEST:
            return None
        middle = 0.5 * (self._times[0] + now)
        since, done = (
            (middle, self._share_at(middle))
            if middle < self._times[-1]
            else (self._times[0], self._shares[0])
        )
        return (now - since) / (self._shares[-1] - done) * (1.0 - self._shares[-1])

    def _share_at(self, time: float) -> float:
        """Return the share at a time between the first and the last step, as if it grew evenly between steps."""
        after = bisect_left(self._times, time)
        earlier, later = self._times[after - 1], self._times[after]
        part = (time - earlier) / (later - earlier)
        return self._shares[after - 1] + part * (self._shares[after] - self._shares[after - 1])


def as_clock(seconds: float) -> str:
    """Return seconds as minutes:seconds, with hours before them where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
