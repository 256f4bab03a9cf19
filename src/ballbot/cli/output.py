"""Where commands print, and how they show progress: a bar on a terminal, lines on standard error if piped.

The options --json and --quiet of every command act here: text is discarded, warnings and questions go to standard
error, and with --json only the results (`emit`) go to standard output.
"""

import io
import sys
import webbrowser
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Timer
from time import monotonic
from types import MappingProxyType

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress
from rich.segment import Segment

from ballbot.cli import OUTPUT
from ballbot.file_formats import results_text
from ballbot.printable import printable_line
from ballbot.progress import Progress, ProgressCallback, fraction, ignore_progress, progress_line, stage_words
from ballbot.report.blocks import PLAIN_WIDTH, PlainConsole, Sheet

_BEFORE_LINES = 3.0  #: [s] before the first line of progress, if no bar can be drawn
#: the last stage of a command; not printed unless an earlier stage was
WRITING = "writing the report"
_BETWEEN_LINES = 15.0  #: [s] between lines of progress within a stage


class _Console(PlainConsole):
    """A console whose first output replaces the line that is shown while a command starts."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        OUTPUT.get().begin()
        return super().render(renderable, options)


def standard_output() -> PlainConsole:
    """Return the console for results: plain if it is no terminal, silent with --json or --quiet."""
    if _is_silent():
        return PlainConsole(file=io.StringIO(), width=PLAIN_WIDTH)
    console = _Console()
    return console if console.is_terminal else _Console(width=PLAIN_WIDTH)


def notice(text: RenderableType, *, style: str = "") -> None:
    """Print a warning or a question, also with --json or --quiet."""
    console = _Console(file=sys.stderr) if _is_silent() else standard_output()
    console.print(text, style=style, markup=False, soft_wrap=True)


def _is_silent() -> bool:
    return OUTPUT.get().json or OUTPUT.get().quiet


def emit(results: Mapping[str, object]) -> None:
    """Set the results that --json prints when the command ends; with a folder, those of its results.json."""
    OUTPUT.get().results = results_text(results)


def show_written(
    path: Path,
    sentence: str,  # what the file is
    *,
    results: Mapping[str, object] = MappingProxyType({}),
    next_step: str = "",
) -> None:
    """Print the result of a command that wrote one file and no folder; --json prints the path and the results."""
    steps = [f"Next: {next_step}"] if next_step else []
    print_parts([sentence, str(path), *steps], standard_output())
    emit({"files": [path], **results})


def suggest_page() -> None:
    """Print on standard error that --out would write a page, unless --json or --quiet is given."""
    if not _is_silent():
        PlainConsole(file=sys.stderr).print("--out FOLDER also writes report.html.", soft_wrap=True)


def open_page(address: str) -> None:
    """Open a page in the browser."""
    if not webbrowser.open(address):
        notice("No browser could be opened; open the page in one.")


def print_parts(parts: Iterable[RenderableType], console: Console) -> None:
    """Print tables within the console's width, and lines without breaking them."""
    for part in parts:
        console.print(part, markup=False, soft_wrap=not isinstance(part, Sheet))


def _drawn(bar: RichProgress, task: TaskID) -> ProgressCallback:
    """Return the callback that moves a bar on a terminal."""
    stage = ""

    def report(progress: Progress) -> None:
        nonlocal stage
        if progress.stage != stage:  # a new total discards the speed of the previous stage
            stage = progress.stage
            bar.update(task, total=None)
        bar.update(
            task,
            completed=progress.share,
            total=1.0 if progress.total else None,
            description=stage_words(progress) or None,
            note=" ".join(filter(None, (fraction(progress), printable_line(progress.note)))),
        )

    return report


def _written(doing: str) -> ProgressCallback:
    """Return the callback that writes lines on standard error if output is piped: one a stage, and some in between.

    Nothing is written in the first seconds, so that bad input is answered by one sentence only.
    """
    stage, written, due = doing, "", monotonic() + _BEFORE_LINES

    def report(progress: Progress) -> None:
        nonlocal stage, written, due
        stage = progress.stage or stage
        if (monotonic() < due and written in ("", stage)) or (not written and stage == WRITING):
            return
        written, due = stage, monotonic() + _BETWEEN_LINES
        line = progress_line(replace(progress, stage=stage), "")
        print(f"ballbot: {printable_line(line)}", file=sys.stderr, flush=True)

    return report


@contextmanager
def progress_bar(
    console: Console,  # from `standard_output`
    doing: str,  # what is being done
) -> Iterator[ProgressCallback]:
    """Show a bar with the elapsed and the remaining time while the block runs; lines on standard error if piped."""
    if OUTPUT.get().quiet:
        yield ignore_progress
        return
    if not console.is_terminal:
        report = _written(doing)
        # what compiles first reports nothing meanwhile
        timer = Timer(_BEFORE_LINES, report, [Progress(stage="")])
        timer.daemon = True
        timer.start()
        try:
            yield report
        finally:
            timer.cancel()
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[note]}", markup=False),
        TimeElapsedColumn(),
        TimeRemainingColumn(),  # of the stage
    )
    OUTPUT.get().begin()
    with RichProgress(*columns, console=console, transient=True) as bar:
        yield _drawn(bar, bar.add_task(printable_line(doing), total=None, note=""))
