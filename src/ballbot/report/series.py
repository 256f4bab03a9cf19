"""Time series of a page: panels over one time, which the reader zooms and reads without a network.

The page holds the numbers, packed like those of a replay; `web/charts.js` draws them with uPlot. A long series is
reduced to the smallest and the largest value of each piece, so that no peak is lost.
"""

import json
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Literal

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats
from ballbot.printable import printable_line
from ballbot.viewer.packing import packed

#: how a line is drawn, each with a color, a dash, a width and a marker of its own, distinct in grey
Look = Literal["measured", "first", "second", "third", "fourth", "fifth", "sixth", "reference", "quiet"]
#: looks of lines of one kind, such as wheels, in order. A robot has up to four wheels; other lines of the same figure
#: have other looks: "measured" for the main line of a panel, "fifth" and "sixth" for those beside it
IN_TURN: tuple[Look, ...] = ("first", "second", "third", "fourth", "fifth", "sixth")

#: largest number of rows of a series in a page: four for each pixel of a wide screen
_MOST_ROWS = 4000


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a panel: `Line("measured", log["x"], "measured")`."""

    name: str  #: for the legend; lines of one name and look share an entry
    values: Floats  #: (n,), NaN if missing
    look: Look


@dataclass(frozen=True, eq=False)
class Panel:
    """Lines over the same axis."""

    label: str  #: quantity and unit, as "lean [deg]"
    lines: Sequence[Line]
    _: KW_ONLY
    levels: Sequence[float] = ()  #: limits, as lines across
    from_zero: bool = False  #: whether the axis begins at zero
    ends: tuple[float, float] | None = None  #: ends of the axis, if lines may leave it


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """Panels over one time."""

    t: Floats  #: (n,) [s], increasing
    panels: Sequence[Panel]
    caption: str
    _: KW_ONLY
    across: str = "time [s]"
    shaded: Sequence[tuple[float, float]] = ()  #: intervals of time
    shade: str = ""  #: what the shade means, for the legend
    level: str = ""  #: what the levels are, for the legend

    def markup(self) -> Markup:
        """Return the data as JSON to stand within a script element: no "<" can end it."""
        times, kept = _rows(self.t, [line.values for panel in self.panels for line in panel.lines])
        shown = iter(kept)
        data = {
            "t": packed(self.t[times], resolution=0.0),
            "across": self.across,
            "shaded": [[float(start), float(end)] for start, end in self.shaded],
            "shade": self.shade,
            "level": self.level,
            "panels": [
                {
                    "label": panel.label,
                    "levels": [float(level) for level in panel.levels],
                    "from_zero": panel.from_zero,
                    "ends": panel.ends,
                    "lines": [
                        {
                            "name": printable_line(line.name),
                            "look": line.look,
                            "values": packed(line.values[next(shown)], resolution=np.inf),
                        }
                        for line in panel.lines
                    ],
                }
                for panel in self.panels
            ],
        }
        text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
        return Markup(text.replace("<", "\\u003c"))


def _rows(t: Floats, columns: Sequence[Floats]) -> tuple[NDArray[np.intp], list[NDArray[np.intp]]]:
    """Return which rows of the time and of each column are kept: all, or two of each piece.

    The two are the smallest and the largest value, in their order in time; their times are those of the piece's first
    and middle row, so that all columns share them.
    """
    count = len(t)
    size = 2 * -(-count // _MOST_ROWS)  # rows of a piece, which becomes two
    if size <= 2:
        every = np.arange(count)
        return every, [every] * len(columns)
    starts = np.arange(0, count, size)
    times = np.minimum(np.stack([starts, starts + size // 2], axis=1), count - 1).ravel()
    return times, [_extremes(values, starts, size) for values in columns]


def _extremes(values: Floats, starts: NDArray[np.intp], size: int) -> NDArray[np.intp]:
    filled = np.full(len(starts) * size, np.nan)
    filled[: len(values)] = values
    pieces = filled.reshape(len(starts), size)
    least = np.where(np.isnan(pieces), np.inf, pieces).argmin(axis=1)
    greatest = np.where(np.isnan(pieces), -np.inf, pieces).argmax(axis=1)
    both = starts[:, None] + np.sort([least, greatest], axis=0).T
    return np.minimum(both, len(values) - 1).ravel()


def wheel_lines(columns: Sequence[Floats]) -> list[Line]:
    """Return a line for each wheel."""
    return [Line(f"wheel {k + 1}", column, IN_TURN[k % len(IN_TURN)]) for k, column in enumerate(columns)]


def together(runs: Sequence[tuple[str, Look, Floats, Floats]]) -> tuple[Floats, list[Line]]:
    """Return one time and a line for each run (name, look, t, values) at it, NaN where a run has none.

    The longest run's times are kept, and others are interpolated between their rows.
    """
    t = max((own for *_, own, _ in runs), key=len)
    return t, [
        Line(name, np.interp(t, own, values, left=np.nan, right=np.nan), look)
        for name, look, own, values in runs
    ]


def true_spans(t: Floats, flags: Bools) -> list[tuple[float, float]]:
    """Return the times of the first and the last row of each run of true flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(float(t[first]), float(t[end - 1])) for first, end in edges.reshape(-1, 2)]
