"""The process of a live simulation, and what goes between it and the view.

    simulation -- frames, in shared memory --> view      the newest 64 stay; a view that is late skips the others
    simulation -- status, in a pipe ---------> view      when a setting changed or a robot fell
    view -- requests, in the same pipe ------> simulation

The simulation never waits for the view: a frame is written over an old one, and the view has at most `_MOST_OPEN`
requests open, so that neither they nor the answers to them can fill the pipe. Nothing but numbers, names of settings
and sentences crosses it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from ballbot.errors import InputError
from ballbot.processes import begin_as_worker, uninterrupted
from ballbot.schema import validate_table
from ballbot.viewer.live import Entry, LivePush, Settings, World, frame_size
from ballbot.viewer.motion import INTERVAL

#: frames that are kept: 1.28 s of them
_SLOTS = 64
#: requests that the simulation has not taken yet
_MOST_OPEN = 64
#: real time [s] by which the simulation may be late before it gives up catching up
_LATEST = 0.2

Phase = Literal["compiling", "running", "failed", "ended"]


@dataclass(frozen=True, kw_only=True)
class Request:
    """What a page may ask for: other settings, a push, a reset."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    change: dict[str, float | str | bool] | None = None
    push: LivePush | None = None
    reset: bool = False


def read_request(text: str) -> Request:
    """Return the request in a page's message.

    Raises
    ------
    InputError
        If it is no JSON, or asks for anything else or for a value out of its range.
    """
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("The request is not valid JSON.") from None
    request = validate_table(Request, tree, of="a request to a live view")
    if request.change is not None:
        Settings().changed(dict(request.change))
    return request


@dataclass(frozen=True, kw_only=True)
class Status:
    """How the simulation is: what changes seldom."""

    phase: Phase
    message: str = ""
    settings: Settings | None = None
    ended: tuple[str | None, ...] = ()  #: why each robot's run ended

    def text(self) -> str:
        """Return the status as a page reads it."""
        return json.dumps(asdict(self), allow_nan=False)


class Frames:
    """The newest frames, in memory that two processes share; one writes and any may read."""

    def __init__(self, size: int) -> None:
        context = get_context("spawn")
        self._size = size
        self._values = context.RawArray("f", _SLOTS * size)
        self._numbers = context.RawArray("Q", _SLOTS)  # of the frame in each slot; zero while it is written
        self._newest = context.RawValue("Q", 0)
        self._taken = context.RawValue("Q", 0)

    @property
    def newest(self) -> int:
        """Number of the newest frame; zero before the first one."""
        return self._newest.value

    @property
    def taken(self) -> int:
        """Number of requests that the writer has taken."""
        return self._taken.value

    def count_request(self) -> None:
        """Count a request as taken."""
        self._taken.value += 1

    def write(self, values: Sequence[float]) -> None:
        """Write a frame over the oldest one."""
        number = self._newest.value + 1
        slot = number % _SLOTS
        self._numbers[slot] = 0
        self._rows()[slot] = values
        self._numbers[slot] = number
        self._newest.value = number

    def after(self, number: int) -> tuple[bytes, int]:
        """Return the frames after one as little-endian floats of 32 bits, row by row, and the newest one's number."""
        newest = self._newest.value
        rows = self._rows()
        found = []
        for one in range(max(number, newest - _SLOTS // 2) + 1, newest + 1):
            slot = one % _SLOTS
            row = rows[slot].astype("<f4").tobytes()
            if self._numbers[slot] == one:  # else it was written over meanwhile
                found.append(row)
        return b"".join(found), newest

    def _rows(self) -> NDArray[np.float32]:
        return np.frombuffer(self._values, dtype=np.float32).reshape(_SLOTS, self._size)


class LiveProcess:
    """A simulation in a process of its own, as the view has it. Use it in a `with` statement."""

    def __init__(self, entries: Sequence[Entry]) -> None:
        self._frames = Frames(frame_size(entries))
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=run_live, args=(tuple(entries), self._frames, theirs), name="live simulation", daemon=True
        )
        with uninterrupted():  # while it imports; see `begin_as_worker`
            self._process.start()
        theirs.close()
        self._sent = 0
        self.status = Status(phase="compiling")

    def __enter__(self) -> LiveProcess:
        return self

    def __exit__(self, *error: object) -> None:
        self._pipe.close()  # the simulation hears it
        self._process.join(1.0)
        self._process.kill()

    def poll(self) -> None:
        """Take the newest status."""
        try:
            while self._pipe.poll():
                self.status = self._pipe.recv()
        except (EOFError, OSError):
            if self.status.phase not in ("failed", "ended"):
                self.status = Status(phase="ended", message="The simulation's process has ended.")

    def frames_after(self, number: int) -> tuple[bytes, int]:
        """Return the frames after one, and the newest one's number."""
        return self._frames.after(number)

    def send(self, request: Request) -> bool:
        """Pass a request on; return whether it was, which it is not while too many are open."""
        if self.status.phase != "running" or self._sent - self._frames.taken >= _MOST_OPEN:
            return False
        try:
            self._pipe.send(request)
        except OSError:
            return False
        self._sent += 1
        return True


def run_live(entries: Sequence[Entry], frames: Frames, pipe: Connection) -> None:
    """Simulate in real time until the pipe closes."""
    begin_as_worker()
    try:
        world = World(entries)
        world.push(LivePush(force=(1.0, 0.0), height=0.1))
        world.tick()  # compiles what every sample needs
        world.frame(1.0)
        world.reset()
    except (InputError, ModuleNotFoundError) as error:
        pipe.send(Status(phase="failed", message=str(error)))
        return
    sent: Status | None = None
    clock, message = _Clock(), ""
    while True:
        try:
            requests = []
            while pipe.poll():
                requests.append(pipe.recv())
                frames.count_request()
            if requests:
                message = " ".join(filter(None, (_apply(world, one) for one in merged(requests))))
            if not world.settings.paused:
                world.tick()
            now = Status(
                phase="running",
                message=message,
                settings=world.settings,
                ended=tuple(one.ended for one in world.robots),
            )
            if now != sent:
                pipe.send(now)
                sent = now
        except (EOFError, OSError):
            return
        frames.write(world.frame(clock.rate))
        clock.wait(INTERVAL)


def merged(requests: Sequence[Request]) -> list[Request]:
    """Return requests with changes that follow one another as one: to change a world may take a while."""
    found: list[Request] = []
    for changes_only, group in groupby(requests, key=lambda one: one == Request(change=one.change)):
        several = list(group)
        if changes_only:
            several = [Request(change={k: v for one in several for k, v in (one.change or {}).items()})]
        found += several
    return found


def _apply(world: World, request: Request) -> str:
    """Do what a request asks for; return why not, or nothing."""
    try:
        if request.reset:
            world.reset()
        if request.change is not None:
            world.change(dict(request.change))
        if request.push is not None:
            world.push(request.push)
    except InputError as error:
        return str(error)
    return ""


class _Clock:
    """Waits for the next interval, and measures what the machine can keep up with."""

    def __init__(self) -> None:
        self._due = self._last = time.monotonic()
        self._stretch = 1.0

    def wait(self, interval: float) -> None:
        """Wait until the next interval [s] of real time begins."""
        self._due += interval
        late = time.monotonic() - self._due
        if late > _LATEST:
            self._due += late
        elif late < 0.0:
            time.sleep(-late)
        now = time.monotonic()
        passed, self._last = now - self._last, now
        self._stretch += min(1.0, interval) * (passed / interval - self._stretch)

    @property
    def rate(self) -> float:
        """The real time that the intervals of the last second or so should have taken, over that which they took."""
        return 1.0 / max(self._stretch, 1e-6)
