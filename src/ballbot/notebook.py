"""Progress in a notebook: one line with a bar that is updated in place while work goes on.

Nothing is shown outside a notebook, nor before work has taken a second. No package is needed: a notebook has IPython.
A bar whose work ends without saying so is full when its cell has run; one in a cell that failed stays where it was.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from html import escape
from time import monotonic
from typing import Any, Protocol

from ballbot.printable import printable_line
from ballbot.progress import EtaEstimator, Progress, progress_line, slowdown_now, time_left

#: [s] before the first line, and between two
_BEFORE, _BETWEEN = 1.0, 0.2
#: a share that falls by this much is that of other work
_FALLS = 1e-6


class ProgressLine:
    """A line of progress, as text and as HTML."""

    def __init__(self, text: str, share: float) -> None:
        self.text, self.share = printable_line(text), share

    def __repr__(self) -> str:
        """Return the line."""
        return self.text

    def _repr_html_(self) -> str:
        return f'<progress max="1" value="{self.share:.4f}"></progress> {escape(self.text)}'


class Handle(Protocol):
    """A place in a notebook's output, as `IPython.display.display` gives it."""

    def update(self, shown: ProgressLine, /) -> object:
        """Show that in its place."""
        ...


class NotebookProgress:
    """A progress callback that shows work in a notebook, and does nothing elsewhere.

    One is enough for all work of a process, one after the other: a share that falls begins a new line.

    Parameters
    ----------
    clock : callable
        Gives the time [s]; another one is for tests.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._open: dict[int, tuple[Handle, Progress]] = {}  # lines that are not full, in their order
        self._shell: Any = None  # whose cells are waited for
        self._begin()

    def _begin(self) -> None:
        self._handle: Handle | None = None
        self._pace = EtaEstimator(self._clock, slowdown=slowdown_now())
        self._share, self._next = 0.0, self._clock() + _BEFORE

    def __call__(self, progress: Progress) -> None:
        """Show how far work has come, if it is time to."""
        shell = _notebook()
        if shell is None:
            return
        if progress.share < self._share - _FALLS:
            self._begin()
        self._share = progress.share
        line = progress_line(progress, time_left(progress, self._pace))
        done = progress.share >= 1.0
        if self._clock() >= self._next or (done and self._handle is not None):
            self._next = self._clock() + _BETWEEN
            self._show(ProgressLine(line, progress.share), shell)
        if self._handle is not None:
            self._open[id(self._handle)] = (self._handle, progress)
        if done:
            self._open.pop(id(self._handle), None)
            self._begin()

    def _show(self, line: ProgressLine, shell: Any) -> None:
        if self._handle is not None:
            self._handle.update(line)
            return
        from IPython.display import display  # pyright: ignore[reportMissingImports]

        self._handle = display(line, display_id=True)
        if self._shell is not shell and hasattr(shell, "events"):
            self._shell = shell
            shell.events.register("post_run_cell", self._end_of_cell)

    def _end_of_cell(self, result: Any) -> None:
        """Fill the bars of a cell that has run; forget those of one that failed."""
        for handle, progress in self._open.values() if result.success else ():
            handle.update(ProgressLine(progress_line(replace(progress, share=1.0), ""), 1.0))
        self._open.clear()
        self._begin()


def _notebook() -> Any:
    """Return the shell of the notebook that this process works for; None if it works for none."""
    ipython = sys.modules.get("IPython")  # a notebook has imported it
    shell = ipython.get_ipython() if ipython is not None else None
    return shell if shell is not None and hasattr(shell, "kernel") else None  # a terminal has no kernel


#: of everything that reports to nobody else
in_notebook = NotebookProgress()
