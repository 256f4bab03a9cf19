"""LQR: against python-control, the Riccati equation, the cost itself and a gain published with measured data."""

import json
from dataclasses import dataclass

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag

from ballbot import Controller, InputError, Model, lqr
from ballbot.control.linear import refuse_without_margin
from ballbot.control.presets import NOMINAL_STATE_WEIGHTS, NOMINAL_TORQUE_WEIGHT
from tests.support.control_examples import alten

Q, R = np.array(NOMINAL_STATE_WEIGHTS), np.full(3, NOMINAL_TORQUE_WEIGHT)


@dataclass(frozen=True)
class Matrices:
    A: np.ndarray
    B: np.ndarray


@pytest.fixture(scope="module")
def model() -> Model:
    return Model(alten())


@pytest.mark.parametrize("log", ["square_soft", "square_stiff"])
def test_gains_that_ran_on_a_robot(shared_data, model, log):
    printed = json.loads((shared_data / "bbr" / "controllers.json").read_text())[log]
    design = lqr(model, printed["Q"], printed["R"], sample_time=printed["sample_s"])
    # six decimals are printed; a sampled cost integral would differ by 1e-4
    np.testing.assert_allclose(design.gain, printed["K"], atol=6e-7)


weights = st.lists(st.floats(0.1, 1000.0), min_size=13, max_size=13)


@settings(max_examples=16, deadline=None)
@given(weights=weights, sample_time=st.none() | st.floats(0.002, 0.02))
def test_gain_cost_and_poles_are_python_controls(weights, sample_time):
    space = Model(alten()).linearize()
    Q, R = np.diag(weights[:10]), np.diag(weights[10:])
    design = lqr(space, Q, R, sample_time=sample_time)
    if sample_time is None:
        expected, P, poles = control.lqr(space.A, space.B, Q, R, method="scipy")
    else:
        sampled = control.c2d(control.ss(space.A, space.B, np.eye(10), 0), sample_time)
        expected, P, poles = control.dlqr(sampled.A, sampled.B, Q, R, method="scipy")
        poles = np.log(np.asarray(poles, complex)) / sample_time
    np.testing.assert_allclose(design.gain, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(design.cost, P, rtol=1e-5, atol=1e-6 * np.abs(P).max())
    np.testing.assert_allclose(np.sort(design.poles.real), np.sort(np.real(poles)), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    ("q", "r", "more", "sentence"),
    [
        (Q[:9], R, {}, "Q has the shape"),
        (Q, R[:2], {}, "R has the shape"),
        (20.0, R, {}, "Q is one number, 20; it must be 10 numbers"),
        (Q, -30.0, {}, "R is not positive definite"),
        (Q, 0.0 * R, {}, "R is not positive definite"),
        (np.where(np.arange(10) == 2, -1.0, Q), R, {}, "Q is not positive semidefinite"),
        (np.diag(Q) + np.eye(10, k=1), R, {}, "Q is not symmetric"),
        (Q * np.nan, R, {}, "not finite"),
        (["many"] * 10, R, {}, "Q is an array .* it must be of real numbers"),
        (np.zeros(10), R, {}, "has no weight"),
        *((Q, R, {"sample_time": one}, "sample time") for one in (0.0, -0.005, np.nan)),
    ],
)
def test_invalid_arguments_are_refused(model, q, r, more, sentence):
    with pytest.raises(InputError, match=sentence):
        lqr(model, q, r, **more)


def test_a_number_or_a_diagonal_stands_for_a_matrix_and_python_controls_state_space_for_a_model(model):
    expected = lqr(model, np.diag(Q), np.diag(R)).gain
    for one, r in ((model, R[0]), (model, R), (model.linearize().to_control(), R)):
        np.testing.assert_array_equal(lqr(one, Q, r).gain, expected)


def test_unstabilisable_systems_are_refused(model):
    space = model.linearize()
    unreached = Matrices(block_diag(space.A, [[2.5]]), np.vstack([space.B, np.zeros(3)]))
    with pytest.raises(InputError, match=r"2\.5 rad/s"):
        lqr(unreached, np.append(Q, 1.0), R)


@pytest.mark.parametrize("robot", ["alten", "cmu"])
def test_sample_time_typed_in_milliseconds_is_refused(robot):
    count = Model(robot).robot.wheel_count
    with pytest.raises(InputError, match=r"sample time is 5 s.* stability margin; did you mean 0.005 s\?"):
        lqr(robot, Q, np.full(count, 30.0), sample_time=5)
    with pytest.raises(InputError, match=r"sample time is 0.6 s.* stability margin; shorten it"):
        lqr(robot, Q, np.full(count, 30.0), sample_time=0.6)
    with pytest.raises(InputError, match=r"did you mean 0.005 s\?"):
        Controller(robot, np.zeros((count, 10)), sample_time=5)
    # a slow loop that has a margin of a tenth and more
    design = lqr(robot, Q, np.full(count, 30.0), sample_time=0.1)
    refuse_without_margin(Controller(robot, design.gain, sample_time=0.1))


def test_slow_plant_may_be_sampled_slowly():
    tank = Matrices(A=np.array([[-0.001]]), B=np.array([[1.0]]))
    assert lqr(tank, [1.0], [1.0], sample_time=50.0).poles.real.max() < 0.0
