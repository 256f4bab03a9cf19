"""A line on the terminal from the first second, while a command is imported and compiled, until it shows its own."""

from __future__ import annotations

import sys
import threading
from time import monotonic

_BETWEEN = 0.25  #: [s] between two pictures of the line


class Waiting:
    """The line; `end` removes it."""

    def __init__(self, words: str) -> None:
        """Show words and the seconds since now, if anyone watches."""
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
