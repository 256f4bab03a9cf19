"""What every long computation shares: its seed, where its work is done, and how far it has come.

Seeds of random numbers: what is one.

Where pieces of work are done: one after another, over threads, or over a cluster (`ballbot.fitting.cluster`).

How work is cut into pieces is fixed by the problem, and the pieces' results are put together in their order: so a
result is the same to the bit wherever, and by however many, the pieces were done.

How long work will still take, from the shares of it that are done and when.

What a long identification tells while it runs.

Processes beside this one: Ctrl-C ends them at once and without a traceback each, and so does the end of this one.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from os import _exit
from time import monotonic
from typing import Protocol, TypeVar

from ballbot.errors import InputError


def check_seed(seed: int) -> None:
    """Refuse what cannot seed all of the random numbers here.

    Raises
    ------
    InputError
        Where it is none.
    """
    if not 0 <= seed < 2**32:
        raise InputError(f"The seed is {seed}; it must be a whole number from 0 to {2**32 - 1}.")


Shared = TypeVar("Shared")
Piece = TypeVar("Piece")
Result = TypeVar("Result")


class ExecutorError(InputError):
    """Workers are not there, not alike or lost; nothing is wrong with the work, which others may go on with."""


class Executor(Protocol):
    """Does pieces of work."""

    def __call__(
        self, function: Callable[[Shared, Piece], Result], shared: Shared, pieces: Sequence[Piece]
    ) -> list[Result]:
        """Return [function(shared, piece) for piece in pieces].

        Parameters
        ----------
        function : callable
            Of a module, without effects and random numbers.
        shared, pieces
            What all pieces need, and what each does; of types that can be pickled.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Threads:
    """The threads of this process; compiled code runs in them side by side."""

    count: int | None = None  #: all cores where None

    def __call__(
        self, function: Callable[[Shared, Piece], Result], shared: Shared, pieces: Sequence[Piece]
    ) -> list[Result]:
        """Return [function(shared, piece) for piece in pieces]."""
        workers = min(self.count or os.cpu_count() or 1, len(pieces))
        if workers <= 1:
            return [function(shared, piece) for piece in pieces]
        with ThreadPoolExecutor(workers) as pool:
            return list(pool.map(lambda piece: function(shared, piece), pieces))


#: no estimate from less than this [s]: parallel work ends in bursts
_SHORTEST = 1.0


class EtaEstimator:
    """Watches a share grow from 0 to 1.

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


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far an identification has come."""

    stage: str  #: such as "evolution" or "polish"
    step: int  #: steps of the stage that are done
    of: int  #: how many there will be at most
    cost: float  #: the best cost so far; see `ballbot.identification.prediction.Cost`
    share: float  #: of all stages' work, 0 to 1, as if each took its most steps
    seconds_left: float | None  #: at most, at the pace of late; None where that is not known yet


ProgressCallback = Callable[[Progress], None]


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A part of an identification."""

    name: str
    steps: int  #: at most
    work: float  #: of a step; in any unit, the same for all stages


class ProgressReporter:
    """Turns the steps of all stages into one share, which never falls.

    Parameters
    ----------
    report : callable, optional
        Told a `Progress` after each step.
    stages : sequence of Stage
        In their order.
    """

    def __init__(self, report: ProgressCallback | None, stages: Sequence[Stage]) -> None:
        self._report, self._stages = report, tuple(stages)
        self._pace, self._share = EtaEstimator(), 0.0

    def of(self, name: str) -> Callable[[int, float], None]:
        """Return what the stage of that name tells its steps and costs to."""
        place = [stage.name for stage in self._stages].index(name)
        stage = self._stages[place]
        whole = sum(one.steps * one.work for one in self._stages)
        before = sum(one.steps * one.work for one in self._stages[:place])

        def tell(step: int, cost: float) -> None:
            self._share = max(self._share, (before + step * stage.work) / whole)
            left = self._pace.seconds_left(self._share)
            if self._report:
                self._report(
                    Progress(
                        stage=name,
                        step=step,
                        of=stage.steps,
                        cost=cost,
                        share=self._share,
                        seconds_left=left,
                    )
                )

        return tell


_PR_SET_PDEATHSIG = 1  # of <sys/prctl.h>


def worker_pool(workers: int | None) -> ProcessPoolExecutor:
    """Return a pool of processes that end with this one, even if it is killed.

    Submit to it within `uninterrupted`: processes that begin there do not hear Ctrl-C while they import.
    """
    # spawned: a fork of a process with threads may hang
    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=begin_as_worker)


def begin_as_worker() -> None:
    """Let Ctrl-C and the end of its parent end this process at once."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()


def end_with_parent() -> None:
    """Let this process, begun by `multiprocessing`, end when its parent ends, however it does.

    A thread waits for the parent everywhere; on Linux the system sends a signal too, which needs no turn of this
    process's interpreter.
    """
    parent = parent_process()
    if parent is None:
        return
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    sentinel = parent.sentinel

    def watch() -> None:
        wait([sentinel])
        _exit(1)

    threading.Thread(target=watch, name="end with parent", daemon=True).start()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let nobody stop the block with Ctrl-C: for what takes no time and must not be half done."""
    if threading.current_thread() is not threading.main_thread():
        yield  # which signals are heard is for the main thread to say
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
