"""A robot drawn to scale for print: side view and top view with its main dimensions (matplotlib)."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from numpy.typing import NDArray

from ballbot.robot.drawing import body_shape, row_offsets, wheel_shapes
from ballbot.robot.robot import Robot

_INK, _BALL, _BODY, _WHEEL, _MEASURE = "#22303c", "#e2a458", "#7d93a6", "#3f5161", "#b3372f"
#: rows: what points right and what points up on paper, and from the paper towards the eye; side is from the right
_SIDE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_TOP = np.eye(3)


def robot_figure(robot: Robot) -> Figure:
    """Return a figure of the robot seen from its right and from above, both to one scale.

    The body appears as its two discs of equal mass (see `ballbot.robot.drawing`), because a robot file does not
    hold its shape. The figure belongs to no window; save it with `figure.savefig`.
    """
    shape, r_b = body_shape(robot.body), robot.ball.radius
    reach = max(shape.radius, max(float(np.abs(rim).max()) for rim in _rims(robot)))
    half = 1.5 * reach
    low, high = -1.5 * r_b, max(shape.top, reach) + 0.15 * reach
    height = max(high - low, 2.0 * half)
    scale = min(7.2 / (4.0 * half), 5.2 / height)  # inches a metre, to fit a page's text
    figure = Figure(figsize=(scale * 4.0 * half, scale * height))
    side, top = figure.add_axes((0.0, 0.0, 0.5, 1.0)), figure.add_axes((0.5, 0.0, 0.5, 1.0))
    middle = 0.5 * (low + high)
    side.set(xlim=(-half, half), ylim=(middle - 0.5 * height, middle + 0.5 * height))
    top.set(xlim=(-half, half), ylim=(-0.5 * height, 0.5 * height))
    for axes, view in ((side, _SIDE), (top, _TOP)):
        axes.set_aspect("equal")
        axes.set_axis_off()
        words = f"wheels tilted by {math.degrees(robot.wheels.tilt):.4g}°; z up" if view is _SIDE else "y up"
        axes.text(
            0.5, 0.01, words, color=_INK, fontsize=7, ha="center", va="bottom", transform=axes.transAxes
        )
        _draw_wheels(axes, robot, view)
        axes.add_patch(Circle((0.0, 0.0), r_b, facecolor=_BALL, edgecolor=_INK, zorder=0.0))
    _draw_side(side, robot, reach)
    _draw_top(top, robot, reach)
    return figure


def _rims(robot: Robot) -> list[NDArray[np.float64]]:
    """Return of each wheel the circles through the outside of its rows of rollers, (rows, 73, 3) [m]."""
    angle = np.linspace(0.0, 2.0 * math.pi, 73)[:, None]
    return [
        wheel.center
        + robot.wheels.radius * (np.cos(angle) * wheel.contact + np.sin(angle) * wheel.rolling)
        + row_offsets(robot.wheels)[:, None, None] * wheel.axle
        for wheel in wheel_shapes(robot)
    ]


def _draw_wheels(axes: Axes, robot: Robot, view: NDArray[np.float64]) -> None:
    """Draw the wheels behind the ball's middle below it, those in front above."""
    for rims, wheel in zip(_rims(robot), wheel_shapes(robot), strict=True):
        depth = float(view[2] @ wheel.center)
        for rim in rims @ view[:2].T:
            axes.add_patch(Polygon(rim, facecolor="#b9c4cd", edgecolor=_WHEEL, linewidth=1.6, zorder=depth))


def _draw_side(axes: Axes, robot: Robot, reach: float) -> None:
    shape, r_b, height = body_shape(robot.body), robot.ball.radius, robot.body.center_of_mass
    axes.axhline(-r_b, color=_INK, linewidth=1.0, zorder=-9.0)
    corner, size = (-shape.radius, shape.bottom), (2.0 * shape.radius, shape.top - shape.bottom)
    axes.add_patch(Rectangle(corner, *size, facecolor=_BODY, edgecolor=_BODY, alpha=0.25, zorder=6.0))
    for level in (shape.bottom, shape.top):
        axes.plot([-shape.radius, shape.radius], [level, level], color=_BODY, linewidth=3.0, zorder=6.0)
    note = "body as two discs of\nits mass and inertia"
    axes.text(0.0, shape.top - 0.02, note, color=_BODY, fontsize=6.5, ha="center", va="top", zorder=7.0)
    axes.plot(0.0, height, "o", markersize=7.0, markerfacecolor="white", markeredgecolor=_INK, zorder=9.0)
    for x, (start, end), text in (
        (1.1 * reach, (0.0, height), f"l = {1000.0 * height:.4g} mm"),
        (-1.1 * reach, (-r_b, r_b), f"2 r$_b$ = {2000.0 * r_b:.4g} mm"),
    ):
        axes.annotate("", (x, start), (x, end), arrowprops={"arrowstyle": "<->", "color": _MEASURE})
        for level in (start, end):
            axes.plot([0.0, x], [level, level], color=_MEASURE, linewidth=0.5, linestyle=":", zorder=7.0)
        position = (1.12 * x, 0.5 * (start + end))
        axes.text(*position, text, color=_MEASURE, fontsize=8, rotation=90, ha="center", va="center")


def _draw_top(axes: Axes, robot: Robot, reach: float) -> None:
    radius = body_shape(robot.body).radius
    axes.add_patch(Circle((0.0, 0.0), radius, fill=False, edgecolor=_BODY, linestyle="--", zorder=6.0))
    for number, azimuth in enumerate(robot.wheels.azimuths, start=1):
        x, y = math.cos(azimuth), math.sin(azimuth)
        ray = np.array([0.0, 1.08 * reach])
        axes.plot(x * ray, y * ray, color=_MEASURE, linewidth=0.7, linestyle=":", zorder=7.0)
        label, far = f"{number}\n{math.degrees(azimuth):.4g}°", 1.25 * reach
        axes.text(far * x, far * y, label, color=_INK, fontsize=8, ha="center", va="center", zorder=8.0)
