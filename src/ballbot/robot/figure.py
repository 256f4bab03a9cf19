"""A robot drawn to scale for print: side view and top view with its main dimensions (matplotlib)."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Ellipse, Polygon, Rectangle
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.files import write_bytes
from ballbot.robot.components import Wheels
from ballbot.robot.drawing import (
    PROJECTIONS,
    TOWARDS_EYE,
    BodyShape,
    View,
    WheelShape,
    back_to_front,
    body_shape,
    extent,
    row_offsets,
    wheel_shapes,
)
from ballbot.robot.robot import Robot

_INK = "#22303c"
_BALL = "#e2a458"
_BODY = "#7d93a6"
_HUB = "#b9c4cd"
_ROLLER = "#3f5161"
_MEASURE = "#b3372f"


def robot_figure(robot: Robot) -> Figure:
    """Return a figure of the robot seen from its right and from above, both to one scale.

    The body appears as its two discs of equal mass (see `ballbot.robot.drawing`), because a robot file does not
    hold its shape. The figure belongs to no window; save it with `figure.savefig`.
    """
    side, top = _window(robot, "side"), _window(robot, "top")
    widths = [side[1] - side[0], top[1] - top[0]]
    height = max(side[3] - side[2], top[3] - top[2])
    scale = min(7.2 / sum(widths), 5.2 / height)  # inches a metre, to fit a page's text
    figure = Figure(figsize=(scale * sum(widths), scale * height))
    figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=1.0, wspace=0.0)
    grid = figure.add_gridspec(1, 2, width_ratios=widths)
    _draw_side(figure.add_subplot(grid[0]), robot, side)
    _draw_top(figure.add_subplot(grid[1]), robot, top)
    return figure


def save_robot_figure(robot: Robot, path: str | Path) -> None:
    """Write the robot's figure as .svg, .pdf or .png, whole or not at all.

    Raises
    ------
    InputError
        If the ending is another, or the file cannot be written.
    """
    path = Path(path)
    kind = path.suffix.removeprefix(".").lower()
    if kind not in ("svg", "pdf", "png"):
        raise InputError(f"{path} does not end in a figure format; use .svg, .pdf or .png.")
    picture = io.BytesIO()
    robot_figure(robot).savefig(picture, format=kind, dpi=200)
    write_bytes(path, picture.getvalue())


def _window(robot: Robot, view: View) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top [m] of a panel: the drawing with room for its dimensions."""
    left, right, bottom, top = extent(robot, view)
    room = 0.32 * (right - left)
    over, under = (0.35 * room, 0.35 * room) if view == "side" else (room, room)
    return left - room, right + room, bottom - under, top + over


def _panel(axes: Axes, window: tuple[float, float, float, float]) -> None:
    left, right, bottom, top = window
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    axes.set_axis_off()


def _draw_side(axes: Axes, robot: Robot, window: tuple[float, float, float, float]) -> None:
    _panel(axes, window)
    r_b, l = robot.ball.radius, robot.body.center_of_mass  # noqa: E741 (the thesis's symbol)
    shape = body_shape(robot.body)
    axes.axhspan(window[2], -r_b, color="#e9edf0", zorder=0)
    axes.axhline(-r_b, color=_INK, linewidth=1.0, zorder=1)
    wheels = wheel_shapes(robot)
    order = back_to_front(wheels, "side")
    for depth, index in enumerate(order):
        behind = float(wheels[index].center @ TOWARDS_EYE["side"]) < -1e-9
        _draw_wheel(axes, wheels[index], robot.wheels, "side", zorder=(1.0 if behind else 4.0) + 0.1 * depth)
    axes.add_patch(Circle((0.0, 0.0), r_b, facecolor=_BALL, edgecolor=_INK, linewidth=1.0, zorder=3))
    _draw_body_side(axes, shape)
    _mark_center_of_mass(axes, (0.0, l))
    _mark_dimensions(axes, robot, shape)
    _mark_tilt(axes, robot)
    _mark_axes(axes, (window[0], window[3] - 0.25 * (window[1] - window[0])), ("x", "z"))


def _draw_body_side(axes: Axes, shape: BodyShape) -> None:
    width, height = 2.0 * shape.radius, shape.top - shape.bottom
    axes.add_patch(
        Rectangle((-shape.radius, shape.bottom), width, height, facecolor=_BODY, alpha=0.12, zorder=6)
    )
    axes.add_patch(
        Rectangle(
            (-shape.radius, shape.bottom),
            width,
            height,
            fill=False,
            edgecolor=_BODY,
            linestyle="--",
            zorder=6,
        )
    )
    for level in (shape.bottom, shape.top):
        axes.plot([-shape.radius, shape.radius], [level, level], color=_BODY, linewidth=3.0, zorder=6)
    note = "body as two discs of\nits mass and inertia"
    axes.text(0.0, shape.top - 0.02, note, color=_BODY, fontsize=6.5, ha="center", va="top", zorder=7)


def _draw_top(axes: Axes, robot: Robot, window: tuple[float, float, float, float]) -> None:
    _panel(axes, window)
    shape = body_shape(robot.body)
    axes.add_patch(
        Circle((0.0, 0.0), robot.ball.radius, facecolor=_BALL, edgecolor=_INK, linewidth=1.0, zorder=1)
    )
    wheels = wheel_shapes(robot)
    for depth, index in enumerate(back_to_front(wheels, "top")):
        _draw_wheel(axes, wheels[index], robot.wheels, "top", zorder=2.0 + 0.1 * depth)
    axes.add_patch(Circle((0.0, 0.0), shape.radius, facecolor=_BODY, alpha=0.12, zorder=6))
    axes.add_patch(Circle((0.0, 0.0), shape.radius, fill=False, edgecolor=_BODY, linestyle="--", zorder=6))
    _mark_center_of_mass(axes, (0.0, 0.0))
    reach = max(robot.ball.radius + robot.wheels.radius, shape.radius)
    for number, azimuth in enumerate(robot.wheels.azimuths, start=1):
        outward = np.array([math.cos(azimuth), math.sin(azimuth)])
        ray = np.outer([0.0, reach + 0.035], outward)
        axes.plot(ray[:, 0], ray[:, 1], color=_MEASURE, linewidth=0.7, linestyle=":", zorder=7)
        place = (reach + 0.07) * outward
        label = f"{number}\n{math.degrees(azimuth):.4g}°"
        axes.text(place[0], place[1], label, color=_INK, fontsize=8, ha="center", va="center", zorder=8)
    _mark_axes(axes, (window[0], window[2]), ("x", "y"))


def _draw_wheel(axes: Axes, wheel: WheelShape, wheels: Wheels, view: View, *, zorder: float) -> None:
    """Draw hub and rollers, the parts nearer to the eye over those further away."""
    hub_radius = max(wheels.radius - wheels.rollers.radius, 0.5 * wheels.radius)
    hub = hub_radius**2 * (np.outer(wheel.contact, wheel.contact) + np.outer(wheel.rolling, wheel.rolling))
    hub_thickness = 0.5 * (np.ptp(row_offsets(wheels)) + wheels.rollers.radius)
    hub += hub_thickness**2 * np.outer(wheel.axle, wheel.axle)
    parts = [(wheel.center, hub, _HUB)]
    parts += [(center, shape, _ROLLER) for center, shape in _rollers(wheel, wheels)]
    parts.sort(key=lambda part: float(part[0] @ TOWARDS_EYE[view]))
    for depth, (center, shape, color) in enumerate(parts):
        patch = _silhouette(center, shape, view)
        patch.set(facecolor=color, edgecolor="white", linewidth=0.4, zorder=zorder + 0.001 * depth)
        axes.add_patch(patch)


def _rollers(wheel: WheelShape, wheels: Wheels) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return centre (3,) [m] and shape matrix (3, 3) [m^2] of each roller, as the twin builds them.

    An ellipsoid {c + p: p^T S^-1 p <= 1} of half length sqrt(r_w r_roller) follows the wheel's circle at its
    middle; every second row is turned by half a pitch.
    """
    radius, per_row = wheels.rollers.radius, wheels.rollers.per_row
    found = []
    for row, offset in enumerate(row_offsets(wheels)):
        for place in range(per_row):
            angle = 2.0 * math.pi * (place + 0.5 * (row % 2)) / per_row
            outward = -math.cos(angle) * wheel.contact + math.sin(angle) * wheel.rolling
            along = np.cross(wheel.axle, outward)
            center = wheel.center + (wheels.radius - radius) * outward + offset * wheel.axle
            half_length_squared = wheels.radius * radius
            shape = radius**2 * np.eye(3) + (half_length_squared - radius**2) * np.outer(along, along)
            found.append((center, shape))
    return found


def _silhouette(center: NDArray[np.float64], shape: NDArray[np.float64], view: View) -> Ellipse:
    """Return the ellipse that an ellipsoid's shadow on the paper is: P S P^T."""
    projection = PROJECTIONS[view]
    squares, axes = np.linalg.eigh(projection @ shape @ projection.T)
    width, height = 2.0 * np.sqrt(np.maximum(squares, 0.0))
    x, y = projection @ center
    angle = math.degrees(math.atan2(axes[1, 0], axes[0, 0]))
    return Ellipse((float(x), float(y)), float(width), float(height), angle=angle)


def _mark_center_of_mass(axes: Axes, place: tuple[float, float]) -> None:
    x, y = place
    size = 0.011
    axes.add_patch(Circle(place, size, facecolor="white", edgecolor=_INK, linewidth=1.0, zorder=9))
    for quarter in (0, 2):
        corner = [(x, y)] + [
            (x + size * math.cos(angle), y + size * math.sin(angle))
            for angle in np.linspace(quarter * math.pi / 2.0, (quarter + 1) * math.pi / 2.0, 13)
        ]
        axes.add_patch(Polygon(corner, facecolor=_INK, zorder=10))


def _mark_dimensions(axes: Axes, robot: Robot, shape: BodyShape) -> None:
    r_b, height = robot.ball.radius, robot.body.center_of_mass
    reach = max(shape.radius, (r_b + robot.wheels.radius) * math.sin(robot.wheels.tilt) + robot.wheels.radius)
    right, left = reach + 0.02, -reach - 0.02
    _measure(axes, right, 0.0, height, f"l = {1000.0 * height:.4g} mm")
    _measure(axes, left, -r_b, r_b, f"2 r$_b$ = {2000.0 * r_b:.4g} mm")
    for level, end in ((0.0, right), (height, right), (r_b, left), (-r_b, left)):
        axes.plot([0.0, end], [level, level], color=_MEASURE, linewidth=0.5, linestyle=":", zorder=7)


def _measure(axes: Axes, x: float, low: float, high: float, text: str) -> None:
    """Draw an upright dimension arrow with its text on the outer side."""
    style = {"arrowstyle": "<->", "color": _MEASURE, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x, low), (x, high), arrowprops=style, zorder=8)
    outwards = math.copysign(0.022, x)
    axes.text(
        x + outwards,
        0.5 * (low + high),
        text,
        color=_MEASURE,
        fontsize=8,
        rotation=90,
        ha="center",
        va="center",
    )


def _mark_tilt(axes: Axes, robot: Robot) -> None:
    """Draw the tilt where a wheel's contact lies in the plane of the paper, in front or behind the ball."""
    flat = [azimuth for azimuth in robot.wheels.azimuths if abs(math.sin(azimuth)) < 1e-6]
    if not flat:
        return
    ahead = math.cos(flat[0]) > 0.0
    tilt, r_b = robot.wheels.tilt, robot.ball.radius
    sideways = r_b * math.sin(tilt) * (1.0 if ahead else -1.0)
    lines = ([0.0, sideways], [0.0, r_b * math.cos(tilt)]), ([0.0, 0.0], [0.0, r_b])
    for xs, ys in lines:
        axes.plot(xs, ys, color=_INK, linewidth=0.8, zorder=5)
    lean = math.degrees(tilt)
    start, end = (90.0 - lean, 90.0) if ahead else (90.0, 90.0 + lean)
    axes.add_patch(
        Arc((0.0, 0.0), 0.9 * r_b, 0.9 * r_b, theta1=start, theta2=end, color=_INK, linewidth=0.8, zorder=5)
    )
    middle = math.radians(0.5 * (start + end))
    place = 0.62 * r_b * np.array([math.cos(middle), math.sin(middle)])
    axes.text(place[0], place[1], f"{lean:.4g}°", color=_INK, fontsize=7, ha="center", va="center", zorder=5)


def _mark_axes(axes: Axes, corner: tuple[float, float], names: tuple[str, str]) -> None:
    origin, length = np.array(corner) + 0.02, 0.045
    for name, direction in zip(names, np.eye(2), strict=True):
        tip, place = origin + length * direction, origin + (length + 0.015) * direction
        style = {"arrowstyle": "-|>", "color": _INK, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", tuple(tip), tuple(origin), arrowprops=style, zorder=8)
        axes.text(place[0], place[1], name, color=_INK, fontsize=8, ha="center", va="center", zorder=8)
