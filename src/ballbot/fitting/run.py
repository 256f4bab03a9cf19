"""The context of a computation: its random seed, its executor and its progress callback.

The problem alone decides how work is cut into pieces, and results are joined in the order of the pieces. A result is
therefore the same to the bit with any executor and any number of threads or workers.
"""

import os
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor as Pool
from concurrent.futures import ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, TypeVar

from ballbot.errors import InputError
from ballbot.processes import uninterrupted, worker_pool
from ballbot.progress import ProgressCallback, in_notebook

Shared = TypeVar("Shared")
Piece = TypeVar("Piece")
Result = TypeVar("Result")


class ExecutorError(InputError):
    """A worker is lost; the work itself can go on with other workers."""


@dataclass(frozen=True, kw_only=True)
class Executor:
    """Makes pieces of work in parallel, by workers on this computer that a pool starts."""

    pool_of: ClassVar[Callable[[int], Pool]]  #: starts the pool
    count: int | None = None  #: of workers; None for one a core

    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the index and the result of each piece as they finish; a single worker is this thread.

        `make` is a function of a module or a partial of one. For workers in other processes `make`, the pieces and the
        results must be picklable. ExecutorError if a worker is lost.
        """
        workers = min(self.count or os.cpu_count() or 1, len(pieces))
        if workers < 2:
            yield from enumerate(map(make, pieces))
            return
        pool, finished = self.pool_of(workers), False
        try:
            with uninterrupted():
                indices = {pool.submit(make, piece): index for index, piece in enumerate(pieces)}
            for future in as_completed(indices):
                yield indices[future], future.result()
            finished = True
        except BrokenProcessPool:
            raise ExecutorError("A worker process was killed, perhaps because memory ran out.") from None
        finally:
            pool.shutdown(wait=finished, cancel_futures=True)

    def __call__(
        self, function: Callable[[Shared, Piece], Result], shared: Shared, pieces: Sequence[Piece]
    ) -> list[Result]:
        """Return [function(shared, piece) for piece in pieces]."""
        made = dict(self.each(partial(function, shared), pieces))
        return [made[index] for index in range(len(pieces))]


class Threads(Executor):
    """Threads of this process; compiled code and MuJoCo run in parallel in them."""

    pool_of = ThreadPoolExecutor


class Processes(Executor):
    """Processes on this machine, which take seconds to start."""

    pool_of = staticmethod(worker_pool)


ALL_CORES = Processes()


@dataclass(frozen=True, kw_only=True)
class Run:
    """The context of a long computation; InputError if the seed is not a whole number from 0 to 2**32 - 1."""

    seed: int = 0  #: random seed; the same seed gives the same result
    executor: Executor = field(default_factory=Threads)  #: where the work is done
    #: called after each step; by default it shows a progress line in a notebook
    progress: ProgressCallback = in_notebook

    def __post_init__(self) -> None:
        check_seed(self.seed)


def check_seed(seed: int) -> None:
    """Raise InputError unless 0 <= seed < 2**32, which every generator accepts."""
    if not 0 <= seed < 2**32:
        raise InputError(f"The seed is {seed}; it must be a whole number from 0 to {2**32 - 1}.")


DEFAULT_RUN = Run()
