"""A small sample of the campaign in campaigns/compensation.py; `make evidence` runs the whole."""

import pytest

from ballbot import Robot
from ballbot.identification import Bounds
from ballbot.identification.stages import IdentificationOptions
from campaigns.compensation import compare_compensations, halvings, identified_robot

pytest.importorskip("mujoco")


@pytest.mark.sample
def test_compensation_of_identified_friction_halves_the_twin_s_position_error():
    # two logs of 8 s are enough; the form of the Stribeck friction is held, as its profiles are half of the work
    robot = identified_robot(
        Robot.load("alten"),
        recorded=8.0,
        bounds=Bounds({"stribeck_speed": (0.6, 0.6), "stribeck_exponent": (1.0, 1.0)}),
        options=IdentificationOptions(generations=20, population=12, step=2.5e-3),
    )
    comparison = compare_compensations(robot, seeds=(100,))
    scores = {name: comparison.scores_of(name) for name in ("none", "full", "partial")}
    best = min(("full", "partial"), key=lambda name: scores[name][0].peak_position_error)
    assert halvings(comparison, best) == [True]
    assert all(one.ended is None for each in scores.values() for one in each)
