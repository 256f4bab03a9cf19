"""A small sample of the campaign in campaigns/compensation.py; `make evidence` runs the whole."""

import pytest

from ballbot import Robot
from campaigns.compensation import compare_compensations, halvings, identified_robot

pytest.importorskip("mujoco")


@pytest.mark.slow
def test_compensation_of_identified_friction_halves_the_twin_s_position_error():
    # two logs of 8 s are enough: peaks of 0.39 m without, 0.13 and 0.09 m with compensation
    comparison = compare_compensations(identified_robot(Robot.load("alten"), recorded=8.0), seeds=(100,))
    best = min(("full", "partial"), key=lambda name: comparison.summary(name).peak_position_error)
    assert halvings(comparison, best) == [True]
    assert all(comparison.summary(name).falls == 0 for name in ("none", "full", "partial"))
