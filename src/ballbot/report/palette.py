"""The colors of figures, and the same figures in the theme of a page.

Blue and orange are a pair that color-blind readers can distinguish; a line has its own dash or weight as well.
"""

from __future__ import annotations

import re

INK = "#22303c"
MUTED = "#6b7883"
GRID = "#dfe4e8"
SHADE = "#e9edf0"
BLUE = "#1f5f9e"
ORANGE = "#c2670f"
GREEN = "#2f7554"
VIOLET = "#8a4f7d"
YELLOW = "#a8901c"
RED = "#b3372f"
PALE = "#b4bfc8"
AXIS = "#9aa5ae"
#: of areas of recovery: up to the lower bound, and up to the upper bound
LOWER, UPPER = "#7fa6cf", "#d8e3ef"

#: the figures' colors, for which a page takes those of its theme; others stay
_THEMED = {
    INK: "ink",
    MUTED: "muted",
    GRID: "line",
    SHADE: "band",
    BLUE: "blue",
    ORANGE: "orange",
    GREEN: "green",
    VIOLET: "violet",
    YELLOW: "yellow",
    RED: "red",
    PALE: "pale",
    AXIS: "axis",
    LOWER: "lower",
    UPPER: "upper",
    "#ffffff": "page",
}


def themed(svg: str) -> str:
    """Return a figure whose colors are those of the page's theme, light or dark."""
    colors = "|".join(_THEMED)
    return re.sub(rf"(?<=: )({colors})\b", lambda match: f"var(--{_THEMED[match[1]]})", svg)
