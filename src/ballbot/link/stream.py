"""Rows of a running robot, shown live by Foxglove, or by PlotJuggler's Foxglove Bridge, which connect to a server here.

The server's channels are `/log`, whose messages are those of the run's MCAP file (`ballbot.log.formats.mcap`), so that
a layout shows a run and its recording alike; `/events` (foxglove.Log); `/tf` (foxglove.FrameTransforms), the frames
`ball`, which does not turn, and `body` in `world`; and `/scene` (foxglove.SceneUpdate), the ball and the outline of the
body, if the robot's file is known.

The robot's loop only appends to a queue. A thread sends what has come in the last `INTERVAL`, and never waits for a
program: one that is absent or slow loses rows.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence
from threading import Event, Thread
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from ballbot.errors import InputError
from ballbot.log.formats.mcap import row_message
from ballbot.robot import Robot

if TYPE_CHECKING:
    from ballbot.link.foxglove_server import FoxgloveServer

#: between two sendings [s]
INTERVAL = 0.02
#: rows and events that wait at most, if the computer is too busy to send them; then the oldest are lost
BACKLOG = 2000
#: for the last rows to be sent when a stream is closed [s]
_PATIENCE = 1.0
#: where programs on this computer look for a server
_FOXGLOVE = "ws://127.0.0.1:8765"
_POSE = ("x", "y", "theta", "phi", "psi")


class StreamAddress(NamedTuple):
    """Where the server listens."""

    host: str
    port: int


def stream_address(text: str) -> StreamAddress:
    """Return the address of a text: foxglove or ws://HOST:PORT; InputError if it is neither."""
    try:
        parts = urlsplit(_FOXGLOVE if text == "foxglove" else text)
        if parts.scheme == "ws" and parts.hostname and parts.port and parts.path in ("", "/"):
            return StreamAddress(parts.hostname, parts.port)
    except ValueError:  # of a port beyond 65535
        pass
    raise InputError(
        f"--stream {text} is no address: give foxglove, or ws://HOST:PORT for a server at an address of this computer; "
        "PlotJuggler connects to it by its Foxglove Bridge."
    )


class LiveStream:
    """Serves rows while the robot runs; a context manager that ends the server.

    InputError if the server cannot be opened.
    """

    def __init__(
        self,
        address: StreamAddress | None,  # nothing is sent without one
        columns: Sequence[str],  # names of a row's numbers, t [s] first
        described: Robot | None,  # its description, if it is known
    ) -> None:
        self._columns, self._pose = columns, [columns.index(name) for name in _POSE]
        self._waiting: deque[Sequence[float] | str] = deque(maxlen=BACKLOG)
        self._server: FoxgloveServer | None = None
        self._start, self._t = 0, math.inf  # of the run, [ns] since 1970; of the last row [s]
        self._end = Event()
        if address is not None:
            from ballbot.link.foxglove_server import FoxgloveServer

            self._server = FoxgloveServer(*address, columns, described)
            self._thread = Thread(target=self._send_waiting, args=(self._server,), name="stream", daemon=True)
            self._thread.start()

    def __enter__(self) -> LiveStream:
        return self

    def __exit__(self, *_: object) -> None:
        """Send what waits, if it can be sent in time, and end the server."""
        if self._server is not None:
            self._end.set()
            self._thread.join(_PATIENCE)
            self._server.close()

    def append(self, item: Sequence[float] | str) -> None:
        """Take a row, in the order of the columns, or an event, in one sentence. Never waits."""
        if self._server is not None:
            self._waiting.append(item)

    def _send_waiting(self, server: FoxgloveServer) -> None:
        """Send what waits, again and again; a row at its own time, as the clock of the first one had it."""
        ended = False
        while not ended:
            ended = self._end.wait(INTERVAL)
            while self._waiting:
                item, now = self._waiting.popleft(), time.time_ns()
                if isinstance(item, str):
                    server.send_event(now, item)
                    continue
                if item[0] < self._t:  # the first of a run
                    self._start = now - round(1e9 * item[0])
                self._t = item[0]
                message, pose = row_message(self._columns, item), [item[index] for index in self._pose]
                server.send_row(self._start + round(1e9 * item[0]), message, pose)
