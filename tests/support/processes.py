"""Processes that tests start: no wait for one is without a limit, and none is left behind when its test ends."""

import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

#: longest wait [s]; a computer that is busy with other tests takes a small part of it
PATIENCE = 240.0
_ROOT = Path(__file__).parents[2]


class Child:
    """This Python in a process of its own, with arguments as on its command line; killed at the end of the block.

    It has no terminal, and Ctrl-C (SIGINT) interrupts it, even if whoever started the tests ignores Ctrl-C.
    """

    def __init__(self, *arguments: str) -> None:
        self._arguments, self._waiting = arguments, b""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        with _ctrl_c_is_heard():
            self.process = subprocess.Popen(
                [sys.executable, *arguments],
                env={
                    **os.environ,
                    "PYTHONPATH": f"{_ROOT / 'src'}{os.pathsep}{_ROOT}",
                },  # this toolkit and its tests
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                bufsize=0,
            )

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def errors(self) -> str:
        """Return what it has written to its standard error so far."""
        return os.pread(self._errors.fileno(), 1_000_000, 0).decode()

    def line(self, *, within: float = PATIENCE) -> str:
        """Return the next line of its output; fail if none comes within so many seconds or it ends."""
        end = time.monotonic() + within
        while b"\n" not in self._waiting:
            left = end - time.monotonic()
            assert left > 0.0, f"{self._arguments} printed no line within {within:g} s"
            more = self._read(left)
            assert more != b"", f"{self._arguments} ended: {self.errors()}"
            self._waiting += more or b""
        first, _, self._waiting = self._waiting.partition(b"\n")
        return first.decode()

    def lines_left(self, *, within: float = PATIENCE) -> list[str]:
        """Return the whole lines that a process that has ended still left."""
        end = time.monotonic() + within
        while (more := self._read(end - time.monotonic())) != b"":
            assert time.monotonic() < end, f"the output of {self._arguments} has no end"
            self._waiting += more or b""
        *whole, self._waiting = self._waiting.split(b"\n")
        return [one.decode() for one in whole]

    def _read(self, timeout: float) -> bytes | None:
        """Return what comes, b"" at the output's end, None after a time without either."""
        assert self.process.stdout is not None
        pipe = self.process.stdout.fileno()
        ready = select.select([pipe], [], [], max(0.0, timeout))[0]
        return os.read(pipe, 65536) if ready else None

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
        for pipe in (self.process.stdin, self.process.stdout, self._errors):
            assert pipe is not None
            pipe.close()


@contextmanager
def _ctrl_c_is_heard() -> Iterator[None]:
    """Let processes that begin in the block hear Ctrl-C: a shell's background job and all below it ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
