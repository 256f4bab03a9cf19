"""Set-valued friction: rest, sticking beside sliding, convergence. Break-away and work: test_convex_step."""

from dataclasses import replace

import numpy as np

from ballbot import Model, Robot
from ballbot.robot import Friction

FRICTION = Friction(
    viscous=(0.0, 0.0, 0.0),
    coulomb=(0.11, 0.09, 0.12),
    stribeck=(0.05, 0.04, 0.06),
    stribeck_speed=0.6,
    stribeck_exponent=1.1,
    rolling=0.007,
)


def robot_with(friction: Friction) -> Robot:
    return Robot.load("alten").replace(friction=friction)


def test_a_robot_held_by_friction_does_not_move_by_one_bit():
    model = Model(robot_with(FRICTION))
    start = np.array([0.3, -0.2, 0.0015, -0.001, 2.0, 0, 0, 0, 0, 0])
    end = model.advance(start, np.array([0.01, -0.02, 0.015]), 60.0)
    assert (end == start).all()


def test_without_rolling_friction_the_whole_robot_does_not_rest():
    model = Model(robot_with(replace(FRICTION, rolling=0.0)))
    start = np.array([0, 0, 0.0015, 0, 0, 0, 0, 0, 0, 0.0])
    assert (model.advance(start, np.zeros(3), 0.1) != start).any()


def test_stuck_wheels_hold_while_the_others_slide():
    """One wheel far stronger than the rest sticks exactly while the ball is driven about."""
    friction = replace(FRICTION, coulomb=(5.0, 0.05, 0.05), stribeck=(0.0, 0.0, 0.0))
    model = Model(robot_with(friction))
    state, speeds = np.zeros(10), []
    for _ in range(200):
        state = model.advance(state, np.array([0.0, 0.4, 0.5]), 1e-3)
        speeds.append(model.wheel_speed(state[:5], state[5:]))
    speeds = np.array(speeds)
    # the constraint is met at each step's start attitude; the speed left is the attitude's change within a step
    assert np.abs(speeds[:, 0]).max() < 1e-3
    assert np.abs(speeds[:, 1]).max() > 0.5


def test_whole_method_converges_in_stick_slip_motion():
    """Halving the step halves the error at least: only steps at a change of sign are of first order."""
    robot = robot_with(FRICTION)
    start = np.array([0, 0, 0.02, 0.01, 0.1, 0.2, -0.15, 0, 0, 0.3])
    torques = [np.array([0.5 * np.sin(8 * k * 0.05), 0.4 * np.cos(11 * k * 0.05), -0.3]) for k in range(8)]

    def end(step):
        state = start
        for torque in torques:
            state = Model(robot, step=step).advance(state, torque, 0.05)
        return state

    reference = end(2e-6)
    errors = np.array([np.abs(end(step) - reference).max() for step in (2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)])
    # errors fall from step to step by a factor that scatters about two (where in a step a sign changes is chance)
    assert errors[0] / errors[-1] > 8
