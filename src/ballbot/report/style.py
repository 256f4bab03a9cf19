"""How the report's figures look, and how they become part of the page.

Every line has its own dash or weight as well as its own colour, so that a page printed in grey reads the same.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, TypedDict, TypeVar, TypeVarTuple
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ballbot.arrays import Floats
from ballbot.log import STATE_NAMES
from ballbot.log.columns import unit_of
from ballbot.printable import printable, printable_line
from ballbot.report.blocks import Picture
from ballbot.report.palette import AXIS, BLUE, GREEN, GRID, INK, MUTED, ORANGE, PALE, VIOLET, YELLOW
from ballbot.report.series import Look, TimeSeries

if TYPE_CHECKING:  # of matplotlib 3.10
    from matplotlib.typing import RcKeyType


class LineStyle(TypedDict):
    """How a line is drawn."""

    color: str
    linestyle: str
    linewidth: float


#: lines of figures, as `web/charts.js` draws those of time series
LOOKS: Mapping[Look, LineStyle] = {
    "measured": {"color": INK, "linestyle": "-", "linewidth": 1.6},
    "first": {"color": BLUE, "linestyle": "-", "linewidth": 1.3},
    "second": {"color": ORANGE, "linestyle": "--", "linewidth": 1.3},
    "third": {"color": GREEN, "linestyle": "-.", "linewidth": 1.3},
    "fourth": {"color": VIOLET, "linestyle": ":", "linewidth": 1.4},
    "fifth": {"color": YELLOW, "linestyle": "-", "linewidth": 1.1},
    "sixth": {"color": INK, "linestyle": "--", "linewidth": 1.1},
    "reference": {"color": PALE, "linestyle": "-", "linewidth": 2.4},
    "quiet": {"color": MUTED, "linestyle": "-", "linewidth": 0.7},
}
#: marks of looks `IN_TURN`
MARKS = ("o", "s", "^", "D", "v", "P")

T = TypeVar("T")
Given = TypeVarTuple("Given")

_LETTERS = {"x": "x", "y": "y", "theta": r"\theta", "phi": r"\varphi", "psi": r"\psi"}
#: the symbols of the states as the thesis prints them, and their units
STATE_SYMBOLS: Mapping[str, str] = {name: f"${letter}$" for name, letter in _LETTERS.items()} | {
    f"{name}_dot": rf"$\dot{{{letter}}}$" for name, letter in _LETTERS.items()
}
STATE_UNITS: Mapping[str, str] = {name: str(unit_of(name)) for name in STATE_NAMES}

#: most points of a line: more than a page's width in printed dots adds bytes and shows no more
_MOST_POINTS = 900

_RC: dict[RcKeyType, object] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.color": INK,
    "legend.labelcolor": INK,
    "axes.edgecolor": AXIS,
    "axes.labelcolor": INK,
    "axes.titlesize": 9,
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.solid_capstyle": "round",
    # gaps as wide as these show on a line that goes up and down
    "lines.dashed_pattern": (5.0, 3.5),
    "lines.dashdot_pattern": (7.0, 2.5, 1.5, 2.5),
    "lines.dotted_pattern": (1.3, 2.4),
    "mathtext.fontset": "dejavusans",
    "svg.fonttype": "path",
    "svg.hashsalt": "ballbot",
    "path.simplify_threshold": 0.3,
}


def drawn(draw: Callable[[], Figure], *, name: str) -> str:
    """Return a figure, which belongs to no window, as an SVG element; `name` keeps the inner names of figures apart."""
    return _drawn(draw, name)[0]


def _drawn(draw: Callable[[], Figure], name: str) -> tuple[str, Figure]:
    """Return a figure as an SVG element, and the figure."""
    with mpl.rc_context(_RC), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # of a name; a box stands for it
        figure = draw()
        svg = _svg(figure)
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\b(id=")', rf"\g<1>{name}-", svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{name}-", svg)
    # a figure of 7.4 inches is as wide as the page's text, 46 rem; the view box keeps the proportions
    width = f"{figure.get_figwidth() / 7.4 * 552.0:.0f}pt"
    size = f' width="{width}" style="--natural:{width}"'  # the attribute for viewers of the file alone
    svg = re.sub(r' width="[\d.]+pt" height="[\d.]+pt"', size, svg, count=1)
    return re.sub(r"\s*\n\s*", "\n", svg), figure


def _data_rows(figure: Figure) -> list[str]:
    """Return a row of panel, line, x and y for each point that a figure draws in the coordinates of its axes."""
    rows: list[str] = []
    for number, axes in enumerate(figure.axes, start=1):
        lines: list[tuple[Artist, Floats]] = [
            (line, np.column_stack([line.get_xdata(), line.get_ydata()]).astype(np.float64))
            for line in axes.lines
        ]
        for collection in axes.collections:
            lines += [
                (collection, np.asarray(path.vertices, dtype=np.float64)) for path in collection.get_paths()
            ]
        panel = _plain(axes.get_title(loc="left") or axes.get_title() or str(number))
        for count, (line, points) in enumerate(lines, start=1):
            if not line.get_transform().contains_branch(axes.transData):
                continue
            label = str(line.get_label())
            words = str(count) if label.startswith("_") else _plain(label)
            known = points[np.isfinite(points).all(axis=1)][:: 1 + len(points) // 400]
            rows += [f"{panel},{words},{x:.5g},{y:.5g}" for x, y in known.tolist()]
    return rows


def _plain(words: str) -> str:
    """Return a text without the marks of a formula, as a cell of a table."""
    return re.sub(r"[$\\{}]", "", printable_line(words)).replace(",", ";").strip()


def plotted(draw: Callable[[T], Figure], value: T) -> Figure:
    """Draw a figure in the report's style for a caller of its own; a notebook shows it by itself."""
    with mpl.rc_context(_RC):
        figure = draw(value)
    # IPython asks an object for this; it shows figures by itself only if they belong to pyplot
    vars(figure)["_repr_svg_"] = partial(_svg, figure)
    return figure


def drawn_picture(name: str, caption: str, draw: Callable[[*Given], Figure], *given: *Given) -> Picture:
    """Return for a page the figure that `draw` makes of what is given, with a link that saves its data."""

    def markup() -> str:
        svg, figure = _drawn(lambda: draw(*given), name)
        if not (rows := _data_rows(figure)):
            return svg
        table = quote("\n".join(("panel,line,x,y", *rows)), safe=", .-+")
        return f'{svg}<a class="data" download="{name}.csv" href="data:text/csv,{table}">CSV</a>'

    return Picture(markup, caption)


def one_panel(across: str, up: str, *, height: float = 3.4, width: float = 7.4) -> tuple[Figure, Axes]:
    """Return a figure [in] of one panel, with the labels of its axes."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=across, ylabel=up)
    return figure, axes


def series_figure(series: TimeSeries) -> Figure:
    """Return time series as a figure."""
    figure = Figure(figsize=(7.4, 0.6 + 1.4 * len(series.panels)), layout="constrained")
    rows = figure.subplots(len(series.panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(rows, series.panels, strict=True):
        for line in panel.lines:
            axes.plot(*thinned(series.t, line.values), label=line.name, **LOOKS[line.look])
        axes.set_ylabel(panel.label)
        axes.margins(x=0.01)
        if len(panel.lines) > 1:
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(panel.lines), borderpad=0.0)
    rows[-1].set_xlabel(series.across)
    return figure


def _svg(figure: Figure) -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return printable(buffer.getvalue())  # texts stand in comments, too


def label_of(name: str) -> str:
    r"""Return a user's name for a log or a controller as text of a figure.

    Unchanged, `$\frac$` would stop the drawing, `_name` would be missing in legends, and a long name would squeeze the
    axes.
    """
    shown = printable_line(name)
    if len(shown) > 40:
        shown = f"{shown[:20]}…{shown[-20:]}"
    shown = shown.replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


def thinned(*columns: Floats) -> tuple[Floats, ...]:
    """Return every k-th row of the columns, so that a line has at most `_MOST_POINTS` points."""
    step = max(1, -(-len(columns[0]) // _MOST_POINTS))
    return tuple(column[::step] for column in columns)
