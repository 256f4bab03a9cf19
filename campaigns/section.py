"""A section of docs/generated/evidence.md: what a campaign says about itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading, words before and after, and a table between."""

    title: str
    before: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    after: str = ""

    def markdown(self) -> str:
        """Return the section as Markdown, numbers to the right."""
        lines = [f"## {self.title}", "", self.before, ""]
        lines += [f"| {' | '.join(self.columns)} |", f"|---|{'---:|' * (len(self.columns) - 1)}"]
        lines += [f"| {' | '.join(row)} |" for row in self.rows]
        return "\n".join([*lines, "", *([self.after, ""] if self.after else [])])
