"""What several figures draw: block diagrams, quantities over time, the paths of runs over the floor, and the robot.

A block diagram is boxes with words, and arrows along straight lines; its coordinates are fractions of the figure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch
from numpy.typing import NDArray

from ballbot.log import Log
from ballbot.mechanics.parameters import Formulation
from ballbot.report.palette import GREEN, INK, MUTED, SHADE
from ballbot.report.style import REFERENCE, STATE_SYMBOLS, STATE_UNITS, LineStyle, thinned, with_peaks
from ballbot.robot import Robot
from ballbot.robot.figure import robot_figure
from ballbot.workflows.metrics import true_place

Point = tuple[float, float]
#: text, middle, and width and height
Block = tuple[str, Point, Point]


@dataclass(frozen=True, kw_only=True)
class Arrow:
    """A line from point to point, with a head at its end."""

    path: tuple[Point, ...]
    label: str = ""  #: beside the first stretch
    both_ways: bool = False


def blocks_figure(blocks: Sequence[Block], arrows: Sequence[Arrow], *, height: float) -> Figure:
    """Return a block diagram that is 4 inches wide and so many inches high."""
    figure = Figure(figsize=(4.0, height))
    axes = figure.add_axes((0.01, 0.02, 0.98, 0.96))
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.set_axis_off()
    for arrow in arrows:
        _draw_arrow(axes, arrow)
    for text, (x, y), (wide, high) in blocks:
        corner, style = (x - 0.5 * wide, y - 0.5 * high), "round,pad=0,rounding_size=0.01"
        axes.add_patch(
            FancyBboxPatch(corner, wide, high, boxstyle=style, facecolor=SHADE, edgecolor=INK, linewidth=1.0)
        )
        axes.text(x, y, text, ha="center", va="center", fontsize=8.5, color=INK)
    return figure


def _draw_arrow(axes: Axes, arrow: Arrow) -> None:
    *bends, last, end = arrow.path
    axes.plot(*zip(*bends, last, strict=True), color=INK, linewidth=1.0)
    style = "<|-|>" if arrow.both_ways else "-|>"
    axes.add_patch(
        FancyArrowPatch(
            last, end, arrowstyle=style, mutation_scale=9, color=INK, linewidth=1.0, shrinkA=0, shrinkB=0
        )
    )
    (x0, y0), (x1, y1) = arrow.path[:2]
    upright = x0 == x1
    x, y = 0.5 * (x0 + x1) + 0.02 * upright, 0.5 * (y0 + y1) + 0.02 * (not upright)
    across, above = ("left", "center") if upright else ("center", "bottom")
    axes.text(x, y, arrow.label, ha=across, va=above, fontsize=9, color=INK)


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


#: label, time [s], values and style
Curve = tuple[str, NDArray[np.float64], NDArray[np.float64], LineStyle]


def panels_figure(panels: Sequence[tuple[str, Sequence[Curve]]], *, columns: int = 1) -> Figure:
    """Return curves over time, a panel for each label of an axis; the first panel's names are the legend's."""
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(7.4, 0.5 + 1.45 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for axes, (label, curves) in zip(grid.flat, panels, strict=True):
        for name, t, values, line in curves:
            axes.plot(*with_peaks(t, values), label=name, **line)
        axes.set_ylabel(label)
        axes.margins(x=0.0)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 4))
    return figure


def state_panels(
    runs: Sequence[Shown], names: Sequence[str], *, end: float = np.inf, note: str = ""
) -> list[tuple[str, list[Curve]]]:
    """Return the panels of states of some runs up to a time [s], with the reference where there is one."""
    panels = []
    for name in names:
        reference = f"ref_{name}"
        columns = [(one.label, one.log, name, one.line) for one in runs]
        if reference in runs[0].log:
            columns.insert(0, ("reference", runs[0].log, reference, REFERENCE))
        rows = [log.t <= end for _, log, _, _ in columns]
        curves = [
            (label, log.t[row], log[column][row], line)
            for row, (label, log, column, line) in zip(rows, columns, strict=True)
        ]
        panels.append((f"{STATE_SYMBOLS[name]}{note} [{STATE_UNITS[name]}]", curves))
    return panels


def paths_figure(runs: Sequence[Shown], *, ball_radius: float, goal: bool) -> Figure:
    """Return paths over the floor, with the ball for size; and the reference's two places and the way between."""
    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes = figure.subplots()
    ends = np.column_stack([runs[0].log["ref_x"], runs[0].log["ref_y"]])[[0, -1]]
    if goal:
        axes.plot(*ends.T, label="reference", marker="s", markersize=4, **REFERENCE)
    for run in runs:
        truth = true_place(run.log)
        axes.plot(*thinned(truth["x"], truth["y"]), label=run.label, **run.line)
    x, y = map(float, ends[-1])
    ball = Circle(
        (x, y), ball_radius, facecolor="none", edgecolor=MUTED, linewidth=0.9, linestyle=(0, (4, 2))
    )
    axes.add_patch(ball)
    axes.text(x, y - 1.1 * ball_radius, "the ball", ha="center", va="top", fontsize=7.5, color=INK)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="$x$ [m]", ylabel="$y$ [m]")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def coordinates_figure(robot: Robot) -> Figure:
    """Return the robot to scale from its right and from above, with x, y, z and theta, phi, psi."""
    figure = robot_figure(robot)
    side, top = figure.axes[:2]
    r = robot.ball.radius
    for axes, up, into, length in ((side, "$z$", "$y$, away", 2.4 * r), (top, "$y$", "$z$, up", 1.9 * r)):
        _draw_turn(axes, (0.0, 0.0), (length, 0.0), "$x$", bend=0.0)
        _draw_turn(axes, (0.0, 0.0), (0.0, length), up, bend=0.0)
        axes.plot(0.0, 0.0, "o", markersize=6, markerfacecolor="white", color=INK, zorder=21)
        axes.annotate(
            into, (0.0, 0.0), (-7, -13), textcoords="offset points", ha="right", fontsize=9, zorder=21
        )
    # seen along +y, a turn about y goes from z to x; theta's, about x, is seen from its edge
    _draw_turn(side, (0.1 * r, 1.9 * r), (1.0 * r, 1.65 * r), r"$\varphi$", bend=-0.25)
    _draw_turn(top, (1.8 * r, 0.6 * r), (0.9 * r, 1.6 * r), r"$\psi$", bend=0.25)
    _draw_turn(top, (-1.75 * r, -0.5 * r), (-1.75 * r, 0.5 * r), r"$\theta$", bend=0.5)
    return figure


def _draw_turn(axes: Axes, start: Point, end: Point, label: str, *, bend: float) -> None:
    """Draw an arrow, straight or bent, with its label at its end."""
    arrow = FancyArrowPatch(
        start,
        end,
        connectionstyle=f"arc3,rad={bend}",
        arrowstyle="-|>",
        mutation_scale=12,
        color=INK,
        linewidth=1.4,
        shrinkA=0,
        shrinkB=0,
        zorder=20,
        clip_on=False,
    )
    axes.add_patch(arrow)
    axes.annotate(label, end, (-9, -9), textcoords="offset points", ha="center", fontsize=11, zorder=20)
