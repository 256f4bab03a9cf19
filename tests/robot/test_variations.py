"""Standard deviations of a robot's parameters: in its file, and carried through to poles and gains."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbot import InputError, Model, Robot
from ballbot.robot.components import PARAMETERS, Correlation
from ballbot.robot.file import robot_text
from ballbot.robot.parameters import value_of
from ballbot.robot.variations import draw_robots, propagate, uncertain
from ballbot.workflows.robot_check import CheckedRobot

ALTEN = Robot.load("alten")
SOME = {"body.center_of_mass": 0.004, "body.mass": 0.1, "wheels.radius": 0.0005}
SOME |= {"wheels.azimuths": (0.004, 0.0, 0.008)}


def known_to(deviations: Mapping[str, float | tuple[float, ...]], robot: Robot = ALTEN) -> Robot:
    return robot.annotated(standard_deviations=deviations)


class TestFile:
    @pytest.mark.parametrize(
        ("of", "lower", "says"),
        [
            ('["friction.coulom"]', "[[1.0]]", "has no finite standard deviation above zero"),
            ('["friction.rolling", "friction.rolling"]', "[[1.0], [0.1, 1.0]]", "must list a number once"),
            ('["friction.rolling", "body.mass"]', "[[1.0], [0.1]]", "rows of 1 to 2"),
            ('["friction.rolling", "body.mass"]', "[[1.0], [1.2, 1.0]]", "no errors can have"),
            ('"friction.rolling"', "[[1.0]]", r"correlation\.of is 'friction.rolling'; it must be a list"),
            ('["body.mass"]', "[[1.0]]\n[intervals]\n'body.mass' = [0.0, 1.0]", "belong together"),
            ('["body.mass"]', "[[1.0]]\n[intervals]\n'body.mass' = [0.0]", "it must have at least 2"),
        ],
    )
    def test_mistaken_correlations_end_in_one_sentence(self, of: str, lower: str, says: str, tmp_path: Path):
        robot = known_to({"friction.rolling": 0.001, "body.mass": 0.1})
        text = f"{robot_text(robot)}[correlation]\nof = {of}\nlower = {lower}\n"
        (tmp_path / "bad.toml").write_text(text)
        with pytest.raises(InputError, match=says):
            Robot.load(tmp_path / "bad.toml")

    @pytest.mark.parametrize(
        ("old", "new", "says"),
        [
            ('0.393, unit = "m"', '0.393, unit = "m", standard_deviation = -1', "it must be zero or more"),
            ('0.393, unit = "m"', '0.393, unit = "m", standard_deviation = "1"', "be a number or a list"),
            ('240.0], unit = "deg"', '240.0], unit = "deg", standard_deviation = [1]', "it needs 3 of them"),
            ("rows = { value = 2,", "rows = { value = 2, standard_deviation = 1,", "number and cannot have"),
        ],
    )
    def test_mistakes_end_in_one_sentence(self, old: str, new: str, says: str, tmp_path: Path):
        text = robot_text(ALTEN)
        assert old in text
        (tmp_path / "bad.toml").write_text(text.replace(old, new))
        with pytest.raises(InputError, match=says):
            Robot.load(tmp_path / "bad.toml")

    def test_a_value_that_changes_loses_it(self):
        robot = known_to(SOME)
        changed = robot.replace(body=replace(robot.body, center_of_mass=0.4))
        assert set(changed.standard_deviations) == set(SOME) - {"body.center_of_mass"}
        assert robot.replace(name="other").standard_deviations == SOME


class TestCorrelation:
    ROBOT = ALTEN.annotated(
        standard_deviations={"body.mass": 0.1, "body.center_of_mass": 0.004},
        correlation=Correlation.of_matrix(
            ["body.mass", "body.center_of_mass"], np.array([[1.0, -0.8], [-0.8, 1.0]])
        ),
    )

    def test_draws_are_correlated_as_stated(self):
        drawn = draw_robots(self.ROBOT, 600, seed=2)
        numbers = np.array([(one.body.mass, one.body.center_of_mass) for one in drawn])
        # the error of a correlation of -0.8 from 600 draws is 0.015; four of them
        assert np.corrcoef(numbers.T)[0, 1] == pytest.approx(-0.8, abs=0.06)

    def test_the_delta_method_counts_them(self):
        moment = propagate(self.ROBOT, lambda one: one.body.mass * one.body.center_of_mass)
        first, second = 0.1 * ALTEN.body.center_of_mass, 0.004 * ALTEN.body.mass
        expected = math.sqrt(first**2 + second**2 - 1.6 * first * second)
        assert moment.deviation == pytest.approx(expected, rel=1e-6)

    def test_a_value_that_changes_leaves_them(self):
        changed = self.ROBOT.replace(body=replace(self.ROBOT.body, mass=17.0))
        assert changed.correlation == Correlation(of=("body.center_of_mass",), lower=((1.0,),))


class TestPropagation:
    def test_products_add_relative_variances(self):
        robot = known_to({"body.mass": 0.2, "body.center_of_mass": 0.006, "gravity": 0.0})
        moment = propagate(robot, lambda one: one.body.mass * one.body.center_of_mass)
        relative = math.hypot(0.2 / 17.076, 0.006 / 0.393)
        assert moment.deviation == pytest.approx(17.076 * 0.393 * relative, rel=1e-9)
        assert moment.largest(1)[0][0] == "body.center_of_mass"
        assert sum(share for _, share in moment.largest(2)) == pytest.approx(1.0)
        assert [one.name for one in uncertain(robot)] == ["body.mass", "body.center_of_mass"]

    def test_the_mean_of_two_poles_that_lie_together(self):
        """Each of two independent errors of one size moves it by half of what it moves its own pole."""
        known = known_to({"body.inertia.xx": 0.05, "body.inertia.yy": 0.05})
        spread = CheckedRobot(robot=known, findings=()).spread
        body = replace(ALTEN.body, inertia=(4.42, 4.42, *ALTEN.body.inertia[2:]))
        pole, moved = (Model(of).linearize().poles().real.max() for of in (ALTEN, ALTEN.replace(body=body)))
        assert spread
        # the pole is linear in the inertia to 1 %
        assert spread.deviation == pytest.approx(abs(moved - pole) / math.sqrt(2.0), rel=0.02)
        halves = {"body.inertia.xx": 0.5, "body.inertia.yy": 0.5}
        assert dict(spread.largest()) == pytest.approx(halves, abs=0.01)

    def test_draws_are_normal_and_reproducible(self):
        robot = known_to(SOME)
        drawn = draw_robots(robot, 500, seed=3)
        assert drawn == draw_robots(robot, 500, seed=3)
        for name, deviation in SOME.items():
            parameter = next(one for one in PARAMETERS if one.name == name)
            spread = np.atleast_1d(np.array([value_of(one, parameter) for one in drawn]).std(axis=0))
            assert spread == pytest.approx(np.atleast_1d(deviation), rel=0.13, abs=1e-12)
        assert all(one.ball == ALTEN.ball for one in drawn)

    def test_friction_is_drawn_with_its_correlations_intervals_and_signs(self):
        of = [f"friction.coulomb[{wheel}]" for wheel in range(3)]
        friction = replace(
            ALTEN.friction, coulomb=(0.2,) * 3, stribeck=(0.05,) * 3, coulomb_asymmetry=(-0.03, 0.0, 0.0)
        )
        known = ALTEN.replace(friction=friction).annotated(
            standard_deviations={
                "friction.coulomb": (0.01, 0.02, 0.02),
                "friction.stribeck": (0.0, 0.0, np.inf),
                "friction.coulomb_asymmetry": (0.01, 0.0, 0.0),
            },
            correlation=Correlation(of=tuple(of), lower=((1.0,), (0.8, 1.0), (0.8, 1.0, 1.0))),
            intervals={"friction.stribeck[2]": (0.02, 0.1)},
        )
        drawn = [robot.friction for robot in draw_robots(known, 400, seed=1)]
        c, s = (np.array([getattr(each, name) for each in drawn]) for name in ("coulomb", "stribeck"))
        # of 400, a standard deviation has a standard error of 3.5 %, a correlation of r one of (1 - r^2) / 20
        assert c.std(axis=0) == pytest.approx([0.01, 0.02, 0.02], rel=0.12)
        assert np.corrcoef(c[:, 0], c[:, 1])[0, 1] == pytest.approx(0.8, abs=0.07)
        np.testing.assert_allclose(c[:, 1], c[:, 2], rtol=1e-7)
        assert (s[:, :2] == 0.05).all()
        assert (s[:, 2].min(), s[:, 2].max()) == pytest.approx((0.02, 0.1), abs=0.01)
        assert np.mean([each.coulomb_asymmetry[0] for each in drawn]) == pytest.approx(-0.03, abs=0.002)

    def test_draws_that_are_no_robot_are_drawn_again_or_refused(self):
        slight = known_to({"ball.inertia": 0.001})  # a third lies beyond a thin shell's, with its margin
        assert max(one.ball.inertia for one in draw_robots(slight, 200, seed=0)) <= 1.05 * 0.0242
        with pytest.raises(InputError, match="hardly any draw is a possible robot"):
            draw_robots(known_to({"ball.inertia": 1.0}), 20, seed=0)
        with pytest.raises(InputError, match=r"ball\.inertia cannot vary"):
            propagate(known_to({"ball.inertia": 1.0}), lambda one: one.ball.mass)
