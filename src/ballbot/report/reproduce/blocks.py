"""Block diagrams: boxes with words, and arrows along straight lines. Coordinates are shares of the figure."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from ballbot.report.style import INK, SHADE

Point = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Block:
    """A box."""

    text: str
    at: Point  #: its middle
    size: Point  #: width and height


@dataclass(frozen=True, kw_only=True)
class Arrow:
    """A line from point to point, with a head at its end."""

    path: tuple[Point, ...]
    label: str = ""  #: beside the first stretch
    both_ways: bool = False


@dataclass(frozen=True, kw_only=True)
class Diagram:
    """Boxes and arrows."""

    size: Point  #: [inch]
    blocks: tuple[Block, ...]
    arrows: tuple[Arrow, ...]


def blocks_figure(diagram: Diagram) -> Figure:
    """Return a block diagram."""
    figure = Figure(figsize=diagram.size)
    axes = figure.add_axes((0.01, 0.02, 0.98, 0.96))
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.set_axis_off()
    for arrow in diagram.arrows:
        _draw_arrow(axes, arrow)
    for block in diagram.blocks:
        (x, y), (width, height) = block.at, block.size
        axes.add_patch(
            FancyBboxPatch(
                (x - 0.5 * width, y - 0.5 * height),
                width,
                height,
                boxstyle="round,pad=0,rounding_size=0.01",
                facecolor=SHADE,
                edgecolor=INK,
                linewidth=1.0,
            )
        )
        axes.text(x, y, block.text, ha="center", va="center", fontsize=8.5, color=INK)
    return figure


def _draw_arrow(axes: Axes, arrow: Arrow) -> None:
    *bends, last, end = arrow.path
    if bends:
        points = [*bends, last]
        axes.plot([x for x, _ in points], [y for _, y in points], color=INK, linewidth=1.0)
    style = "<|-|>" if arrow.both_ways else "-|>"
    axes.add_patch(
        FancyArrowPatch(
            last, end, arrowstyle=style, mutation_scale=9, color=INK, linewidth=1.0, shrinkA=0, shrinkB=0
        )
    )
    if arrow.label:
        (x0, y0), (x1, y1) = arrow.path[:2]
        axes.text(
            0.5 * (x0 + x1),
            0.5 * (y0 + y1) + 0.02,
            arrow.label,
            ha="center",
            va="bottom",
            fontsize=9,
            color=INK,
        )
