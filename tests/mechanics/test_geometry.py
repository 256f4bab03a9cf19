"""The transformation matrices against the thesis's printed numbers; rotations against what they must do."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot
from ballbot.robot.wheel_directions import axles, contact_directions, rolling_directions
from tests.support.symbolic_oracle import random_robot

# (V.2) and (V.3) as printed
T_OWB = np.array([[-1.2346, 0.0000, 1.2346], [0.6173, -1.0692, 1.2346], [0.6173, 1.0692, 1.2346]])
T_OBW = np.array([[-0.5400, 0.2700, 0.2700], [-0.0000, -0.4676, 0.4676], [0.2700, 0.2700, 0.2700]])
HALF_A_DIGIT = 0.5e-4

# products of a few numbers of size 1 to 10: some ulps
ROUNDING = 1e-13

angle, lean = st.floats(-np.pi, np.pi), st.floats(-1.4, 1.4)
robots = st.builds(
    lambda seed, count: random_robot(np.random.default_rng(seed), count),
    st.integers(0, 2**32 - 1),
    st.sampled_from([3, 4]),
)


def test_ball_to_wheel_matrix_prints_as_the_thesis_does():
    T = transforms(Robot.load("alten"))
    np.testing.assert_allclose(T.T_owb, T_OWB, rtol=0, atol=HALF_A_DIGIT)
    np.testing.assert_allclose(T.T_obw, T_OBW, rtol=0, atol=HALF_A_DIGIT)


@given(robots)
def test_torques_and_speeds_are_dual(robot: Robot):
    """Power does not care how it is counted: what maps torques one way maps speeds the other, transposed."""
    T = transforms(robot)
    size = np.abs(T.T_trw).max()
    np.testing.assert_allclose(T.T_tbw, T.T_owb.T, atol=ROUNDING * size)
    np.testing.assert_allclose(T.T_trw, T.T_owr.T, atol=ROUNDING * size)
    np.testing.assert_allclose(T.T_vgb[:2], T.T_tbg.T, atol=ROUNDING)
    np.testing.assert_allclose(T.T_fgb @ T.T_tbg, np.eye(2), atol=ROUNDING)
    np.testing.assert_allclose(T.T_tbg @ T.T_fgb, np.diag([1, 1, 0]), atol=ROUNDING)
    # conditioning of T_owb is below 100 in the range drawn
    np.testing.assert_allclose(T.T_obw @ T.T_owb, np.eye(3), atol=1e-11)


@given(robots, st.tuples(*[st.floats(-10, 10)] * 3), st.tuples(*[st.floats(-10, 10)] * 3))
def test_wheel_speeds_follow_from_rolling_without_slip(robot: Robot, ball_rate: tuple, body_rate: tuple):
    """At the contact, ball and rim move alike along the rolling direction; solved for the wheel's spin."""
    T = transforms(robot)
    Omega, w = np.array(ball_rate), np.array(body_rate)
    r_b, r_w = robot.ball.radius, robot.wheels.radius
    speeds = T.T_owb @ Omega + T.T_owr @ w
    azimuths, tilt = robot.wheels.azimuths, robot.wheels.tilt
    directions = contact_directions(azimuths, tilt), rolling_directions(azimuths), axles(azimuths, tilt)
    for speed, n, t, a in zip(speeds, *directions, strict=True):
        across = w - a * (a @ w)  # the wheel keeps the body's rate but for its own spin about the axle
        ball = np.cross(Omega, r_b * n)
        rim = np.cross(w, (r_b + r_w) * n) + np.cross(across - speed * a, -r_w * n)
        assert rim @ t == pytest.approx(ball @ t, abs=1e-12)


def test_rotation_turns_about_x_then_y_then_z_of_the_carried_frame():
    right = np.pi / 2
    x, y, z = np.eye(3)
    np.testing.assert_allclose(rotation(right, 0, 0) @ y, z, atol=ROUNDING)
    np.testing.assert_allclose(rotation(0, right, 0) @ z, x, atol=ROUNDING)
    np.testing.assert_allclose(rotation(0, 0, right) @ x, y, atol=ROUNDING)
    product = rotation(0.3, 0, 0) @ rotation(0, -0.8, 0) @ rotation(0, 0, 2.1)
    np.testing.assert_allclose(rotation(0.3, -0.8, 2.1), product, atol=ROUNDING)


@given(lean, lean, angle, st.tuples(*[st.floats(-5, 5)] * 3))
def test_body_rates_are_those_of_the_turning_body(theta: float, phi: float, psi: float, rates: tuple):
    """[w]x = R^T dR/dt, with R differentiated numerically along the angles' rates."""
    Phi, Phi_dot = np.array([theta, phi, psi]), np.array(rates)
    h = 1e-5
    R_dot = (rotation(*(Phi + h * Phi_dot)) - rotation(*(Phi - h * Phi_dot))) / (2 * h)
    w_cross = rotation(*Phi).T @ R_dot
    w = np.array([w_cross[2, 1], w_cross[0, 2], w_cross[1, 0]])
    # truncation h^2 |Phi_dot|^3 / 6 and rounding eps / h: below 1e-7
    np.testing.assert_allclose(body_rates_matrix(theta, phi, psi) @ Phi_dot, w, atol=1e-7)
