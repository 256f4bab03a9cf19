"""The parts of a report's page: what a command gives to the one page builder, `ballbot.report.page.page_of`.

    Report(
        title="alten: limits",
        lead="Two controllers, on the exact model.",
        verdict=(("full", "Recovers from a tilt of 9.1 degrees in every direction."),),
        sections=(Section(heading="Tilts and impulses", blocks=(Sheet(...), Picture(...))),),
        undecided=("How much a worn wheel slips: the grip is an assumption (--grip).",),
    )

A terminal shows `Report.parts` of it, so that both have the same words and numbers.

Text is escaped when it is rendered, so that a name from a log or a file stays a name. Only a `Picture`, a `TimeSeries`
and a `Film` bring markup of their own, which Ballbot made.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from markupsafe import Markup
from rich import box
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from ballbot.findings import Finding
from ballbot.printable import printable, printable_line
from ballbot.report.series import TimeSeries

if TYPE_CHECKING:
    from ballbot.report.provenance import Provenance
    from ballbot.viewer.page import ReplayPart

#: a number alone or with its sign, interval or unit; what stands flush right in a table
_NUMERIC = re.compile(r"[≥≈<>]?\s?[+\-−±]?[.\d].*|[–-]?|unknown|open( \.\. .*)?|falls|no|none")


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell of a table that is more than a text."""

    text: str
    below: str = ""  #: a second line, in quiet ink


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A table with its caption, on a page and on a terminal.

    On a page it scrolls within its box if the page is narrower, and the caption does not.
    """

    kind: ClassVar[str] = "sheet"
    headings: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    caption: str = ""
    groups: Sequence[tuple[str, int]] = ()  #: a row above the headings: text and number of columns
    shaded: frozenset[int] = frozenset()  #: rows to notice

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Give a console the table: framed on a terminal, plain where the output is piped or kept."""
        if self.caption:
            yield Text(printable_line(self.caption), style="bold")
        made = Table(box=box.ROUNDED if options.is_terminal else None)
        groups = [text for text, span in self.groups for _ in range(span)] or [""] * len(self.headings)
        for group, heading, numeric in zip(groups, self.headings, self.numeric, strict=True):
            words = " ".join(filter(None, (group, heading)))
            made.add_column(Text(printable_line(words)), justify="right" if numeric else "left")
        for row in self.cells:
            made.add_row(*(Text(printable(f"{cell.text} {cell.below}".strip())) for cell in row))
        yield made

    @property
    def cells(self) -> list[list[Cell]]:
        """Every cell as one."""
        return [[one if isinstance(one, Cell) else Cell(text=one) for one in row] for row in self.rows]

    @property
    def numeric(self) -> list[bool]:
        """Whether each column holds numbers; the first holds names."""
        columns = zip(*self.cells, strict=True) if self.rows else [()] * len(self.headings)
        return [
            index > 0 and all(_NUMERIC.fullmatch(str(cell.text)) for cell in cells)
            for index, cells in enumerate(columns)
        ]


@dataclass(frozen=True, kw_only=True)
class Paragraph:
    """Sentences."""

    kind: ClassVar[str] = "paragraph"
    text: str | Markup


@dataclass(frozen=True, kw_only=True)
class Bullets:
    """Sentences that belong together, each by itself."""

    kind: ClassVar[str] = "bullets"
    items: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Verbatim:
    """Lines that keep their spaces, as a matrix or a file."""

    kind: ClassVar[str] = "verbatim"
    text: str
    caption: str = ""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure that does not change, drawn when a page is made of it."""

    kind: ClassVar[str] = "picture"
    #: returns an SVG element, as `ballbot.report.style.drawn` does, or an `img` element
    markup: Callable[[], str]
    caption: str


@dataclass(frozen=True, kw_only=True)
class Film:
    """A replay in three dimensions, from `ballbot.viewer.replay_part`; one on a page."""

    kind: ClassVar[str] = "film"
    part: ReplayPart
    caption: str


Block = Sheet | Paragraph | Bullets | Verbatim | Picture | TimeSeries | Film


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of a page, with an entry in the contents."""

    heading: str
    blocks: Sequence[Block]
    folded: bool = False  #: whether the page shows only its heading until the reader opens it


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a command found, for people."""

    title: str
    lead: str  #: what was examined, in a sentence
    #: heading, which may be empty, and sentences; the most important first
    verdict: Sequence[tuple[str, str]]
    sections: Sequence[Section]
    undecided: Sequence[str]  #: what the data cannot decide
    next_step: str = ""  #: what to do with the result, with its commands; a command states it
    made: Provenance | None = None  #: None until a command writes its page
    findings: Sequence[Finding] | None = None  #: of the checks of the inputs; None if nothing was checked
    #: whether the errors among them were accepted, so that results follow in spite of them
    accepted: bool = True

    def parts(self, *, brief: bool = False) -> Iterator[RenderableType]:
        """Yield what a terminal shows: tables, texts and lists of the page, and the doubts; then the verdict.

        The last lines of a terminal are those that are read. A `brief` one shows of the sections the first one's first
        table and its sentences.
        """
        if brief:
            blocks = [block for one in self.sections[:1] for block in one.blocks]
            yield from [block for block in blocks if isinstance(block, Sheet)][:1]
            yield from (
                Text(f"- {item}") for block in blocks if isinstance(block, Bullets) for item in block.items
            )
        else:
            yield from self._whole()
        yield Text("What the data cannot decide", style="bold")
        yield from (Text(f"- {words}") for words in self.undecided)
        yield Text("")
        yield from verdict_lines(self.verdict)

    def _whole(self) -> Iterator[RenderableType]:
        for one in self.sections:
            shown = [part for block in one.blocks for part in _on_terminal(block)]
            if shown:
                yield Text(one.heading, style="bold")
                yield from (*shown, Text(""))


def verdict_lines(verdict: Sequence[tuple[str, str]]) -> list[Text]:
    """Return what was found in sentences, each after its heading, which may be empty."""
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
    """Return a section of those blocks that are not None."""
    return Section(heading=heading, blocks=tuple(one for one in blocks if one is not None))


def details(heading: str, *blocks: Block | None) -> Section:
    """Return a section that is folded: what a reader looks up."""
    return replace(section(heading, *blocks), folded=True)
