"""Set-valued friction: rest, sticking beside sliding. Break-away and work: test_convex_step; order: campaigns/tests."""

from dataclasses import replace

import numpy as np

from ballbot import Model
from tests.support.control_examples import FRICTION, alten


def test_a_robot_held_by_friction_does_not_move_by_one_bit():
    start = np.array([0.3, -0.2, 0.0015, -0.001, 2.0, 0, 0, 0, 0, 0])
    end = Model(alten(FRICTION)).advance(start, np.array([0.01, -0.02, 0.015]), 60.0)
    assert (end == start).all()


def test_without_rolling_friction_the_whole_robot_does_not_rest():
    start = np.array([0, 0, 0.0015, 0, 0, 0, 0, 0, 0, 0.0])
    assert (Model(alten(replace(FRICTION, rolling=0.0))).advance(start, np.zeros(3), 0.1) != start).any()


def test_stuck_wheels_hold_while_the_others_slide():
    """One wheel far stronger than the rest sticks exactly while the ball is driven about."""
    none = (0.0, 0.0, 0.0)
    friction = replace(FRICTION, viscous=none, coulomb=(5.0, 0.05, 0.05), stribeck=none)
    model = Model(alten(friction))
    state, speeds = np.zeros(10), []
    for _ in range(200):
        state = model.advance(state, np.array([0.0, 0.4, 0.5]), 1e-3)
        speeds.append(model.wheel_speed(state[:5], state[5:]))
    speeds = np.array(speeds)
    # the constraint is met at each step's start attitude; the speed left is the attitude's change within a step
    assert np.abs(speeds[:, 0]).max() < 1e-3
    assert np.abs(speeds[:, 1]).max() > 0.5
