"""A section of docs/generated/evidence.md, and the folder of logs that are not shipped."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


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


class DataMissingError(Exception):
    """A campaign needs logs that are not shipped with Ballbot."""


def data_folder() -> Path:
    """Return the folder that BALLBOT_DATA names: logs of the test robot in bbr/, the EMPS benchmark in emps/.

    Raises
    ------
    DataMissingError
        If BALLBOT_DATA names no folder.
    """
    folder = os.environ.get("BALLBOT_DATA", "")
    if not Path(folder).is_dir() or not folder:
        raise DataMissingError("it needs measured logs; set BALLBOT_DATA to their folder")
    return Path(folder)
