"""Where pieces of work are done: one after another, over threads, or over a cluster (`ballbot.identification.cluster`).

How work is cut into pieces is fixed by the problem, and the pieces' results are put together in their order: so a
result is the same to the bit wherever, and by however many, the pieces were done.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol, TypeVar

from ballbot.errors import InputError

Shared = TypeVar("Shared")
Piece = TypeVar("Piece")
Result = TypeVar("Result")


class SpreadError(InputError):
    """Workers are not there, not alike or lost; nothing is wrong with the work, which others may go on with."""


class Spread(Protocol):
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
