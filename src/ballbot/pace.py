"""How long work will still take, from the shares of it that are done and when."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from statistics import median
from time import monotonic

#: the pace is the median of so many last steps, so that a hiccup does not count
_STEPS = 9
#: and of those no shorter than this share of the longest: others were read from a checkpoint
_SHORTEST = 0.1


class Pace:
    """Watches a share grow from 0 to 1.

    Parameters
    ----------
    clock : callable
        Gives the time [s]; another one is for tests.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._share, self._time = 0.0, clock()
        self._steps: deque[float] = deque(maxlen=_STEPS)  # seconds for the whole, by each of the last steps

    def seconds_left(self, share: float) -> float | None:
        """Note that a share is done now, and return how long the rest takes [s]; None where that is not known yet."""
        now = self._clock()
        if share > self._share:
            self._steps.append((now - self._time) / (share - self._share))
            self._share, self._time = share, now
        if not self._steps:
            return None
        whole = median(step for step in self._steps if step >= _SHORTEST * max(self._steps))
        # what has gone by since the last step is gone from the rest
        return max(0.0, whole * (1.0 - self._share) - (now - self._time))


def as_clock(seconds: float) -> str:
    """Return seconds as minutes:seconds, with hours before them where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
