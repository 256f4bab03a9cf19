"""The robots that learning draws from."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ballbot import InputError
from ballbot.learning.robots import drawn_robots, learned_robot
from ballbot.robot import Robot
from ballbot.robot.components import Correlation
from ballbot.twin import Scenario

ALTEN = Robot.load("alten")


@pytest.fixture
def folder(tmp_path):
    """An identification: c_1 and c_2 go together, s_3 has no standard error, c and C_rr vary between logs, d_1 < 0."""
    friction = replace(Scenario.nominal(ALTEN).friction, coulomb_asymmetry=(-0.03, 0.0, 0.0))
    robot = ALTEN.replace(friction=friction).annotated(
        standard_deviations={
            "friction.coulomb": (0.01, 0.02, 0.0),
            "friction.stribeck": (0.0, 0.0, np.inf),
            "friction.stribeck_speed": 0.2,
            "friction.rolling": 0.0003,
            "friction.coulomb_asymmetry": (0.01, 0.0, 0.0),
        },
        correlation=Correlation(
            of=("friction.coulomb[0]", "friction.coulomb[1]"), lower=((1.0,), (0.8, 1.0))
        ),
        intervals={"friction.stribeck[2]": (0.02, 0.1)},
    )
    robot.write(tmp_path / "robot.toml")
    between = {"standard_deviations": {"c1": 0.015, "c2": 0.015, "c3": 0.015, "C_rr": 0.0004}}
    (tmp_path / "results.json").write_text(json.dumps({"identification": {"between_logs": between}}))
    return tmp_path


def test_robots_are_drawn_from_covariance_and_spread_between_logs(folder):
    robot = learned_robot(None, folder)
    drawn = [
        one.model.robot.friction for one in drawn_robots(robot, Scenario.nominal(robot), folder, count=400)
    ]
    c = np.array([friction.coulomb for friction in drawn])
    # of 400, a standard deviation has a standard error of 3.5 %, a correlation of r one of (1 - r^2) / 20
    assert_allclose(c.std(axis=0)[:2], np.hypot([0.01, 0.02], 0.015), rtol=0.12)
    assert_allclose(c.mean(axis=0)[:2], robot.friction.coulomb[:2], atol=0.004)
    assert np.ptp(c[:, 2]) == 0.0  # stated without a deviation: it is known
    covariance = 0.8 * 0.01 * 0.02
    assert_allclose(
        np.corrcoef(c[:, 0], c[:, 1])[0, 1], covariance / np.prod(np.hypot([0.01, 0.02], 0.015)), atol=0.15
    )
    s3 = np.array([friction.stribeck[2] for friction in drawn])
    assert s3.min() >= 0.02
    assert s3.max() <= 0.1
    assert s3.std() > 0.5 * 0.08 / np.sqrt(12.0)
    assert_allclose(np.std([friction.rolling for friction in drawn]), 0.0005, rtol=0.12)
    # what may be negative is not drawn as zero
    assert_allclose(np.mean([friction.coulomb_asymmetry[0] for friction in drawn]), -0.03, atol=0.002)


def test_the_same_seed_draws_the_same_robots_and_boxes_have_their_ranges(folder):
    robot = learned_robot(None, folder)
    options = {"robot": robot, "scenario": Scenario.nominal(robot), "count": 20}
    for randomize in (folder, "boxes"):
        draws = (drawn_robots(randomize=randomize, seed=seed, **options) for seed in (1, 1, 2))
        one, same, other = ([drawn.model.robot for drawn in robots] for robots in draws)
        assert one == same
        assert one != other
    factors = np.array([drawn.friction.coulomb for drawn in one]) / robot.friction.coulomb
    assert np.all(np.abs(factors - 1.0) <= 1.0 / 3.0)
    assert np.ptp(factors) > 0.4


def test_a_robot_without_friction_of_its_own_has_the_scenarios():
    scenario = Scenario.nominal(ALTEN)
    (drawn,) = drawn_robots(ALTEN, scenario, None)
    assert drawn.model.robot.friction == scenario.friction
    identified = ALTEN.replace(friction=replace(scenario.friction, rolling=0.01))
    (drawn,) = drawn_robots(identified, scenario, None)
    assert drawn.model.robot.friction.rolling == 0.01


def test_a_folder_that_is_no_identification_is_refused(tmp_path, folder):
    with pytest.raises(InputError, match=r"There is no .*robot\.toml; robots are drawn from"):
        learned_robot(None, tmp_path / "nothing")
    with pytest.raises(InputError, match="not of 'other'"):
        learned_robot(ALTEN.replace(name="other"), folder)
    ALTEN.write(folder / "robot.toml")
    with pytest.raises(InputError, match="states no standard deviations"):
        drawn_robots(ALTEN, Scenario.nominal(ALTEN), folder)


@pytest.mark.parametrize("found", [{}, {"standard_deviations": {"c1": "much"}}])
def test_a_spread_without_standard_deviations_is_refused(folder, found):
    (folder / "results.json").write_text(json.dumps({"between_logs": found}))
    robot = learned_robot(None, folder)
    with pytest.raises(InputError, match=r"results\.json has no standard_deviations"):
        drawn_robots(robot, Scenario.nominal(robot), folder)


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
