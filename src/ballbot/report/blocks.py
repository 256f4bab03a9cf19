"""The result of every command: a `Result`, and its parts, which a page and a terminal show.

    Result(
        title="alten: limits",
        lead="Two controllers, on the exact model.",
        verdict=(("full", "Recovers from a tilt of 9.1 degrees in every direction."),),
        sections=(Section(heading="Tilts and impulses", blocks=(Sheet(...), Picture(...))),),
        undecided=("How much a worn wheel slips: the grip is an assumption (--grip).",),
        data={"full": limits},
    )

From it come the terminal's lines (`parts`), the page and results.json (`ballbot.report.page.render`), and `summary()`,
`repr` and `to_dict()` of the value it is about (`ballbot.registry`). A table and its entries in results.json come
from one list of columns:

    COLUMNS = (
        Column("peak [mm]", lambda run: run.peak, millimetres, key="peak_position_error"),
        Column("falls", lambda run: run.falls, key="falls"),
    )
    sheet_of(runs, COLUMNS), [entries_of(run, COLUMNS) for run in runs]

Text is escaped when it is rendered, so that a name from a log or a file stays a name. Only a `Picture`, a `TimeSeries`
and a `Animation` bring markup of their own, which Ballbot made.
"""

from __future__ import annotations

import platform
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import IO, TYPE_CHECKING, Generic, TypeVar

import numpy as np
from markupsafe import Markup
from rich import box
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.files import check_regular, sha256_of
from ballbot.findings import Finding
from ballbot.printable import printable, printable_line
from ballbot.report.series import TimeSeries
from ballbot.rounding import digits
from ballbot.summary import Summary

if TYPE_CHECKING:
    from ballbot.viewer.page import ReplayPart


#: files of every result: for people, and for programs
PAGE, RESULTS = "report.html", "results.json"
#: cells that are flush right in a table: a number alone or with its sign, interval or unit
_NUMERIC = re.compile(r"[≥≈<>]?\s?[+\-−±]?[.\d].*|[–-]?|unknown|open( to .*)?|falls|no|none")


@dataclass(frozen=True)
class Cell:
    """A cell of a table."""

    text: str
    below: str = ""  #: a second line, in quiet ink


def _written(value: object) -> str:
    """Return a number with three digits, and anything else as it is."""
    return digits(value) if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Sheet:
    """A table with its caption, on a page and on a terminal.

    On a page it scrolls within its box if the page is narrower, and the caption does not.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[Cell | str | float]]  #: a number is shown with three digits
    caption: str = ""
    _: KW_ONLY
    groups: Sequence[tuple[str, int]] = ()  #: a row above the headings: text and number of columns
    shaded: frozenset[int] = frozenset()  #: rows to notice
    brief: Sequence[int] | None = None  #: the columns that a result's summary shows; all by default

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Give a console the table: framed on a terminal, plain where the output is piped or kept."""
        if self.caption:
            yield Text(printable_line(self.caption), style="bold")
        table = Table(box=box.ROUNDED if options.is_terminal else None)
        for title, numeric in zip(self.titles, self.numeric, strict=True):
            table.add_column(Text(printable_line(title)), justify="right" if numeric else "left")
        for row in self.cells:
            table.add_row(*(Text(printable(f"{cell.text} {cell.below}".strip())) for cell in row))
        yield table

    @property
    def cells(self) -> list[list[Cell]]:
        """The rows, each value as a `Cell`."""
        return [
            [cell if isinstance(cell, Cell) else Cell(_written(cell)) for cell in row] for row in self.rows
        ]

    @property
    def titles(self) -> list[str]:
        """The heading of each column after that of its group."""
        groups = [text for text, span in self.groups for _ in range(span)] or [""] * len(self.headings)
        return [" ".join(filter(None, words)) for words in zip(groups, self.headings, strict=True)]

    @property
    def numeric(self) -> list[bool]:
        """Whether each column holds numbers; the first holds names."""
        columns = zip(*self.cells, strict=True) if self.rows else [()] * len(self.headings)
        return [
            index > 0 and all(_NUMERIC.fullmatch(str(cell.text)) for cell in cells)
            for index, cells in enumerate(columns)
        ]


T = TypeVar("T")


@dataclass(frozen=True)
class Column(Generic[T]):
    """A column of a table, and an entry of results.json, of rows of one kind."""

    heading: str | None  #: with its unit; None if only results.json has the column
    value: Callable[[T], object]  #: of a row, as results.json has it
    shown: Callable[..., str | Cell] = _written  #: the value, as the table has it
    key: str = ""  #: in results.json; "" if only the table has the column


def sheet_of(
    rows: Iterable[T],
    columns: Sequence[Column[T]],
    *,
    caption: str = "",
    shaded: Callable[[T], bool] = lambda _: False,
    brief: Sequence[int] | None = None,
) -> Sheet:
    """Return the table of rows, with those columns that have a heading."""
    listed, with_heading = list(rows), [column for column in columns if column.heading is not None]
    return Sheet(
        [str(column.heading) for column in with_heading],
        [[column.shown(column.value(row)) for column in with_heading] for row in listed],
        caption,
        shaded=frozenset(index for index, row in enumerate(listed) if shaded(row)),
        brief=brief,
    )


def entries_of(row: T, columns: Sequence[Column[T]]) -> dict[str, object]:
    """Return what results.json has of a row: those columns that have a key."""
    return {column.key: column.value(row) for column in columns if column.key}


@dataclass(frozen=True)
class Paragraph:
    """Sentences."""

    text: str | Markup


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    items: Sequence[str]


@dataclass(frozen=True)
class Verbatim:
    """Lines that keep their spaces, such as a matrix or a file."""

    text: str
    caption: str = ""


@dataclass(frozen=True)
class Picture:
    """A static figure, drawn when the page is written."""

    #: returns an SVG element, as `ballbot.report.style.drawn` does, or an `img` element
    markup: Callable[[], str]
    caption: str


@dataclass(frozen=True)
class Animation:
    """A replay in three dimensions, from `ballbot.viewer.replay_part`; one on a page."""

    part: ReplayPart
    caption: str


Block = Sheet | Paragraph | Bullets | Verbatim | Picture | TimeSeries | Animation


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of a page, with an entry in the contents."""

    heading: str
    blocks: Sequence[Block]
    folded: bool = False  #: whether the page shows only heading and result until the reader opens it
    result: str = ""  #: of a folded section, in a line


@dataclass(frozen=True, kw_only=True)
class Result:
    """A result: for people its sentences, tables and figures, for programs its data."""

    title: str
    lead: str  #: what was examined, in a sentence
    #: heading, which may be empty, and sentences; the most important first
    verdict: Sequence[tuple[str, str]]
    sections: Sequence[Section]
    undecided: Sequence[str]  #: what the data cannot decide
    next_step: str = ""  #: what to do next, with the commands for it; set by the command
    provenance: Provenance | None = None  #: None until a command writes its page
    findings: Sequence[Finding] | None = None  #: of the checks of the inputs; None if nothing was checked
    #: whether the errors among them were accepted, so that results follow in spite of them
    accepted: bool = True
    data: Mapping[str, object] = field(default_factory=dict)  #: what results.json holds

    def __post_init__(self) -> None:
        # what a result does not have is empty, and is left out
        for name, given in (
            ("verdict", [row for row in self.verdict if row[1]]),
            ("sections", [part for part in self.sections if part.blocks]),
            ("undecided", [text for text in self.undecided if text]),
        ):
            object.__setattr__(self, name, given)

    @property
    def accepted_errors(self) -> list[str]:
        """The sentences of the errors of the inputs that the user accepted, so that results follow in spite of them."""
        errors = (finding for finding in self.findings or () if finding.severity == "error" and self.accepted)
        return list(dict.fromkeys(f"{finding.text} [{finding.code}]" for finding in errors))

    def summary(self) -> Summary:
        """Return the verdict, the first section's first table, and what is undecided, on one screen."""
        sheets = [block for first in self.sections[:1] for block in first.blocks if isinstance(block, Sheet)]
        table = [
            (names[0], tuple(names[1:]))
            for sheet in sheets[:1]
            for cells in (sheet.titles, *([cell.text for cell in row] for row in sheet.cells))
            for names in [[cells[k] for k in sheet.brief or range(len(cells))]]
        ]
        verdict = [row for row in self.verdict if row[0]]
        sentences = (*(text for heading, text in self.verdict if not heading), *self.undecided)
        return Summary(title=self.title, rows=(*verdict, *table), sentences=tuple(dict.fromkeys(sentences)))

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds: the data, and where they come from."""
        return ({} if self.provenance is None else {"provenance": self.provenance}) | dict(self.data)

    def parts(self, *, brief: bool = False) -> Iterator[RenderableType]:
        """Yield what a terminal shows: the page's tables, texts and lists, what is undecided, and the verdict.

        The verdict is last because people read the last lines of a terminal, and folded sections are left to the page.
        If `brief`, only the first section's first table and its lists precede it.
        """
        if brief:
            blocks = [block for first in self.sections[:1] for block in first.blocks]
            yield from [block for block in blocks if isinstance(block, Sheet)][:1]
            yield from (
                Text(f"- {item}") for block in blocks if isinstance(block, Bullets) for item in block.items
            )
        else:
            for section in (one for one in self.sections if not one.folded):
                shown = [part for block in section.blocks for part in _on_terminal(block)]
                yield from [Text(section.heading, style="bold"), *shown, Text("")] if shown else []
        yield Text("What the data cannot decide", style="bold")
        yield from (Text(f"- {words}") for words in self.undecided)
        yield Text("")
        yield from verdict_lines(self.verdict)


def verdict_lines(verdict: Sequence[tuple[str, str]]) -> list[Text]:
    """Return the sentences of a verdict, each after its heading, which may be empty."""
    return [Text.assemble((f"{heading}: " if heading else "", "bold"), words) for heading, words in verdict]


def _on_terminal(block: Block) -> Iterator[RenderableType]:
    match block:
        case Sheet():
            yield block
        case Verbatim():
            yield Text(f"{block.caption}\n{block.text}".lstrip("\n"))
        case Bullets():
            yield from (Text(f"- {item}") for item in block.items)


def section(heading: str, *blocks: Block | None) -> Section:
    """Return a section of those blocks that are neither None nor empty lists; without any it is left out of a page."""
    present = [
        block for block in blocks if not (block is None or (isinstance(block, Bullets) and not block.items))
    ]
    return Section(heading=heading, blocks=present)


def details(heading: str, *blocks: Block | None, result: str = "") -> Section:
    """Return a folded section, for what a reader looks up, with its result in a line."""
    return replace(section(heading, *blocks), folded=True, result=result)


PLAIN_WIDTH = 100  #: columns if no terminal states its width
_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}


class PlainConsole(Console):
    """A console that prints text literally: markup, emoji codes and escape sequences in it have no effect."""

    def __init__(self, *, file: IO[str] | None = None, width: int | None = None) -> None:
        """Print to a file, standard output by default; the width is the terminal's by default."""
        super().__init__(file=file, width=width, highlight=False, markup=False, emoji=False)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Render as rich does, with control sequences in texts escaped."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))


def matrix_text(name: str, matrix: Floats) -> str:
    """Return a matrix to four decimals below its name."""
    # rounding first and adding zero avoids -0
    rows = np.array2string(np.round(matrix, 4) + 0.0, precision=4, floatmode="fixed", max_line_width=200)
    return f"{name} =\n{rows}"


def finding_line(finding: Finding, *, accepted: bool = False) -> Text:
    """Return a finding as a line: its severity, whether an error is accepted, the file, the sentence and the code."""
    file = f"{finding.where.file}: " if finding.where.file else ""
    word = f"{finding.severity}{' (accepted)' if accepted and finding.severity == 'error' else ''}"
    return Text.assemble((word, _STYLES[finding.severity]), f": {file}{finding.text} [{finding.code}]")


_PACKAGES = ("ballbot", "numpy", "scipy", "numba")


@dataclass(frozen=True, kw_only=True)
class SourceFile:
    """An input file of a result."""

    name: str  #: as given by the user
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """A result's command, input files, seed and versions."""

    command: str  #: that repeats it
    files: tuple[SourceFile, ...]
    seed: int | str  #: or several, such as "1-20"
    versions: dict[str, str]  #: of Python and the packages that the numbers depend on


def provenance(*, command: str, files: Sequence[Path], seed: int | str) -> Provenance:
    """Return the provenance of a result from `files`; raise InputError if one cannot be read."""
    sources = []
    # of a ROS 2 bag's folder its files
    single = [each for path in files for each in (sorted(path.iterdir()) if path.is_dir() else (path,))]
    for path in single:
        check_regular(path)  # reading a pipe would never end
        try:
            sources.append(SourceFile(name=str(path), sha256=sha256_of(path)))
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    return Provenance(
        command=command,
        files=tuple(sources),
        seed=seed,
        versions={"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
    )
