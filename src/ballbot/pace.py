"""How long work will still take, from the shares of it that are done and when."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from time import monotonic

#: no estimate from less than this [s]: parallel work ends in bursts
_SHORTEST = 1.0


class Pace:
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
