"""A transport that loses, repeats, reorders, corrupts and delays frames, both ways, by a seed."""

from dataclasses import dataclass

import numpy as np

from ballbot.link.transport import Transport


@dataclass(frozen=True, kw_only=True)
class Faults:
    """Chances of each fault for a frame."""

    lost: float = 0.0
    repeated: float = 0.0
    reordered: float = 0.0  #: it comes after the next one
    corrupted: float = 0.0  #: one to four of its bytes change
    late: float = 0.0  #: it comes up to 40 writes or reads later


class FaultyTransport:
    """Faults on the way to the robot and back."""

    def __init__(self, inner: Transport, faults: Faults, *, seed: int) -> None:
        self.inner = inner
        self.dead = False  #: nothing passes any more, as after a pulled plug
        self._to_robot = _Way(faults, np.random.default_rng((seed, 0)))
        self._to_host = _Way(faults, np.random.default_rng((seed, 1)))
        self._part = b""

    def read(self, timeout: float) -> bytes:
        """Return what comes through from the robot."""
        arriving = self._to_robot.due()
        if arriving and not self.dead:
            self.inner.write(arriving)
        *whole, self._part = (self._part + self.inner.read(timeout)).split(b"\0")
        for coded in whole:
            self._to_host.take(coded + b"\0")
        found = self._to_host.due()
        return b"" if self.dead else found

    def write(self, data: bytes) -> None:
        """Send a frame on its way."""
        self._to_robot.take(data)

    def close(self) -> None:
        """Close what is inside."""
        self.inner.close()


class _Way:
    """Frames on their way in one direction."""

    def __init__(self, faults: Faults, random: np.random.Generator) -> None:
        self.faults, self.random = faults, random
        self._waiting: list[tuple[float, bytes]] = []
        self._now = 0

    def take(self, frame: bytes) -> None:
        chances = self.faults
        lost, repeated, reordered, corrupted, late = self.random.uniform(size=5)
        if lost < chances.lost:
            return
        if corrupted < chances.corrupted:
            changed = bytearray(frame)
            for place in self.random.integers(0, len(frame), self.random.integers(1, 5)):
                changed[place] = self.random.integers(0, 256)
            frame = bytes(changed)
        when = self._now + (1.5 if reordered < chances.reordered else 0.0)
        when += float(self.random.integers(1, 40)) if late < chances.late else 0.0
        self._waiting.append((when, frame))
        if repeated < chances.repeated:
            self._waiting.append((when + float(self.random.integers(0, 10)), frame))

    def due(self) -> bytes:
        """Return the frames that arrive now."""
        self._now += 1
        arriving = sorted((one for one in self._waiting if one[0] < self._now), key=lambda one: one[0])
        self._waiting = [one for one in self._waiting if one[0] >= self._now]
        return b"".join(frame for _, frame in arriving)
