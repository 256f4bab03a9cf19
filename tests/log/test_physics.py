"""Mistakes in lean and torque columns are named by the robot's own equations, and correct logs pass."""

import numpy as np

from ballbot.log.checks import check_logs
from ballbot.log.checks.physics import examine
from tests.support.physics_examples import FRICTION, balancing


def test_scales_of_a_correct_log_are_one():
    log, robot = balancing()
    examined = examine(log, robot)
    assert not examined.findings
    assert examined.gains
    assert np.all(np.abs(np.log(examined.gains.factors)) < 3.0 * examined.gains.errors)
    # with 12 s around a square every motor's scale is known to a sixth
    assert examined.gains.errors.max() < 0.17


def test_friction_in_the_robot_s_file_changes_nothing():
    log, robot = balancing()
    assert examine(log, robot.replace(friction=FRICTION)).findings == examine(log, robot).findings


def test_another_robot_in_one_of_two_logs_is_found():
    (first, robot), (second, _) = balancing(), balancing(mass=1.5)
    found = [f for f in check_logs({"a.csv": first, "b.csv": second}, robot=robot) if f.code == "robots"]
    assert [(one.severity, one.where.file) for one in found] == [("error", "b.csv")]
