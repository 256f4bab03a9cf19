"""A printed number beside ours, and tables of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A number that a source prints, with what our equations give for it."""

    name: str
    printed: str  #: digit by digit as in the source, so that its precision is known
    reproduced: float  #: with the source's own convention or mistake
    right: float  #: by the exact equations

    @property
    def rounding(self) -> float:
        """Half a unit of the last printed digit."""
        return 0.5 * 10.0 ** -len(self.printed.partition(".")[2])

    @property
    def difference(self) -> float:
        """What is reproduced less what is printed, relative to the latter."""
        return self.reproduced / float(self.printed) - 1.0

    @property
    def comes_out(self) -> bool:
        """Whether the reproduced number rounds to the printed one."""
        return abs(self.reproduced - float(self.printed)) <= self.rounding * (1.0 + 1e-9)


def entry_table(entries: Sequence[Entry]) -> str:
    """Return a Markdown table of printed, reproduced and right numbers."""
    rows = [
        [
            entry.name,
            entry.printed,
            f"{entry.reproduced:.5g}",
            "to its last digit" if entry.comes_out else f"off by {100.0 * entry.difference:+.2f} %",
            f"{entry.right:.5g}",
        ]
        for entry in entries
    ]
    return markdown_table(["", "printed", "reproduced", "comes out", "right"], rows)


def markdown_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; the columns after the first are set flush right."""
    marks = [":--", *("--:" for _ in headings[1:])]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [list(headings), marks, *rows])
