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
from ballbot.progress import Pace, Progress, progress_line

#: [s] before the first line, and between two
_BEFORE, _BETWEEN = 1.0, 0.2


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

    One is enough for all work of a process: all that a cell does is one line, which shows the present stage.

    Parameters
    ----------
    clock : callable
        Gives the time [s]; another one is for tests.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._shell: Any = None  # whose cells are waited for
        self._begin()

    def _begin(self) -> None:
        self._handle: Handle | None = None
        self._pace = Pace(self._clock)
        self._next: float | None = None  # when a line is due [s]; None before the first report
        self._last = Progress(stage="")

    def __call__(self, progress: Progress) -> None:
        """Show how far work has come, if it is time to."""
        shell = running_notebook()
        if shell is None:
            return
        self._wait_for_end_of_cell(shell)
        self._pace.note(progress)
        if self._next is None:
            self._next = self._clock() + _BEFORE
        due = self._clock() >= self._next or (self._handle is not None and progress.share >= 1.0)
        self._last = progress
        if due:
            self._next = self._clock() + _BETWEEN
            self._show(ProgressLine(progress_line(progress, self._pace.left()), progress.share))

    def _show(self, line: ProgressLine) -> None:
        if self._handle is not None:
            self._handle.update(line)
            return
        from IPython.display import display  # pyright: ignore[reportMissingImports]

        self._handle = display(line, display_id=True)

    def _wait_for_end_of_cell(self, shell: Any) -> None:
        if self._shell is not shell and hasattr(shell, "events"):
            self._shell = shell
            shell.events.register("post_run_cell", self._end_of_cell)

    def _end_of_cell(self, result: Any) -> None:
        """Fill the bar of a cell that has run; that of one that failed stays where it was."""
        if self._handle is not None and result.success:
            whole = replace(self._last, done=1.0, total=1.0)
            self._handle.update(ProgressLine(progress_line(whole, ""), 1.0))
        self._begin()


def running_notebook() -> Any:
    """Return the shell of the notebook that this process works for; None if it works for none."""
    ipython = sys.modules.get("IPython")  # a notebook has imported it
    shell = ipython.get_ipython() if ipython is not None else None
    return shell if shell is not None and hasattr(shell, "kernel") else None  # a terminal has no kernel


#: of everything that reports to nobody else
in_notebook = NotebookProgress()
