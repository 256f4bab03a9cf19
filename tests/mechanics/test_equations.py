"""The compiled equations of motion: against SymPy's Lagrangian, conservation laws and RK4's order."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ballbot import InputError, Model, Robot
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Friction
from ballbot.state import STATE_NAMES
from tests.support.control_examples import FRICTION
from tests.support.lagrangian import equations
from tests.support.normal_force import normal_force
from tests.support.symbolic_oracle import random_robot, random_state


def alten(friction: Friction | None = None) -> Robot:
    robot = Robot.load("alten")
    return robot.replace(friction=friction) if friction else robot


@pytest.mark.slow
@pytest.mark.parametrize(
    ("formulation", "wheel_count"),
    [
        ("exact", 3),
        ("thesis", 3),
        *(pytest.param(name, 4, marks=pytest.mark.sample) for name in ("exact", "thesis")),
    ],
)
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
        assert_allclose(model.mass_matrix(q), oracle.mass_matrix(q), rtol=1e-11, atol=1e-13)
        assert_allclose(model.wheel_speed(q, q_dot), oracle.wheel_speed(q, q_dot), rtol=1e-11, atol=1e-12)
        assert_allclose(model.wheel_jacobian(q) @ q_dot, oracle.wheel_speed(q, q_dot), rtol=1e-11, atol=1e-12)
        if formulation == "exact":
            assert model.energy(q, q_dot) == pytest.approx(oracle.energy(q, q_dot), rel=1e-11)


def test_leading_shapes_are_kept():
    model = Model(alten())
    q, q_dot, u = np.zeros((2, 3, 5)), np.zeros(5), np.zeros((3, 3))
    assert model.acceleration(q, q_dot, u).shape == (2, 3, 5)
    assert model.mass_matrix(q).shape == (2, 3, 5, 5)
    assert model.wheel_speed(q, q_dot).shape == (2, 3, 3)
    assert model.energy(q, q_dot).shape == (2, 3)
    assert model.energy(np.zeros(5), q_dot).shape == ()


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


def test_the_rotors_neglected_cross_term_is_small():
    """n j_m times the rotor's speed and the body's rate about the axle, which the wheel's positive turning opposes."""
    robot, model = Robot.load("alten"), Model(Robot.load("alten"))
    D = transforms(robot).T_owb.T @ transforms(robot).T_owb
    D *= robot.drive.gear_ratio * robot.drive.motor_inertia * robot.wheels.radius / robot.ball.radius
    E = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    cross = np.block(
        [[np.zeros((2, 2)), -E.T @ D / robot.ball.radius], [-D.T @ E / robot.ball.radius, 2.0 * D]]
    )
    by_torque = np.asarray(model.linearize().B)[5:]
    change = -np.linalg.solve(model.mass_matrix(np.zeros(5)), cross @ by_torque)
    # the last wheel moves the robot along every coordinate
    shares = np.abs(change / by_torque)[:, 2]
    assert 100.0 * shares.min() == pytest.approx(0.025, abs=0.0005)
    assert 100.0 * shares.max() == pytest.approx(0.165, abs=0.0005)


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
    state = np.zeros(10)
    state[axis] = 0.01
    start = model.energy(state[:5], state[5:])
    while max(abs(state[2:4])) < 1.2:
        state = model.advance(state, np.zeros(3), 1e-3)
    # required: 1e-8 over a fall in RK4 at 1 ms
    assert model.energy(state[:5], state[5:]) == pytest.approx(start, rel=1e-8)


def test_a_simulation_past_the_largest_lean_ends_and_reports_the_sample():
    model = Model(alten())
    state = np.zeros(10)
    state[2] = 0.3
    batch = simulate_lanes(
        model.selected,
        Lanes(parameters=model.packed[None], initial=state[None], torques=np.zeros((1, 400, 3))),
        sample_time=0.005,
        steps=5,
    )
    assert 0 < batch.ended[0] < 400
    assert 1.2 < abs(batch.states[0, -1, 2]) < 1.22
    assert (batch.states[0, batch.ended[0]] == batch.states[0, -1]).all()
    with pytest.raises(InputError, match=r"lean .* below 1\.2 rad"):
        model.advance(batch.states[0, -1], np.zeros(3), 0.005)


def test_runge_kutta_has_order_four_away_from_zero_speed():
    """Three wheels and the ball all move one way, so that friction is smooth."""
    robot = alten(FRICTION)
    state = np.array([0, 0, 0.02, -0.03, 0.4, 1.0, 0.3, 0.2, -0.1, 6.0])
    torque = np.array([[0.4, -0.3, 0.5]])

    def end(steps):
        model = Model(robot)
        batch = simulate_lanes(
            model.selected,
            Lanes(parameters=model.packed[None], initial=state[None], torques=torque[None]),
            sample_time=0.16,
            steps=steps,
        )
        return batch.states[0, 0]

    reference = end(2048)
    errors = np.array([np.abs(end(n) - reference).max() for n in (4, 8, 16)])
    assert_allclose(np.log2(errors[:-1] / errors[1:]), 4.0, atol=0.35)


def test_known_sign_friction_is_the_numpy_law():
    """Accelerations with friction, from a short step, against M q_ddot = .. - W^T tau(w) - N C_rr v/|v| in NumPy."""
    rng = np.random.default_rng(3)
    model, free = Model(alten(FRICTION)), Model(alten())
    row = model.packed
    weight = 20.076 * 9.81
    for _ in range(20):
        q = np.concatenate([np.zeros(2), rng.uniform(-1.2, 1.2, 2), rng.uniform(-20, 20, 1)])
        q_dot = rng.uniform(-3, 3, 5)
        speeds = free.wheel_speed(q, q_dot)
        force = free.wheel_jacobian(q).T @ -wheel_friction(speeds, FRICTION)
        force[:2] -= weight * FRICTION.rolling * q_dot[:2] / np.linalg.norm(q_dot[:2])
        expected = free.acceleration(q, q_dot, np.zeros(3)) + np.linalg.solve(free.mass_matrix(q), force)
        h = 1e-6
        batch = simulate_lanes(
            model.selected,
            Lanes(
                parameters=row[None],
                initial=np.concatenate([q, q_dot])[None],
                torques=np.zeros((2, 1, 3)),
            ),
            sample_time=h,
            steps=1,
        )
        slope = (batch.states[0, 0, 5:] - q_dot) / h
        # one-sided difference: h times the jerk (at most some 1e3) and rounding 1e-16 * 20 / h
        assert_allclose(slope, expected, atol=2e-2 * max(1.0, np.abs(expected).max() / 10))


def test_normal_force():
    model = Model(alten())
    assert normal_force(model, np.zeros(5), np.zeros(5), np.zeros(3)) == pytest.approx(20.076 * 9.81)
    # the vertical momentum of the body against a finite difference of its height's rate along a fall
    state = np.array([0, 0, 0.4, 0.3, 0.1, 0.2, -0.1, 0.9, -0.4, 0.3])
    u = np.array([0.3, -0.2, 0.1])
    h = 1e-5

    def height_rate(x):
        t, p = x[2], x[3]
        return 0.393 * (-np.sin(t) * np.cos(p) * x[7] - np.cos(t) * np.sin(p) * x[8])

    after = model.advance(state, u, h)
    expected = 20.076 * 9.81 + 17.076 * (height_rate(after) - height_rate(state)) / h
    assert normal_force(model, state[:5], state[5:], u) == pytest.approx(
        expected, rel=1e-4
    )  # h times the jerk


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"formulation": "newton"}, "must be 'exact' or 'thesis'"),
        ({"step": 0.0}, "positive time"),
        ({"step": float("nan")}, "positive time"),
    ],
)
def test_a_wrong_model_is_refused(change, sentence):
    with pytest.raises(InputError, match=sentence):
        replace(Model(alten()), **change)


def test_wrong_shapes_are_refused():
    with pytest.raises(InputError, match=r"q_dot has the shape \(4,\); its last dimension must be 5"):
        Model(alten()).wheel_speed(np.zeros(5), np.zeros(4))
