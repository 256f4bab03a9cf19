"""The packed row of a robot: its places and sizes follow from one list, and the largest robot fits into a lane."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Robot
from ballbot.mechanics.engine.lanes import MAX_PARAMETERS
from ballbot.mechanics.parameters import (
    PLACES,
    Parameters,
    friction_places,
    pack,
    row_size,
    selector,
    term_places,
)
from ballbot.robot import Friction
from tests.support.control_examples import FRICTION, alten

FULL = replace(
    FRICTION,
    coulomb_asymmetry=(0.03, -0.02, 0.04),
    stribeck_asymmetry=(-0.02, 0.01, 0.03),
    load=(0.2, 0.1, 0.3),
)


def four_wheeled() -> Robot:
    robot = Robot.load("alten")
    wheels = replace(robot.wheels, azimuths=tuple(np.pi / 2 * np.arange(4)))
    return robot.replace(wheels=wheels, friction=Friction.none(4))


@pytest.mark.parametrize("robot", [alten(FULL), four_wheeled()])
def test_a_packed_row_has_its_size_and_fits_into_a_lane(robot: Robot) -> None:
    row = pack(robot, "exact")
    assert len(row) == row_size(selector("exact", robot.wheel_count)) <= MAX_PARAMETERS


def test_the_largest_robot_fills_the_rows_of_a_lane() -> None:
    assert row_size(selector("exact", 4)) == MAX_PARAMETERS


def test_every_number_stands_at_the_place_of_its_name() -> None:
    robot = alten(FULL)
    row, friction = pack(robot, "exact", pivoting=0.02), robot.friction
    assert list(PLACES) == [*Parameters._fields[:-1]]
    assert row[PLACES["inv_rb"]] == 1.0 / robot.ball.radius
    assert row[PLACES["g"]] == robot.gravity
    assert row[PLACES["j_b"]] == robot.ball.inertia
    assert row[PLACES["pivoting"]] == 0.02
    assert row[PLACES["rolling_force"]] == robot.rolling_force
    wheels = (*friction.viscous, *friction.coulomb, *friction.stribeck)
    common = (1.0 / friction.stribeck_speed, friction.stribeck_exponent, robot.rolling_force)
    assert row[friction_places(3)].tolist() == [*wheels, *common]
    terms = [friction.coulomb_asymmetry, friction.stribeck_asymmetry, friction.load]
    assert row[term_places(3)].tolist() == [list(one) for one in terms]
