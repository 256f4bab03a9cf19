"""Processes that tests start: no wait for one is without a limit, and none is left behind when its test ends."""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Self

#: longest wait [s]; a computer that is busy with other tests takes a small part of it
PATIENCE = 240.0
_ROOT = Path(__file__).parents[2]


class Child:
    """This Python in a process of its own, with arguments as on its command line; killed at the end of the block.

    It has no terminal, and Ctrl-C (SIGINT) interrupts it, even if whoever started the tests ignores Ctrl-C.
    """

    def __init__(self, *arguments: str) -> None:
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        paths = os.pathsep.join(map(str, (_ROOT / "src", _ROOT)))  # this toolkit and its tests
        with ctrl_c_is_heard():
            self.process = subprocess.Popen(
                [sys.executable, *arguments],
                env={**os.environ, "PYTHONPATH": paths},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
            )
        self._lines: Queue[bytes] = Queue()
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        """Put lines into the queue as they come, and an empty one at the output's end."""
        assert self.process.stdout is not None
        for line in iter(self.process.stdout.readline, b""):
            self._lines.put(line)
        self._lines.put(b"")

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def errors(self) -> str:
        """Return what it has written to its standard error so far."""
        return os.pread(self._errors.fileno(), 1_000_000, 0).decode()

    def line(self, *, within: float = PATIENCE) -> str:
        """Return the next line of its output; fail if none comes within so many seconds or it ends."""
        line = self._lines.get(timeout=within)
        assert line, f"{self.process.args} ended: {self.errors()}"
        return line.decode().rstrip("\n")

    def lines_left(self, *, within: float = PATIENCE) -> list[str]:
        """Return the whole lines that a process that has ended still left."""
        lines = iter(partial(self._lines.get, timeout=within), b"")
        return [line.decode().rstrip("\n") for line in lines if line.endswith(b"\n")]

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self.process.send_signal(number)

    def end(self, *, within: float = PATIENCE) -> int:
        """Wait until it has ended, and return its exit code."""
        return self.process.wait(within)

    def kill(self) -> None:
        """Kill it at once (SIGKILL), and wait until it has gone."""
        self.process.kill()
        self.process.wait(PATIENCE)

    def __enter__(self) -> Self:
        """Return the process."""
        return self

    def __exit__(self, *_: object) -> None:
        """Kill the process if it still runs, and close its files."""
        self.kill()
        self._reader.join(PATIENCE)
        for pipe in (self.process.stdin, self.process.stdout, self._errors):
            assert pipe is not None
            pipe.close()


@contextmanager
def ctrl_c_is_heard() -> Iterator[None]:
    """Let this process and those it begins hear Ctrl-C: a shell's background job and all below it ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
