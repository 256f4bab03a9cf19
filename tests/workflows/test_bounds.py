"""Bounds of the benchmark: against the closed form of an unstable mode, and against planned and simulated motions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from ballbot import Robot
from ballbot.control.lqr import frictionless_model
from ballbot.workflows.bounds import bounds_of
from ballbot.workflows.courses import Course, choose_courses
from ballbot.workflows.limits import pushed_state
from ballbot.workflows.metrics import REST
from tests.support.control_examples import FRICTION, alten


def course_of(name: str, robot: Robot) -> Course:
    (course,) = choose_courses(name, robot, "model")
    return course


@pytest.mark.parametrize("name", ["alten", "cmu"])
def test_push_of_weak_motors_is_that_of_the_unstable_modes(name: str):
    """x' = p x + b u is brought back from |x| < b u / p, by the largest torque held: for wheels, some constant one."""
    robot = Robot.load(name)
    robot = robot.replace(drive=replace(robot.drive, torque_limit=0.2))  # so that speeds and leans are small
    course = course_of("largest_push", robot)
    course = replace(course, scenario=replace(course.scenario, roller_grip=100.0))
    model = frictionless_model(robot)
    linear = model.linearize()
    poles, modes = np.linalg.eig(linear.A.T)
    unstable = np.real(poles) > 0.1
    p, left = np.real(poles[unstable]), np.real(modes[:, unstable]).T
    late = (1.0 - np.exp(-0.1 * p)) / 0.1  # the push lasts 0.1 s
    n, expected = robot.wheel_count, []
    for k in range(8):
        pushed = late * (left @ pushed_state(model, 2.0 * np.pi * k / 8, 1.0, 0.4))
        equal = np.column_stack([left @ linear.B, pushed])
        bounds = [*[(-0.2, 0.2)] * n, (0.0, None)]
        found = linprog(np.append(np.zeros(n), -1.0), A_eq=equal, b_eq=np.zeros(len(p)), bounds=bounds)
        expected.append(-found.fun)
    # the torques of the four seconds in which it comes to rest are held for 0.1 s each
    assert bounds_of(course, robot)["largest_impulse"] == pytest.approx(max(expected), rel=0.01)


def test_grip_lowers_the_largest_push():
    robot = alten(FRICTION)
    course = course_of("largest_push", robot)
    bounds = [
        bounds_of(replace(course, scenario=replace(course.scenario, roller_grip=grip)), robot)[
            "largest_impulse"
        ]
        for grip in (0.2, 0.4, 1.0)
    ]
    assert bounds[0] < 0.8 * bounds[1] < bounds[1] < bounds[2]


def test_planned_motions_keep_the_bounds_of_stop_and_speed():
    """Planned with the exact equations and without a margin, from rest to rest in one heading, so somewhat slower."""
    pytest.importorskip("casadi")
    from ballbot.workflows.plan import MoveLimits, plan

    robot = alten(FRICTION)
    limits = MoveLimits(torque=6.0, lean=0.6, margin=0.0, reserve=0.0)
    planned = plan(robot, stop_from=1.4, limits=limits)
    bounds = bounds_of(course_of("stop", robot), robot)
    moving = np.hypot(planned.states[:, 5], planned.states[:, 6]) >= REST
    time = planned.t[np.flatnonzero(moving)[-1]] - planned.begins
    assert 0.6 * time < bounds["stopping_time"] < time
    assert 0.8 * planned.distance < bounds["stopping_distance"] < planned.distance
    top_speed = bounds_of(course_of("faster", robot), robot)["top_speed"]
    assert 0.9 * top_speed < planned.top_speed < top_speed


def test_courses_of_errors_have_no_bound():
    robot = alten(FRICTION)
    assert bounds_of(course_of("benchmark_square", robot), robot) == {}
