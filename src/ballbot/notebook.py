"""Progress in a notebook: one line with a bar that is updated in place while work goes on.

Nothing is shown outside a notebook, nor before work has taken a second. No package is needed: a notebook has IPython.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from html import escape
from time import monotonic
from typing import Protocol

from ballbot.printable import printable_line
from ballbot.progress import EtaEstimator, Progress, progress_line, time_left

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
        self._begin()

    def _begin(self) -> None:
        self._handle: Handle | None = None
        self._pace = EtaEstimator(self._clock)
        self._share, self._next = 0.0, self._clock() + _BEFORE

    def __call__(self, progress: Progress) -> None:
        """Show how far work has come, if it is time to."""
        display = _display_of_a_notebook()
        if display is None:
            return
        if progress.share < self._share - _FALLS:
            self._begin()
        self._share = progress.share
        line = progress_line(progress, time_left(progress, self._pace))
        done = progress.share >= 1.0
        if self._clock() >= self._next or (done and self._handle is not None):
            self._next = self._clock() + _BETWEEN
            shown = ProgressLine(line, progress.share)
            if self._handle is None:
                self._handle = display(shown)
            else:
                self._handle.update(shown)
        if done:
            self._begin()


def _display_of_a_notebook() -> Callable[[ProgressLine], Handle | None] | None:
    """Return what shows a line in the notebook that this process works for; None if it works for none."""
    ipython = sys.modules.get("IPython")  # a notebook has imported it
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is None or not hasattr(shell, "kernel"):  # a terminal has no kernel
        return None
    from IPython.display import display  # pyright: ignore[reportMissingImports]

    return lambda line: display(line, display_id=True)


#: of everything that reports to nobody else
in_notebook = NotebookProgress()
