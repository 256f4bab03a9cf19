"""Drawings are to scale: measured on the paper, not on the numbers they were made from."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Circle

from ballbot.errors import InputError
from ballbot.robot import Friction, Robot
from ballbot.robot.drawing import (
    Canvas,
    body_shape,
    extent,
    robot_drawing,
    row_offsets,
    wheel_rims,
    wheel_shapes,
)
from ballbot.robot.figure import robot_figure, save_robot_figure

ALTEN = Robot.load("alten")


def four_wheeled() -> Robot:
    azimuths = tuple(math.radians(one) for one in (45.0, 135.0, 225.0, 315.0))
    return ALTEN.replace(
        wheels=dataclasses.replace(ALTEN.wheels, azimuths=azimuths), friction=Friction.none(4)
    )


def test_canvas_sets_the_dots_that_unicode_numbers() -> None:
    # U+2801 is the upper left dot, U+2880 the lower right one
    canvas = Canvas(left=0.0, right=1.0, bottom=-3.0, top=0.0, dot=1.0)
    canvas.curve(np.array([[0.0, 0.0], [0.0, 0.0]]))
    assert canvas.lines()[0][0] == "⠁"
    canvas.curve(np.array([[1.0, -3.0], [1.0, -3.0], [99.0, 99.0]]))
    assert ord(canvas.lines()[0][0]) & 0x2881 == 0x2881


def test_text_drawing_is_to_scale() -> None:
    lines = robot_drawing(ALTEN).splitlines()
    bar = lines[-1].index("| ") + 1
    meters_a_column = 0.2 / bar
    ground = lines[-2].rstrip()
    body_top = lines[1]
    # a character is twice as high as wide; rounding to whole ones may cost two at either end
    shape = body_shape(ALTEN.body)
    height = (len(lines) - 3) * 2.0 * meters_a_column
    assert height == pytest.approx(0.11 + shape.top, abs=4.0 * meters_a_column)
    assert len(ground) * meters_a_column == pytest.approx(2.0 * shape.radius, abs=4.0 * meters_a_column)
    assert body_top.strip()


def test_text_drawing_fits_a_terminal_and_numbers_every_wheel() -> None:
    for robot in (ALTEN, four_wheeled()):
        lines = robot_drawing(robot).splitlines()
        assert max(map(len, lines)) <= 80
        assert len(lines) <= 30
        drawn = "\n".join(lines[1:-1])
        assert set(re.findall(r"\d", drawn)) == {str(i + 1) for i in range(robot.wheel_count)}


def test_the_two_discs_weigh_and_turn_as_the_body_does() -> None:
    # summed over points: a disc of radius R turns as a ring of radius R / sqrt(2) does, of the same mass
    shape, mass = body_shape(ALTEN.body), ALTEN.body.mass
    angle = np.linspace(0.0, 2.0 * math.pi, 100, endpoint=False)
    ring = shape.radius / math.sqrt(2.0) * np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.vstack([np.column_stack([ring, np.full(100, z)]) for z in (shape.bottom, shape.top)])
    central = points - points.mean(axis=0)
    inertia = mass / len(points) * (np.sum(central**2) * np.eye(3) - central.T @ central)
    assert points.mean(axis=0) == pytest.approx([0.0, 0.0, 0.393], abs=1e-12)
    assert inertia == pytest.approx(ALTEN.body.inertia_about_center_of_mass(), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("robot", [ALTEN, four_wheeled()])
def test_wheels_touch_the_ball(robot: Robot) -> None:
    for wheel in wheel_shapes(robot):
        rims = wheel_rims(wheel, robot.wheels)
        offsets = row_offsets(robot.wheels)
        nearest = np.linalg.norm(rims, axis=-1).min(axis=-1)
        # a row beside the wheel's middle passes the ball at that offset from the contact point
        assert nearest == pytest.approx(np.hypot(robot.ball.radius, offsets), rel=1e-12)
        assert np.linalg.norm(rims - rims.mean(axis=1, keepdims=True), axis=-1) == pytest.approx(
            0.063, rel=0.05
        )


def test_side_view_shows_the_ground_and_the_bodys_top() -> None:
    _, _, bottom, top = extent(ALTEN, "side")
    assert bottom == -0.11
    assert top == body_shape(ALTEN.body).top


def test_figure_is_to_scale_in_both_views() -> None:
    figure = robot_figure(ALTEN)
    figure.draw_without_rendering()
    widths = []
    for axes in figure.axes:
        balls = [one for one in axes.patches if isinstance(one, Circle) and one.radius == 0.11]
        assert len(balls) == 1
        box = balls[0].get_window_extent()
        assert box.width == pytest.approx(box.height, rel=1e-6)
        widths.append(box.width)
    assert widths[0] == pytest.approx(widths[1], rel=1e-6)


@pytest.mark.parametrize(("ending", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")])
def test_figures_are_saved(ending: str, begins: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"robot.{ending}"
    save_robot_figure(four_wheeled(), path)
    assert path.read_bytes().startswith(begins)


def test_unknown_figure_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"use \.svg, \.pdf or \.png"):
        save_robot_figure(ALTEN, tmp_path / "robot.bmp")
