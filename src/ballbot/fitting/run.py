"""The context of a run: its random seed, where its work is done, and who watches its progress.

How work is cut into pieces is fixed by the problem, and the pieces' results are put together in their order. A result
is therefore the same to the bit wherever, and by however many threads or workers, the pieces were done.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor as Pool
from concurrent.futures import ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

from ballbot.errors import InputError
from ballbot.processes import uninterrupted, worker_pool
from ballbot.progress import ProgressCallback, in_notebook

Shared = TypeVar("Shared")
Piece = TypeVar("Piece")
Result = TypeVar("Result")


class ExecutorError(InputError):
    """Workers are not there, not alike or lost; nothing is wrong with the work, which others may go on with."""


class Executor(ABC):
    """Does pieces of work, several at a time."""

    @abstractmethod
    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the place and the result of each piece, as they are finished.

        `make` is a function of a module or a partial of one; for workers in other processes, it, the pieces and the
        results can be pickled. ExecutorError if a worker is lost.
        """

    def __call__(
        self, function: Callable[[Shared, Piece], Result], shared: Shared, pieces: Sequence[Piece]
    ) -> list[Result]:
        """Return [function(shared, piece) for piece in pieces]."""
        made = dict(self.each(partial(function, shared), pieces))
        return [made[place] for place in range(len(pieces))]


def _each_in(
    pool_of: Callable[[int], Pool],
    count: int | None,
    make: Callable[[Piece], Result],
    pieces: Sequence[Piece],
) -> Generator[tuple[int, Result], None, None]:
    """Yield the place and the result of each piece, done in a pool of this machine; by one worker, here."""
    workers = min(count or os.cpu_count() or 1, len(pieces))
    if workers < 2:
        yield from enumerate(map(make, pieces))
        return
    pool, finished = pool_of(workers), False
    try:
        with uninterrupted():
            places = {pool.submit(make, piece): place for place, piece in enumerate(pieces)}
        for future in as_completed(places):
            yield places[future], future.result()
        finished = True
    except BrokenProcessPool:
        raise ExecutorError("A worker process was killed, perhaps because memory ran out.") from None
    finally:
        pool.shutdown(wait=finished, cancel_futures=True)


@dataclass(frozen=True, kw_only=True)
class Threads(Executor):
    """The threads of this process: compiled code and MuJoCo run in them side by side."""

    count: int | None = None  #: how many work side by side; one for each core where None

    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the place and the result of each piece, as they are finished."""
        return _each_in(ThreadPoolExecutor, self.count, make, pieces)


@dataclass(frozen=True, kw_only=True)
class Processes(Executor):
    """Processes of this machine, which take seconds to begin."""

    count: int | None = None  #: how many work side by side; one for each core where None

    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the place and the result of each piece, as they are finished."""
        return _each_in(worker_pool, self.count, make, pieces)


ALL_CORES = Processes()


@dataclass(frozen=True, kw_only=True)
class Run:
    """What every long computation is given beside its inputs.

    Raises
    ------
    InputError
        If the seed is not a whole number from 0 to 2**32 - 1.
    """

    seed: int = 0  #: of all random numbers; the same seed gives the same result
    executor: Executor = field(default_factory=Threads)  #: where the work is done
    #: is called after each step; by default it shows a line in a notebook
    progress: ProgressCallback = in_notebook

    def __post_init__(self) -> None:
        check_seed(self.seed)


def check_seed(seed: int) -> None:
    """Raise InputError unless `seed` is a whole number from 0 to 2**32 - 1, which seeds every generator here."""
    if not 0 <= seed < 2**32:
        raise InputError(f"The seed is {seed}; it must be a whole number from 0 to {2**32 - 1}.")


#: without a seed of its own
DEFAULT_RUN = Run()
