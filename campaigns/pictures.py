"""The documents' figures, in the report's style and in one folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from ballbot.files import write_text
from ballbot.report.style import drawn

FOLDER = Path(__file__).parents[1] / "docs" / "images"


def write_picture(name: str, draw: Callable[[], Figure]) -> str:
    """Draw a figure into docs/images/NAME.svg and return its path as seen from docs/generated."""
    path = FOLDER / f"{name}.svg"
    write_text(path, '<?xml version="1.0" encoding="utf-8"?>\n' + drawn(draw, name=name))
    return f"../{FOLDER.name}/{path.name}"
