"""A measured piece of a log beside what the models made of it: what a figure shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log import Log


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectories:
    """States over time, from the start that all three have in common; in the order and units of a log's states."""

    t: NDArray[np.float64]  #: (k,) [s], of the log
    measured: NDArray[np.float64]  #: (k, 10)
    first: NDArray[np.float64]  #: (k, 10) of the first model
    second: NDArray[np.float64]  #: (k, 10) of the second

    @staticmethod
    def beside(log: Log, start: int, states: NDArray[np.float64]) -> Trajectories:
        """Return the rows of a log from `start` on beside the `states` (2, samples, 10) of both models after it."""
        rows = slice(start, start + states.shape[1] + 1)
        measured = log.states[rows]
        first, second = (np.vstack([measured[:1], run]) for run in states)
        return Trajectories(t=log.t[rows], measured=measured, first=first, second=second)
