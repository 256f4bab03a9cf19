"""Rows of a running robot, shown live by other programs.

    foxglove      ws://127.0.0.1:8765     a server, to which Foxglove and PlotJuggler's Foxglove Bridge connect
    plotjuggler   udp://127.0.0.1:9870    datagrams in JSON to PlotJuggler's UDP Server, or to a program of your own

The server's channels are `/log`, whose messages are those of the run's MCAP file (`ballbot.log.formats.mcap`), so that
a layout shows a run and its recording alike; `/events` (foxglove.Log); `/tf` (foxglove.FrameTransforms), the frames
`ball`, which does not turn, and `body` in `world`; and `/scene` (foxglove.SceneUpdate), the ball and the outline of the
body, if the robot's file is known. A datagram is a row or an event:

    {"timestamp": 1795942998.3, "log": {"t": 0.005, "u1": 0.1, ..}}
    {"timestamp": 1795942998.3, "event": "The run of 30 s is over."}

The robot's loop only appends to a queue. A thread sends what has come in the last `INTERVAL`, and never waits for a
program: one that is absent or slow loses rows.
"""

from __future__ import annotations

import json
import math
import socket
import time
from collections import deque
from collections.abc import Iterator, Sequence
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
#: the addresses of programs on this computer, where they listen or connect by default
_PROGRAMS = {"foxglove": "ws://127.0.0.1:8765", "plotjuggler": "udp://127.0.0.1:9870"}
_POSE = ("x", "y", "theta", "phi", "psi")


class StreamAddress(NamedTuple):
    """Where rows are sent."""

    scheme: str  #: ws, a server at this address; or udp, datagrams to this address
    host: str
    port: int


def stream_address(text: str) -> StreamAddress:
    """Return the address of a text: foxglove, plotjuggler, ws://HOST:PORT or udp://HOST:PORT; InputError if none."""
    try:
        parts = urlsplit(_PROGRAMS.get(text, text))
        if parts.scheme in ("ws", "udp") and parts.hostname and parts.port and parts.path in ("", "/"):
            return StreamAddress(parts.scheme, parts.hostname, parts.port)
    except ValueError:  # of a port beyond 65535
        pass
    raise InputError(
        f"--stream {text} is no address: give foxglove, plotjuggler, ws://HOST:PORT for a server at an address of this "
        "computer, or udp://HOST:PORT for datagrams to a program."
    )


class LiveStream:
    """Sends rows to addresses while the robot runs; a context manager that closes them.

    InputError if an address is not known, or cannot be opened on this computer.
    """

    def __init__(
        self,
        addresses: Sequence[StreamAddress],  # nothing is sent without one
        columns: Sequence[str],  # names of a row's numbers, t [s] first
        described: Robot | None,  # its description, if it is known
    ) -> None:
        self._columns, self._pose = columns, [columns.index(name) for name in _POSE]
        self._waiting: deque[Sequence[float] | str] = deque(maxlen=BACKLOG)
        self._sinks: list[_Datagrams | FoxgloveServer] = []
        self._start, self._t = 0, math.inf  # of the run, [ns] since 1970; of the last row [s]
        self._end = Event()
        self._thread = Thread(target=self._send_waiting, name="stream", daemon=True)
        try:
            for address in addresses:
                if address.scheme == "udp":
                    self._sinks.append(_Datagrams(address.host, address.port))
                else:
                    from ballbot.link.foxglove_server import FoxgloveServer

                    self._sinks.append(FoxgloveServer(address.host, address.port, columns, described))
        except BaseException:
            self._close_sinks()
            raise
        if self._sinks:
            self._thread.start()

    def __enter__(self) -> LiveStream:
        return self

    def __exit__(self, *_: object) -> None:
        """Send what waits, if it can be sent in time, and close the addresses."""
        self._end.set()
        if self._sinks:
            self._thread.join(_PATIENCE)
        self._close_sinks()

    def append(self, item: Sequence[float] | str) -> None:
        """Take a row, in the order of the columns, or an event, in one sentence. Never waits."""
        if self._sinks:
            self._waiting.append(item)

    def troubles(self) -> Iterator[str]:
        """Yield why something could not be sent, in a sentence for each address."""
        return (sink.failure for sink in self._sinks if sink.failure)

    def _close_sinks(self) -> None:
        for sink in self._sinks:
            sink.close()

    def _send_waiting(self) -> None:
        """Send what waits, again and again until the end."""
        ended = False
        while not ended:
            ended = self._end.wait(INTERVAL)
            while self._waiting:
                item, now = self._waiting.popleft(), time.time_ns()
                if isinstance(item, str):
                    for sink in self._sinks:
                        sink.send_event(now, item)
                else:
                    self._send_row(now, item)

    def _send_row(self, now: int, row: Sequence[float]) -> None:
        """Send a row at its own time, as the clock of the first one had it."""
        if row[0] < self._t:  # the first of a run
            self._start = now - round(1e9 * row[0])
        self._t = row[0]
        message, pose = row_message(self._columns, row), [row[index] for index in self._pose]
        for sink in self._sinks:
            sink.send_row(self._start + round(1e9 * row[0]), message, pose)


class _Datagrams:
    """Datagrams in JSON, which nobody has to receive; PlotJuggler takes at most 2048 bytes, a row has about 1000."""

    def __init__(self, host: str, port: int) -> None:
        self.failure, self._name = "", f"udp://{host}:{port}"
        try:
            known = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise InputError(f"{self._name} is not known: {error.strerror or error}.") from None
        family, kind, protocol, _, self._target = known[0]
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)

    def send_row(self, time: int, message: bytes, _pose: Sequence[float]) -> None:
        """Send a row, which has the pose."""
        self._send(time, b'"log": ' + message)

    def send_event(self, time: int, text: str) -> None:
        """Send a sentence on what happened."""
        self._send(time, b'"event": ' + json.dumps(text).encode())

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, time: int, content: bytes) -> None:
        try:
            self._socket.sendto(b'{"timestamp": %.6f, %b}' % (1e-9 * time, content), self._target)
        except OSError as error:
            self.failure = f"Rows were lost on their way to {self._name}: {error.strerror or error}."
