"""How commands print: tables framed on a terminal and plain where the output is piped or kept, and progress bars."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from ballbot.pace import Pace, as_clock

_WIDTH = 100  #: columns where no terminal says how many there are


def standard_output() -> Console:
    """Return the console that commands print to, plain where it is no terminal."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=_WIDTH)


class Bar:
    """A progress bar that is shown; made by `progress_bar`."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        """Move that task of rich's."""
        self._progress, self._task, self._pace = progress, task, Pace()

    def show(self, share: float, *, doing: str | None = None, note: str = "") -> None:
        """Show that a share of the work, 0 to 1, is done, what is being done now, and a short note."""
        seconds = self._pace.seconds_left(share)
        left = "" if seconds is None else f"about {as_clock(seconds)} left"
        self._progress.update(self._task, completed=share, description=doing, note=note, left=left)


@contextmanager
def progress_bar(console: Console, doing: str) -> Iterator[Bar]:
    """Show a bar with the time gone by and the time left while the block runs, on a terminal only.

    Parameters
    ----------
    console : Console
        From `standard_output`.
    doing : str
        What is being done.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as progress:
        yield Bar(progress, progress.add_task(doing, total=1.0, note="", left=""))


def as_text(parts: Sequence[RenderableType]) -> str:
    """Return what printing these parts would put into a file: no frames, no colours."""
    buffer = io.StringIO()
    console = Console(file=buffer, highlight=False, width=_WIDTH)
    for part in parts:
        console.print(part)
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n"


def table(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], *, framed: bool) -> Table:
    """Return a table of texts; the columns after the first are set flush right where they hold numbers."""
    made = Table(title=title, title_justify="left", title_style="bold", box=box.ROUNDED if framed else None)
    for index, heading in enumerate(headings):
        numeric = bool(rows) and all(_is_number(row[index]) for row in rows)
        made.add_column(heading, justify="right" if numeric else "left")
    for row in rows:
        made.add_row(*(Text(cell) for cell in row))
    return made


def matrix_text(name: str, matrix: NDArray[np.float64], *, decimals: int = 4) -> str:
    """Return a matrix as lines of fixed decimals, its name before the middle row."""
    scale = 10.0**decimals
    # rounding first and adding zero keeps a minus sign off what prints as nothing
    cells = [[f"{value:.{decimals}f}" for value in row] for row in np.round(matrix * scale) / scale + 0.0]
    width = max(len(cell) for row in cells for cell in row)
    middle = (len(cells) - 1) // 2
    lines = []
    for index, row in enumerate(cells):
        label = f"{name} =" if index == middle else ""
        lines.append(f"{label:<{len(name) + 3}}[ {'  '.join(f'{cell:>{width}}' for cell in row)} ]")
    return "\n".join(lines)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
