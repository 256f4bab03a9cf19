"""The disturbance rule: which logs cannot support a closed-loop verdict."""

import numpy as np
import pytest
from foreign_log_examples import small_robot, swaying_log

from ballbot.log import Log
from ballbot.log.checks.kinematics import check_disturbance
from ballbot.robot import Robot


def test_a_simulated_run_supports_a_verdict():
    assert check_disturbance(swaying_log(), small_robot()) == []


def test_hands_that_push_all_the_time_are_told():
    log = swaying_log()
    # hands that tilt the body by a degree or two at 1.5 Hz, while the wheels do what they did
    push = 0.03 * np.sin(2.0 * np.pi * 1.5 * log.t)
    found = check_disturbance(log.with_columns({"theta": log["theta"] + push}), small_robot())
    assert [finding.code for finding in found] == ["disturbance"]
    assert "closed-loop" in found[0].text


@pytest.mark.parametrize("name", ["square_soft", "hold_soft"])
def test_the_stand_ins_logs_support_one(shared_data, name):
    """The course robots' logs do not: see test_rob311."""
    assert check_disturbance(Log.read(shared_data / "bbr" / f"{name}.csv"), Robot.load("alten")) == []
