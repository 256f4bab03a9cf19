"""The robots that learning draws from."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import InputError
from ballbot.learning.robots import drawn_robots
from ballbot.robot import Robot
from ballbot.twin import Scenario

ALTEN = Robot.load("alten")


def test_the_same_seed_draws_the_same_robots():
    options = {"robot": ALTEN, "scenario": Scenario.nominal(ALTEN), "count": 20}
    draws = (drawn_robots(randomize="boxes", seed=seed, **options) for seed in (1, 1, 2))
    one, same, other = ([drawn.model.robot for drawn in robots] for robots in draws)
    assert one == same
    assert one != other
    with pytest.raises(InputError, match=r"'found/'.*robot\.toml"):
        drawn_robots(randomize="found/", **options)


def test_a_robot_without_friction_of_its_own_has_the_scenarios():
    scenario = Scenario.nominal(ALTEN)
    (drawn,) = drawn_robots(ALTEN, scenario, None)
    assert drawn.model.robot.friction == scenario.friction
    identified = ALTEN.replace(friction=replace(scenario.friction, rolling=0.01))
    (drawn,) = drawn_robots(identified, scenario, None)
    assert drawn.model.robot.friction.rolling == 0.01


def test_boxes_have_the_ranges_that_the_documents_state():
    robot = ALTEN.replace(friction=Scenario.nominal(ALTEN).friction)
    drawn = drawn_robots(robot, Scenario.nominal(robot), "boxes", seed=4, count=150)
    true = [one.model.robot for one in drawn]
    masses = np.array([one.body.mass for one in true]) / robot.body.mass
    heights = np.array([one.body.center_of_mass for one in true]) / robot.body.center_of_mass
    coulomb = np.array([one.friction.coulomb for one in true]) / robot.friction.coulomb
    for shares, width in ((masses, 0.2), (heights, 0.2), (coulomb.ravel(), 1.0 / 3.0)):
        assert np.abs(shares - 1.0).max() <= width
        # the deviation of U(-width, width); 150 draws estimate it to 6 %
        assert shares.std() == pytest.approx(width / np.sqrt(3.0), rel=0.2)
    nominal = drawn_robots(robot, Scenario.nominal(robot), None)[0].imperfections.delay
    assert {one.imperfections.delay - nominal for one in drawn} == {0, 1, 2}
    slopes = np.array([np.hypot(*one.imperfections.slope) for one in drawn])
    assert 0.5 * np.tan(np.radians(1.0)) < slopes.max() <= np.tan(np.radians(1.0))
    grips = np.array([(grip.wheels, grip.floor) for one in drawn if (grip := one.imperfections.grip)])
    assert len(grips) == 150
    assert 0.4 <= grips.min() < 0.42
    assert 0.98 < grips.max() <= 1.0
