"""What several figures draw: block diagrams, states over time of some runs, and their paths over the floor.

A block diagram is boxes with words, and arrows along straight lines; its coordinates are fractions of the figure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch

from ballbot.log import Log
from ballbot.mechanics.parameters import Formulation
from ballbot.report.palette import GREEN, INK, MUTED, SHADE
from ballbot.report.style import REFERENCE, STATE_SYMBOLS, STATE_UNITS, LineStyle, thinned
from ballbot.workflows.metrics import true_place

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
        upright = x0 == x1
        axes.text(
            0.5 * (x0 + x1) + 0.02 * upright,
            0.5 * (y0 + y1) + 0.02 * (not upright),
            arrow.label,
            ha="left" if upright else "center",
            va="center" if upright else "bottom",
            fontsize=9,
            color=INK,
        )


#: the model without friction, by its equations
BASIC_LABELS: Mapping[Formulation, str] = MappingProxyType(
    {"exact": "no friction, exact", "thesis": "no friction, thesis's equations"}
)
THESIS_EQUATIONS: LineStyle = {"color": GREEN, "linestyle": "-.", "linewidth": 1.1}


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """A run as it is drawn."""

    label: str
    log: Log
    line: LineStyle


def states_figure(
    runs: Sequence[Shown], states: Sequence[str], *, start: float, end: float, columns: int = 2
) -> Figure:
    """Return states over time from `start` to `end` [s], a panel each, with the reference where there is one."""
    rows = -(-len(states) // columns)
    figure = Figure(figsize=(7.4, 0.5 + 1.45 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for axes, name in zip(panels, states, strict=False):
        draw_state(axes, runs, name, start=start, end=end)
        axes.set_ylabel(f"{STATE_SYMBOLS[name]} [{STATE_UNITS[name]}]")
    for axes in panels[len(states) :]:
        axes.set_visible(False)
    # the lowest panel of each column has the axis, also where the last row is short
    for column in range(columns):
        last = max(index for index in range(len(states)) if index % columns == column)
        panels[last].set_xlabel("time [s]")
        panels[last].tick_params(labelbottom=True)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 4))
    return figure


def draw_state(axes: Axes, runs: Sequence[Shown], name: str, *, start: float, end: float) -> None:
    """Draw a state of some runs from `start` to `end` [s], with the reference where there is one."""
    _reference(axes, runs[0].log, name, start, end)
    for run in runs:
        rows = (run.log.t >= start) & (run.log.t <= end)
        axes.plot(*thinned(run.log.t[rows], run.log[name][rows]), label=run.label, **run.line)
    axes.set_xlim(start, end)


def paths_figure(runs: Sequence[Shown], *, ball_radius: float, goal: bool) -> Figure:
    """Return paths over the floor, with the ball for size; and the reference's two places and the way between."""
    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes = figure.subplots()
    place = runs[0].log
    if goal:
        ends = [0, -1]
        axes.plot(
            place["ref_x"][ends],
            place["ref_y"][ends],
            label="reference",
            marker="s",
            markersize=4,
            **REFERENCE,
        )
    for run in runs:
        truth = true_place(run.log)
        axes.plot(*thinned(truth["x"], truth["y"]), label=run.label, **run.line)
    where = (float(place["ref_x"][-1]), float(place["ref_y"][-1]))
    axes.add_patch(
        Circle(where, ball_radius, facecolor="none", edgecolor=MUTED, linewidth=0.9, linestyle=(0, (4, 2)))
    )
    below = (where[0], where[1] - ball_radius)
    axes.annotate(
        "the ball",
        below,
        (0, -3),
        textcoords="offset points",
        ha="center",
        va="top",
        fontsize=7.5,
        color=INK,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
        zorder=3,
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="$x$ [m]", ylabel="$y$ [m]")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def _reference(axes: Axes, log: Log, name: str, start: float, end: float) -> None:
    column = f"ref_{name}"
    if column in log:
        rows = (log.t >= start) & (log.t <= end)
        axes.plot(*thinned(log.t[rows], log[column][rows]), label="reference", **REFERENCE)
