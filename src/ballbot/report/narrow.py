"""Figures for narrow pages, such as a phone's: panels that stand side by side are placed one below another.

On a phone the text of a figure that is `NARROW` inches wide can be read; that of a figure as wide as a printed page
cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.legend import Legend

#: [in]; on a page 358 px wide its text of 8.5 points is 10.6 px tall, and the numbers along its axes 9.3 px
NARROW = 4.0
#: height of a panel as wide as the page, relative to the height that it had beside another
_LOWER = 0.8


@dataclass(frozen=True, kw_only=True)
class _Place:
    """A panel: where it was, and where it goes."""

    axes: Axes
    row: int
    column: int
    new_row: int
    new_column: int


def make_narrow(figure: Figure) -> None:
    """Make a figure `NARROW` inches wide: its panels in one column, or in two if it had more than two.

    Legends beside the panels have as many columns as fit.
    """
    _narrow_panels(figure)
    for legend in tuple(figure.legends):
        _fold(figure, legend)


def _fold(figure: Figure, legend: Legend) -> None:
    """Give a legend fewer columns until it is no wider than the figure, which grows by what it gets higher."""
    figure.draw_without_rendering()
    first = legend.get_window_extent()
    above = first.y0 + first.y1 > figure.bbox.y0 + figure.bbox.y1
    handles = [one for one in legend.legend_handles if one is not None]
    labels = [text.get_text() for text in legend.get_texts()]
    columns = len(labels)
    while columns > 1 and legend.get_window_extent().width > figure.bbox.width:
        columns -= 1
        legend.remove()
        place = "outside upper center" if above else "outside lower center"
        legend = figure.legend(handles, labels, loc=place, ncols=columns)
        figure.draw_without_rendering()
    higher = (legend.get_window_extent().height - first.height) / figure.dpi
    figure.set_size_inches(NARROW, figure.get_figheight() + max(0.0, higher))


def _narrow_panels(figure: Figure) -> None:
    width, height = figure.get_size_inches()
    for axes in [one for one in figure.axes if not one.get_visible()]:
        axes.remove()
    grid = _grid_of(figure.axes)
    square = any(axes.get_aspect() != "auto" for axes in figure.axes)
    if grid is None or figure.get_layout_engine() is None:
        figure.set_size_inches(NARROW, height * NARROW / width)
        return
    if grid.ncols == 1:
        figure.set_size_inches(NARROW, height * NARROW / width if square else height)
        return
    places = _places(figure.axes, grid)
    rows = 1 + max(one.new_row for one in places)
    columns = 1 + max(one.new_column for one in places)
    old_ratios = np.array(grid.get_height_ratios(), dtype=np.float64)
    ratios = np.ones(rows)
    for one in places:
        ratios[one.new_row] = old_ratios[one.row :][: _rows_of(one.axes)].sum()
    made = figure.add_gridspec(rows, columns, height_ratios=ratios.tolist())
    for one in places:
        one.axes.set_subplotspec(made[one.new_row, one.new_column])
    factor = _LOWER if columns == 1 else 1.0
    figure.set_size_inches(NARROW, factor * height * ratios.sum() / old_ratios.sum())
    _label(places)


def _grid_of(panels: Sequence[Axes]) -> GridSpec | None:
    """Return the grid that all panels are in, or None if they are in none or in several."""
    specs = [axes.get_subplotspec() for axes in panels]
    grids = {spec.get_gridspec() for spec in specs if spec is not None}
    if len(grids) != 1 or None in specs:
        return None
    (grid,) = grids
    return grid if isinstance(grid, GridSpec) else None


def _rows_of(axes: Axes) -> int:
    spec = axes.get_subplotspec()
    return 1 if spec is None else len(spec.rowspan)


def _places(panels: Sequence[Axes], grid: GridSpec) -> list[_Place]:
    """Return where each panel goes."""
    columns = 1 if grid.ncols == 2 else 2
    pairs = bool(np.ptp(grid.get_height_ratios()))  # panels that belong to those above them
    spans = any(_rows_of(axes) > 1 for axes in panels)
    places = []
    for axes in panels:
        spec = axes.get_subplotspec()
        assert spec is not None
        row, column = spec.rowspan.start, spec.colspan.start
        if spans:  # a panel beside several: above them
            new = (column + row, 0)
        elif pairs:
            new = (column // columns * grid.nrows + row, column % columns)
        elif columns == 2 and grid.nrows == 2:
            new = (column, row)
        else:
            new = divmod(row * grid.ncols + column, columns)
        places.append(_Place(axes=axes, row=row, column=column, new_row=new[0], new_column=new[1]))
    return places


def _label(places: Sequence[_Place]) -> None:
    """Move the labels of the axes to the panels that are now at the left and at the bottom."""
    last = {
        one.new_column: max(each.new_row for each in places if each.new_column == one.new_column)
        for one in places
    }
    first_axes = places[0].axes
    together = all(first_axes.get_shared_x_axes().joined(first_axes, one.axes) for one in places)
    across = next((one.axes.get_xlabel() for one in places if one.axes.get_xlabel()), "")
    along = {one.row: one.axes.get_ylabel() for one in places if one.column == 0}
    for one in places:
        axes = one.axes
        if axes.name == "polar":
            continue
        if one.new_column == 0:
            axes.tick_params(labelleft=True)
            axes.set_ylabel(axes.get_ylabel() or along.get(one.row, ""))
        elif one.column == 0:
            axes.set_ylabel("")
        if together:
            at_bottom = one.new_row == last[one.new_column]
            axes.tick_params(labelbottom=at_bottom)
            axes.set_xlabel(across if at_bottom else "")
