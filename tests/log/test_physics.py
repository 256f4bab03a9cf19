"""Mistakes in lean and torque columns are named by the robot's own equations, and correct logs pass."""

from __future__ import annotations

import numpy as np
import pytest

from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.log.checks import check_logs
from ballbot.log.checks.lean import lean_evidence, motion_of, usable_rows
from ballbot.log.checks.physics import examine, torque_scale_errors
from ballbot.log.checks.torque_balance import USUAL, driving_of, gains_of, motor_sums
from ballbot.robot import Robot
from tests.support.physics_examples import FRICTION, balancing, scaled


def errors(log: Log, robot: Robot) -> list[Finding]:
    return [finding for finding in examine(log, robot).findings if finding.severity == "error"]


def test_correct_log_is_not_stopped():
    log, robot = balancing()
    assert errors(log, robot) == []


def test_gains_of_a_correct_log_are_one():
    log, robot = balancing()
    rows = usable_rows(log, robot)
    assert rows
    motion = motion_of(log, rows)
    lean = lean_evidence(motion, robot)
    # noise takes from the rates' term and leaves gravity's; 5 % is ten standard errors
    assert abs(lean.gravity_gain) == pytest.approx(1.0, abs=0.05)
    driving = driving_of(log, rows, motion, robot)
    assert driving
    gains = gains_of(motor_sums(driving, motion, robot))
    assert np.all(np.abs(np.log(gains.factors)) < 3.0 * gains.errors)
    # with 12 s around a square every motor's scale is known to a sixth
    assert gains.errors.max() < 0.17


def test_torque_scale_that_no_log_shows_has_the_usual_error():
    log, robot = balancing()
    short = log.select(slice(0, 400))
    np.testing.assert_array_equal(torque_scale_errors([short], robot), USUAL)
    # one log that shows it is enough, and knows more than what is usual
    assert (torque_scale_errors([short, log], robot) < USUAL).all()


@pytest.mark.parametrize("name", ["thesis_step_soft", "square_stiff"])
def test_measured_logs_are_not_stopped(shared_data, name):
    log = Log.read(shared_data / "bbr" / f"{name}.csv")
    assert errors(log, Robot.load("alten")) == []


def test_friction_in_the_robot_s_file_changes_nothing():
    log, robot = balancing()
    assert examine(log, robot.replace(friction=FRICTION)).findings == examine(log, robot).findings


def test_heavier_robot_in_one_of_two_logs_is_found():
    first, robot = balancing()
    second, _ = balancing(mass=1.5)
    found = [f for f in check_logs({"a.csv": first, "b.csv": second}, robot=robot) if f.code == "robots"]
    assert [finding.severity for finding in found] == ["error"]
    assert found[0].where.file == "b.csv"
    assert "One is heavier" in found[0].text


def test_other_wheels_in_one_of_two_logs_are_found():
    first, robot = balancing()
    second = scaled(first, 1.3, "x", "y", "x_dot", "y_dot")
    found = [f for f in check_logs({"a.csv": first, "b.csv": second}, robot=robot) if f.code == "robots"]
    assert any("wheel or ball radius" in finding.text for finding in found)
    assert {finding.where.file for finding in found} == {"b.csv"}
