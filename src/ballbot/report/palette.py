"""The colors of figures, and the same figures in the theme of a page.

Blue and orange are a pair that color-blind readers can distinguish; a line has its own dash or weight as well.
"""

import re

#: by the page's name for it, the color of a figure, for which the page takes that of its theme
_THEME = {
    "ink": "#22303c",
    "muted": "#6b7883",
    "line": "#dfe4e8",
    "band": "#e9edf0",
    "blue": "#1f5f9e",
    "orange": "#c2670f",
    "green": "#2f7554",
    "violet": "#8a4f7d",
    "yellow": "#a8901c",
    "red": "#b3372f",
    "pale": "#b4bfc8",
    "axis": "#9aa5ae",
    # areas of recovery: up to the lower bound, and up to the upper bound
    "lower": "#7fa6cf",
    "upper": "#d8e3ef",
    "page": "#ffffff",
}
INK, MUTED, GRID, SHADE, BLUE, ORANGE, GREEN, VIOLET, YELLOW, RED, PALE, AXIS, LOWER, UPPER, _ = (
    _THEME.values()
)
_NAME_OF = {color: name for name, color in _THEME.items()}


def themed(svg: str) -> str:
    """Return a figure whose colors are those of the page's theme, light or dark."""
    return re.sub(rf"(?<=: )({'|'.join(_NAME_OF)})\b", lambda match: f"var(--{_NAME_OF[match[1]]})", svg)
