"""When the controller's torques act and when sensors are read, where that is not at once and on time."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ballbot.twin.faults import Timing


class Clockwork:
    """Torques that come late, and sampling instants that wander about their grid.

    Instant k is at k T + e_k with e_k ~ U(-jitter, jitter) in whole physics steps and e_0 = 0; the mean rate stays.

    Parameters
    ----------
    timing : Timing
    steps : int
        Physics steps in a sample on the grid.
    timestep : float
        [s]
    wheel_count : int
    random : Generator
    """

    def __init__(
        self, timing: Timing, *, steps: int, timestep: float, wheel_count: int, random: np.random.Generator
    ) -> None:
        self._waiting = deque([np.zeros(wheel_count)] * timing.delay)
        self._largest = int(timing.jitter / timestep * (1 + 1e-9))
        self._steps = steps
        self._late = 0  # steps by which the last instant came after its place
        self._random = random

    def acting(self, torques: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the torques (n,) that act while these were computed."""
        self._waiting.append(torques)
        return self._waiting.popleft()

    def next_steps(self) -> int:
        """Return the physics steps up to the next instant."""
        if not self._largest:
            return self._steps
        late = int(self._random.integers(-self._largest, self._largest, endpoint=True))
        steps = self._steps + late - self._late
        self._late = late
        return steps
