"""Figure 2.1: the robot's frame and its generalised coordinates."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc

from ballbot.experiments.reproduce.bench import Bench
from ballbot.report.style import INK
from ballbot.robot.figure import robot_figure

_ARROW = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
#: an axis's length, and the radius at which turns are drawn, in ball radii
_AXIS, _TURN = 2.4, 1.9


def figure_2_1(bench: Bench) -> Figure:
    """Return the robot to scale from its right and from above, with x, y, z and theta, phi, psi."""
    figure = robot_figure(bench.robot)
    side, top = figure.axes[:2]
    r = bench.robot.ball.radius
    _axes(side, r, right="$x$", up="$z$", into="$y$, away", length=_AXIS)
    _axes(top, r, right="$x$", up="$y$", into="$z$, up", length=0.8 * _AXIS)
    # seen along +y, a turn about y goes from z to x
    _turn(side, r, r"$\varphi$", start=48.0, end=88.0, towards_start=True)
    _turn(top, r, r"$\psi$", start=18.0, end=60.0, towards_start=False)
    _roll(top, r)
    return figure


def _axes(axes: Axes, r: float, *, right: str, up: str, into: str, length: float) -> None:
    """Draw two axes from the ball's centre, `length` ball radii long, and name the one that is seen end on."""
    for place, label, offset in (((length * r, 0.0), right, (-3, -11)), ((0.0, length * r), up, (-9, 0))):
        axes.annotate("", xy=place, xytext=(0.0, 0.0), arrowprops=_ARROW, zorder=20, annotation_clip=False)
        axes.annotate(
            label, place, offset, textcoords="offset points", ha="center", va="center", fontsize=11, zorder=20
        )
    axes.plot(0.0, 0.0, "o", markersize=6, markerfacecolor="white", color=INK, zorder=21)
    axes.annotate(into, (0.0, 0.0), (-7, -13), textcoords="offset points", ha="right", fontsize=9, zorder=21)


def _turn(axes: Axes, r: float, label: str, *, start: float, end: float, towards_start: bool) -> None:
    """Draw an arc with an arrow at one end, angles in degrees from the panel's right."""
    radius = _TURN * r
    axes.add_patch(
        Arc((0.0, 0.0), 2 * radius, 2 * radius, theta1=start, theta2=end, color=INK, linewidth=1.4, zorder=20)
    )
    tip, before = np.radians([start, start + 6.0] if towards_start else [end, end - 6.0])
    points = [(radius * np.cos(a), radius * np.sin(a)) for a in (tip, before)]
    axes.annotate(
        "",
        xy=points[0],
        xytext=points[1],
        zorder=20,
        arrowprops=_ARROW,
    )
    middle = np.radians(0.5 * (start + end))
    axes.annotate(
        label,
        (1.12 * radius * np.cos(middle), 1.12 * radius * np.sin(middle)),
        ha="center",
        va="center",
        fontsize=12,
        zorder=20,
    )


def _roll(axes: Axes, r: float) -> None:
    """Draw theta's turn about x: a flat ellipse around the axis, its arrow as a right hand turns."""
    place = 1.55 * r
    axes.add_patch(
        Arc((place, 0.0), 0.3 * r, 1.1 * r, theta1=-70.0, theta2=120.0, color=INK, linewidth=1.4, zorder=20)
    )
    tip, before = (np.radians(angle) for angle in (120.0, 108.0))
    points = [(place + 0.15 * r * np.cos(a), 0.55 * r * np.sin(a)) for a in (tip, before)]
    axes.annotate(
        "",
        xy=points[0],
        xytext=points[1],
        zorder=20,
        arrowprops=_ARROW,
    )
    axes.annotate(r"$\theta$", (place, -0.75 * r), ha="center", va="center", fontsize=12, zorder=20)
