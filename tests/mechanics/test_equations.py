"""The compiled equations of motion: against SymPy's Lagrangian, numeric derivatives and conservation laws."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ballbot import InputError, Model
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.state import STATE_NAMES
from tests.support.control_examples import FRICTION, alten
from tests.support.lagrangian import equations
from tests.support.symbolic_oracle import random_robot, random_state


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["exact", "thesis"])
@pytest.mark.parametrize("wheel_count", [3, pytest.param(4, marks=pytest.mark.sample)])
def test_equations_equal_the_symbolic_lagrangian(formulation, wheel_count):
    rng = np.random.default_rng(7)
    for _ in range(15):
        robot = random_robot(rng, wheel_count)
        q, q_dot, u = random_state(rng, wheel_count)
        model, oracle = Model(robot, formulation), equations(robot, formulation)
        # required: 1e-9; both sides are float64 sums of a few hundred terms
        scale = np.abs(oracle.acceleration(q, q_dot, u)).max()
        assert_allclose(
            model.acceleration(q, q_dot, u), oracle.acceleration(q, q_dot, u), rtol=1e-9, atol=1e-10 * scale
        )
        assert_allclose(model.mass_matrix(q), oracle.dynamics(q, q_dot, u)[0], rtol=1e-11, atol=1e-13)
        assert_allclose(model.wheel_speed(q, q_dot), oracle.wheel_speed(q, q_dot), rtol=1e-11, atol=1e-12)
        assert_allclose(model.wheel_jacobian(q) @ q_dot, oracle.wheel_speed(q, q_dot), rtol=1e-11, atol=1e-12)
        if formulation == "exact":
            assert model.energy(q, q_dot) == pytest.approx(oracle.energy(q, q_dot), rel=1e-11)


@pytest.mark.parametrize(("formulation", "pole"), [("exact", 5.20), ("thesis", 3.625)])
def test_unstable_pole(formulation, pole):
    # 5.20 rad/s as it is, 3.63 (3.625) as printed
    assert Model(alten(), formulation).linearize().poles()[0].real == pytest.approx(pole, abs=0.005)


@pytest.mark.parametrize("formulation", ["exact", "thesis"])
def test_linear_model_is_the_derivative_of_the_nonlinear_one(formulation):
    model = Model(alten(FRICTION), formulation)
    linear = model.linearize()

    def rates(x, u):
        return np.concatenate([x[5:], model.acceleration(x[:5], x[5:], u)])

    eps = 1e-6  # central differences: the error is of order eps^2 and rounding over eps, both below 1e-8
    for column in range(10):
        step = eps * np.eye(10)[column]
        slope = (rates(step, np.zeros(3)) - rates(-step, np.zeros(3))) / (2 * eps)
        assert_allclose(linear.A[:, column], slope, atol=1e-7)
    for column in range(3):
        step = eps * np.eye(3)[column]
        slope = (rates(np.zeros(10), step) - rates(np.zeros(10), -step)) / (2 * eps)
        assert_allclose(linear.B[:, column], slope, atol=1e-7)


def test_linear_model_converts_to_python_control():
    control = pytest.importorskip("control")
    linear = Model(alten()).linearize()
    system = linear.to_control()
    assert isinstance(system, control.StateSpace)
    assert_allclose(np.sort(system.poles().real), np.sort(linear.poles().real), atol=1e-9)
    assert system.input_labels == ["u1", "u2", "u3"]
    assert system.state_labels == system.output_labels == [*STATE_NAMES]
    torque_to_lean = system["theta", "u2"]  # python-control's own choice by names
    assert_allclose(torque_to_lean(1j), (system(1j))[STATE_NAMES.index("theta"), 1], rtol=1e-12)


@pytest.mark.parametrize("axis", [2, 3])
def test_energy_is_kept_in_a_fall(axis):
    model = Model(alten())
    state = 0.01 * np.eye(10)[axis]
    start = model.energy(state[:5], state[5:])
    while max(abs(state[2:4])) < 1.2:
        state = model.advance(state, np.zeros(3), 1e-3)
    # required: 1e-8 over a fall in RK4 at 1 ms
    assert model.energy(state[:5], state[5:]) == pytest.approx(start, rel=1e-8)


def test_a_simulation_past_the_largest_lean_ends_and_reports_the_sample():
    model = Model(alten())
    state = np.zeros(10)
    state[2] = 0.3
    lanes = Lanes(parameters=model.packed[None], initial=state[None], torques=np.zeros((1, 400, 3)))
    batch = simulate_lanes(model.selected, lanes, sample_time=0.005, steps=5)
    assert 0 < batch.ended[0] < 400
    assert 1.2 < abs(batch.states[0, -1, 2]) < 1.22
    assert (batch.states[0, batch.ended[0]] == batch.states[0, -1]).all()
    with pytest.raises(InputError, match=r"lean .* below 1\.2 rad"):
        model.advance(batch.states[0, -1], np.zeros(3), 0.005)


@pytest.mark.parametrize(
    ("use", "sentence"),
    [
        (lambda model: replace(model, formulation="newton"), "must be 'exact' or 'thesis'"),
        (lambda model: replace(model, step=float("nan")), "positive time"),
        (lambda model: model.wheel_speed(np.zeros(5), np.zeros(4)), r"q_dot has the shape \(4,\).* be 5"),
    ],
)
def test_a_wrong_model_or_shape_is_refused(use, sentence):
    with pytest.raises(InputError, match=sentence):
        use(Model(alten()))
