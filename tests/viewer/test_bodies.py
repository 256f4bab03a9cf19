"""Pushes against the principle of virtual work, the integrator, and the physics engine."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.control.presets import nominal_controller
from ballbot.mechanics.geometry import rotation
from ballbot.robot import Robot
from ballbot.robot.components import scaled_friction
from ballbot.twin import Scenario
from ballbot.viewer.bodies import ModelBody, TwinBody, push_force

ALTEN = Robot.load("alten")
SMOOTH = ALTEN.replace(friction=scaled_friction(ALTEN.friction, 0.0))
ANGLE = st.floats(-1.2, 1.2)


@given(st.tuples(ANGLE, ANGLE, ANGLE), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-0.2, 1.0))
def test_push_does_the_work_of_its_force(angles, f_x, f_y, height):
    def point(q):  # where the force acts, by the definition of the angles
        return np.array([q[0], q[1], 0.0]) + rotation(*q[2:]) @ [0.0, 0.0, height]

    q, step = np.array([0.0, 0.0, *angles]), 1e-6
    work = [
        np.dot([f_x, f_y, 0.0], point(q + step * direction) - point(q - step * direction)) / (2.0 * step)
        for direction in np.eye(5)
    ]
    # central differences: truncation 1e-12, rounding 1e-16 / 1e-6, times a force of 70 N
    np.testing.assert_allclose(push_force((f_x, f_y), height, angles[:2]), work, atol=1e-7)


@pytest.mark.slow
def test_twin_answers_a_push_and_a_slope_as_the_model_does():
    twin = TwinBody(SMOOTH, Scenario.ideal(SMOOTH), nominal_controller(SMOOTH))
    found = []
    for body in (ModelBody(SMOOTH), twin):
        for force, slope in (((12.0, -5.0), 0.0), ((0.0, 0.0), 0.05)):
            body.reset(np.zeros(10))
            body.change(SMOOTH.friction, slope)
            for _ in range(20):
                measured = body.step(np.zeros(3), 0.005, force, 0.4)
            found.append(measured.truth)
    # rates of x, y, theta and phi: the twin's rollers rub and slip, which takes some; directions and sizes are compared
    for of_model, of_twin in zip(found[:2], found[2:], strict=True):
        difference = np.linalg.norm(of_twin[5:9] - of_model[5:9])
        assert difference < 0.35 * np.linalg.norm(of_model[5:9])
