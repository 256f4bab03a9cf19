"""Results as text: consoles that obey nothing in it, matrices and findings; tables are `blocks.Sheet`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from ballbot.findings import Finding
from ballbot.printable import printable

PLAIN_WIDTH = 100  #: columns if no terminal states its width
_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}


class PlainConsole(Console):
    """A console that shows text as it is: what looks like markup, emoji or an escape sequence is not obeyed."""

    def __init__(self, *, file: IO[str] | None = None, width: int | None = None) -> None:
        """Print to a file, standard output by default; the width is the terminal's by default."""
        super().__init__(file=file, width=width, highlight=False, markup=False, emoji=False)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Render as rich does, what a terminal would obey in texts escaped."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))


def matrix_text(name: str, matrix: NDArray[np.float64]) -> str:
    """Return a matrix as lines of four decimals, its name before the middle row."""
    # rounding first and adding zero keeps a minus sign off what prints as nothing
    cells = [[f"{value:.4f}" for value in row] for row in np.round(matrix, 4) + 0.0]
    width = max(len(cell) for row in cells for cell in row)
    middle = (len(cells) - 1) // 2
    lines = []
    for index, row in enumerate(cells):
        label = f"{name} =" if index == middle else ""
        lines.append(f"{label:<{len(name) + 3}}[ {'  '.join(f'{cell:>{width}}' for cell in row)} ]")
    return "\n".join(lines)


def finding_line(finding: Finding, *, accepted: bool = False) -> Text:
    """Return a finding as a line: its severity, whether an error is accepted, the file, the sentence and the code."""
    file = f"{finding.where.file}: " if finding.where.file else ""
    word = f"{finding.severity}{' (accepted)' if accepted and finding.severity == 'error' else ''}"
    return Text.assemble((word, _STYLES[finding.severity]), f": {file}{finding.text} [{finding.code}]")
