"""Mistakes in lean and torque columns are named by the robot's own equations, and correct logs pass."""

import numpy as np
import pytest

from ballbot.log.checks import check_logs
from ballbot.log.checks.physics import examine
from tests.support.physics_examples import FRICTION, balancing, scaled


def test_scales_of_a_correct_log_are_one():
    log, robot = balancing()
    examined = examine(log, robot)
    assert not examined.findings
    assert examined.lean
    scale, uncertain = examined.lean
    # noise takes from the rates' term and leaves gravity's; 5 % is ten standard errors
    assert scale == pytest.approx(1.0, abs=min(0.05, uncertain))
    assert examined.gains
    assert np.all(np.abs(np.log(examined.gains.factors)) < 3.0 * examined.gains.errors)
    # with 12 s around a square every motor's scale is known to a sixth
    assert examined.gains.errors.max() < 0.17


def test_friction_in_the_robot_s_file_changes_nothing():
    log, robot = balancing()
    assert examine(log, robot.replace(friction=FRICTION)).findings == examine(log, robot).findings


@pytest.mark.parametrize("mistake", ["mass", "wheels"])
def test_another_robot_in_one_of_two_logs_is_found(mistake):
    first, robot = balancing()
    second = balancing(mass=1.5)[0] if mistake == "mass" else scaled(first, 1.3, "x", "y", "x_dot", "y_dot")
    found = [f for f in check_logs({"a.csv": first, "b.csv": second}, robot=robot) if f.code == "robots"]
    assert {(one.severity, one.where.file) for one in found} == {("error", "b.csv")}
    assert any({"mass": "heavier", "wheels": "radius"}[mistake] in one.text for one in found)
