"""Progress of long work: what is being done, how much of that is done, and how long the rest of it takes at this pace.

Work goes through stages. How far a stage has come is known if it knows its number of steps; how long later stages take
is not guessed.
"""

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape
from time import monotonic
from typing import Any

from ballbot.printable import printable_line


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a stage of the work has come."""

    stage: str  #: what is being done, such as "gauss_newton"
    done: float = 0.0  #: steps of the stage that are done
    total: float = 0.0  #: steps that the stage takes at most; 0 if that is not known
    cost: float = math.nan  #: the best cost so far, where the work minimises one
    note: str = ""  #: a few words to show beside it

    @property
    def share(self) -> float:
        """Fraction of the stage that is done, 0 to 1; 0 if its number of steps is not known."""
        return min(self.done / self.total, 1.0) if self.total else 0.0


ProgressCallback = Callable[[Progress], None]


def ignore_progress(progress: Progress) -> None:
    """Do nothing: the callback of work that nobody watches."""


def in_stage(callback: ProgressCallback, stage: str) -> ProgressCallback:
    """Return a callback for a part of the work, all of which is one stage to those who watch the whole."""
    return lambda progress: callback(replace(progress, stage=stage))


#: no pace is taken from less time than this [s]
_SHORTEST = 1.0


class Pace:
    """The pace of the present stage since its first report, whose steps may have compiled code."""

    def __init__(
        self,
        clock: Callable[[], float] = monotonic,  # gives the time [s]; another one is for tests
    ) -> None:
        self._clock = clock
        self._stage, self._begun, self._before = "", clock(), 0.0  # the latter: share at the first report
        self._share = 0.0

    def note(self, progress: Progress) -> None:
        """Note how far the stage has come."""
        if progress.stage != self._stage or progress.share < self._share:
            self._stage, self._begun, self._before = progress.stage, self._clock(), progress.share
        self._share = progress.share

    def left(self) -> str:
        """Return how long the rest of the stage takes, in words; empty if that is not known or nothing is left."""
        spent, worked = self._clock() - self._begun, self._share - self._before
        if spent < _SHORTEST or worked <= 0.0 or self._share >= 1.0:
            return ""
        return f"about {as_clock(spent * (1.0 - self._share) / worked)} left"


def stage_words(progress: Progress) -> str:
    """Return what is being done, in words."""
    return _METHODS.get(progress.stage, printable_line(progress.stage).replace("_", " "))


#: stages that are methods with a name
_METHODS = {"gauss_newton": "Gauss-Newton"}


def fraction(progress: Progress) -> str:
    """Return how much of the stage is done, in percent; empty if its number of steps is not known."""
    return f"{100.0 * progress.share:.0f} %" if progress.total else ""


def progress_line(progress: Progress, left: str) -> str:
    """Return how far work has come as a line."""
    return ", ".join(filter(None, (stage_words(progress), fraction(progress), progress.note, left)))


_BARS = "▁▂▃▄▅▆▇█"


def sparkline(values: Sequence[float], width: int = 20) -> str:
    """Return values as a line of bars from the least to the greatest; of more values than `width`, every so many.

    >>> sparkline([0.1, 0.2, 0.4, 0.8])
    '▁▂▄█'
    """
    last = len(values) - 1
    shown = [values[k] for k in sorted({round(last * k / (width - 1)) for k in range(width)})]
    least, span = min(shown), max(max(shown) - min(shown), 1e-9)
    return "".join(_BARS[min(int(8.0 * (value - least) / span), 7)] for value in shown)


def as_clock(seconds: float) -> str:
    """Return seconds as minutes:seconds, with hours before them where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class NotebookProgress:
    """A progress callback that shows work as one line of a notebook's cell, and does nothing elsewhere.

    Nothing is shown before work has taken a second. No package is needed: a notebook has IPython.
    """

    def __init__(
        self,
        clock: Callable[[], float] = monotonic,  # gives the time [s]; another one is for tests
    ) -> None:
        self._clock, self._pace = clock, Pace(clock)
        self._cell: int | None = None  # whose line is shown
        self._line: Any = None  # its place in the cell's output
        self._due = 0.0  # when the next line is [s]

    def __call__(self, progress: Progress) -> None:
        """Show how far work has come, if it is time to."""
        shell = running_notebook()
        if shell is None:
            return
        now = self._clock()
        if shell.execution_count != self._cell:
            self._cell, self._line, self._due = shell.execution_count, None, now + 1.0
        self._pace.note(progress)
        if now < self._due and (self._line is None or progress.share < 1.0):
            return
        self._due = now + 0.2
        text = printable_line(progress_line(progress, self._pace.left()))
        bar = f'<progress max="1" value="{progress.share:.4f}"></progress> {escape(text)}'
        shown = {"text/plain": text, "text/html": bar}
        if self._line is None:
            from IPython.display import display  # pyright: ignore[reportMissingImports]

            self._line = display(shown, raw=True, display_id=True)
        else:
            self._line.update(shown, raw=True)


def running_notebook() -> Any:
    """Return the shell of the notebook that this process works for; None if it works for none."""
    ipython = sys.modules.get("IPython")  # a notebook has imported it
    shell = ipython.get_ipython() if ipython is not None else None
    return shell if shell is not None and hasattr(shell, "kernel") else None  # a terminal has no kernel


#: of everything that reports to nobody else
in_notebook = NotebookProgress()
