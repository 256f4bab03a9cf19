"""Drawings are to scale: measured on the paper, not on the numbers they were made from."""

import dataclasses
import math

import numpy as np
import pytest
from matplotlib.patches import Circle

from ballbot.robot import Friction, Robot
from ballbot.robot.drawing import body_shape, wheel_shapes
from ballbot.robot.figure import robot_figure

ALTEN = Robot.load("alten")


def four_wheeled() -> Robot:
    azimuths = tuple(math.radians(one) for one in (45.0, 135.0, 225.0, 315.0))
    wheels = dataclasses.replace(ALTEN.wheels, azimuths=azimuths)
    return ALTEN.replace(wheels=wheels, friction=Friction.none(4))


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
    reach = robot.ball.radius + robot.wheels.radius
    for wheel, azimuth in zip(wheel_shapes(robot), robot.wheels.azimuths, strict=True):
        assert np.linalg.norm(wheel.center) == pytest.approx(reach, rel=1e-12)
        found = math.atan2(wheel.center[1], wheel.center[0]) % (2.0 * math.pi)
        assert found == pytest.approx(azimuth, abs=1e-12)
        axes = np.column_stack([wheel.contact, wheel.rolling, wheel.axle])
        assert axes.T @ axes == pytest.approx(np.eye(3), abs=1e-12)


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
