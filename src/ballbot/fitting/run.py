"""The context of a run: its random seed, where its work is done, and who watches its progress.

How work is cut into pieces is fixed by the problem, and the pieces' results are put together in their order. A result
is therefore the same to the bit wherever, and by however many threads or workers, the pieces were done.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

from ballbot.errors import InputError
from ballbot.progress import ProgressCallback, in_notebook

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


@dataclass(frozen=True, kw_only=True)
class Run:
    """What every long computation is given beside its inputs.

    Raises
    ------
    InputError
        If the seed is not a whole number from 0 to 2**32 - 1.
    """

    seed: int = 0  #: of all random numbers; the same seed gives the same result
    executor: Executor = field(default_factory=lambda: Threads())  #: where the work is done
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
