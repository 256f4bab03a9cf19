"""The commands: options and a few calls each. `app` lists them, `main` runs one, `context` is their common part."""

import os
import sys
import threading
from contextvars import ContextVar
from dataclasses import dataclass
from time import monotonic

# before NumPy is imported: threads of OpenBLAS that wait for each other take a training many times as long beside other
# work, and results would depend on their number
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
_BETWEEN = 0.25  #: [s] between two updates of the line


class Waiting:
    """A line on the terminal while a command is imported and compiled, until it shows its own; `end` removes it."""

    def __init__(self, words: str) -> None:
        """Show words and the seconds since now, if the output is a terminal."""
        self._words, self._began, self._ended = words, monotonic(), threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)
        if sys.stdout is not None and sys.stderr is not None and sys.stdout.isatty() and sys.stderr.isatty():
            self._thread.start()

    def end(self) -> None:
        """Remove the line."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _show(self) -> None:
        shown = False
        while not self._ended.wait(_BETWEEN):
            shown = True
            print(f"\r{self._words}, {monotonic() - self._began:.0f} s", end="", file=sys.stderr, flush=True)
        if shown:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


@dataclass(kw_only=True)
class Output:
    """The output of the running command: its options, and what it prints at its end."""

    json: bool = False  #: results as JSON on standard output, and nothing else there
    quiet: bool = False  #: no results and no progress
    results: str = ""  #: JSON text, for standard output
    waiting: Waiting | None = None  #: the line until the command prints something

    def begin(self) -> None:
        """Remove the waiting line before the command prints."""
        if self.waiting is not None:
            self.waiting.end()


#: the words of the command line that runs, after `ballbot`; set by `ballbot.cli.main`
ARGV: ContextVar[tuple[str, ...]] = ContextVar("ballbot command line", default=())
#: of the command line that runs; set by `ballbot.cli.main`
OUTPUT: ContextVar[Output] = ContextVar("ballbot output", default=Output())  # noqa: B039 (read only by default)
