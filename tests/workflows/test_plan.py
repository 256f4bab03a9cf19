"""Fast moves: against the exact model between the nodes, bang-bang bounds, and what follows them in closed loop."""

import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import ballbot
from ballbot import InputError, Model, Robot
from ballbot.control.lqr import frictionless_model
from ballbot.control.presets import precise_controller
from ballbot.control.references import read_reference
from ballbot.mechanics.floor import rolling_friction
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.model import contact_momentum
from ballbot.twin import Scenario
from ballbot.workflows.plan import Plan, default_limits, follow

pytest.importorskip("casadi")


@cache
def rough() -> Robot:
    """Return the thesis's robot with the friction of the nominal scenario."""
    robot = Robot.load("alten")
    return robot.replace(friction=Scenario.nominal(robot).friction)


@cache
def move() -> Plan:
    return ballbot.plan(rough(), to=(2.0, 0.0, 0.0))


@cache
def stop() -> Plan:
    return ballbot.plan(rough(), stop_from=1.4)


def inverse_dynamics(plan: Plan):
    """Return the generalised forces that no wheel can give, and the wheels' net torques, along a plan's samples."""
    model, step = frictionless_model(plan.robot), float(plan.t[1])
    q, q_dot = plan.states[1:-1, :5], plan.states[1:-1, 5:]
    q_ddot = (plan.states[2:, 5:] - plan.states[:-2, 5:]) / (2.0 * step)
    none = np.zeros((len(q), plan.robot.wheel_count))
    forces = np.einsum("kij,kj->ki", model.mass_matrix(q), q_ddot - model.acceleration(q, q_dot, none))
    forces[:, :2] -= rolling_friction(q_dot[:, :2], plan.robot.rolling_force, slowest=0.02)
    turns = np.swapaxes(model.wheel_jacobian(q), 1, 2)  # (k, 5, n)
    torques = np.einsum("kij,kj->ki", np.linalg.pinv(turns), forces)
    return forces - np.einsum("kij,kj->ki", turns, torques), torques


def test_states_between_the_nodes_obey_the_exact_model():
    impossible, _ = inverse_dynamics(move())
    # of 18 N m that tip the robot at its largest lean; cubics over intervals of 0.1 s
    assert np.sqrt(np.mean(impossible**2)) < 0.1


def test_motors_torques_of_the_motion_are_within_the_limit():
    plan = move()
    _, net = inverse_dynamics(plan)
    speeds = Model(plan.robot).wheel_speed(plan.states[1:-1, :5], plan.states[1:-1, 5:])
    motors = net + wheel_friction(speeds, plan.robot.friction)
    # the nodes are within 0.8; where the torques change at once, the states between them ask for some of the margin
    assert np.quantile(np.abs(motors), 0.95) < 0.9 * plan.limits.torque
    assert np.quantile(np.abs(motors), 0.99) < plan.limits.torque
    assert plan.used[:, 0].max() < 0.9
    assert plan.bound == "wheel torque"


def test_a_move_starts_and_ends_at_rest_at_its_poses():
    states = move().states
    np.testing.assert_allclose(states[0], 0.0, atol=1e-8)
    np.testing.assert_allclose(states[-1], [2.0, *9 * [0.0]], atol=1e-6)
    assert not states[-1, [2, 3, *range(5, 10)]].any()


def test_a_lean_limit_gives_the_bang_bang_time_of_a_double_integrator():
    """The contact's momentum has s'' = pull lean: rest to rest over d takes 2 sqrt(d / (pull lean)) at least."""
    robot = Robot.load("alten")
    limits = replace(default_limits(robot), torque=6.0, lean=0.05, grip=5.0, margin=0.0)
    plan = ballbot.plan(robot, to=(4.0, 0.0, 0.0), limits=limits)
    least = 2.0 * np.sqrt(4.0 / (contact_momentum(robot).pull[0, 0] * 0.05))
    # three changes of the lean, each of about 0.1 s
    assert least < plan.duration < least + 0.35
    assert plan.bound == "lean"


def test_a_robot_without_friction_follows_its_plan_in_the_equations_of_motion():
    robot = Robot.load("alten")
    plan = ballbot.plan(robot, to=(1.0, 0.5, 0.5))
    log = ballbot.simulate(
        Model(robot),
        precise_controller(robot),
        plan.reference,
        duration=plan.duration + 1.0,
        initial_state=np.zeros(10),
    )
    away = np.hypot(log["x"] - log["ref_x"], log["y"] - log["ref_y"])
    assert log.ended is None
    assert away.max() < 0.01


def test_robots_with_sensors_and_friction_follow_a_plan():
    robot = rough()
    followed = follow(move(), precise_controller(robot), Scenario.nominal(robot), runs=4)
    assert followed.fell == 0
    assert followed.peak_error < 0.06


def test_a_stop_from_the_published_speed_takes_less_than_a_second_and_a_half():
    plan = stop()
    speed = np.hypot(*plan.states[:, 5:7].T)
    assert plan.duration < 1.5
    assert speed[np.searchsorted(plan.t, plan.begins) - 2] == pytest.approx(1.4, abs=1e-3)
    assert speed[-1] == 0.0


def test_the_ball_stays_in_the_corridor_of_a_path():
    angles = np.linspace(0.0, np.pi, 200)
    places = np.column_stack([0.5 * np.sin(angles), 0.5 * (1.0 - np.cos(angles)), np.zeros(200)])
    plan = ballbot.plan(rough(), along=places, corridor=0.03)
    off = np.abs(np.hypot(plan.states[:, 0], plan.states[:, 1] - 0.5) - 0.5)
    along = plan.states[:, 0] > 0.0  # before and after it, the path is straight
    assert off[along].max() < 0.033
    np.testing.assert_allclose(plan.states[-1, :2], [0.0, 1.0], atol=1e-3)


def test_grip_of_the_file_less_two_deviations_limits_a_move():
    stated = replace(rough().replace({"wheels.grip": 0.9}), standard_deviations={"wheels.grip": 0.1})
    assert default_limits(stated).grip == pytest.approx(0.7)
    assert default_limits(rough()).grip == 1.0


def test_an_infeasible_plan_names_the_limit_and_by_how_much():
    slippery = replace(default_limits(rough()), torque=6.0, grip=0.3)
    with pytest.raises(
        InputError, match=r"at least .*: the wheel grip forbids it, .* be 1\.\d\d times as large"
    ):
        ballbot.plan(rough(), to=(1.0, 0.0, 0.0), limits=slippery, within=2.5)
    with pytest.raises(InputError, match=r"motor speed forbids it.*the largest speed in this direction is"):
        ballbot.plan(rough(), stop_from=5.0)
    weak = replace(default_limits(rough()), torque=0.1)
    with pytest.raises(InputError, match="to start against its friction"):
        ballbot.plan(rough(), to=(1.0, 0.0, 0.0), limits=weak)


def test_torques_reverse_gently():
    """A reversal within 50 ms, with a tenth of the weight of the torques' changes, made wheels of the twin slip."""
    plan = stop()
    signs = np.sign(plan.torques[:, 1]) * (np.abs(plan.torques[:, 1]) > 0.7 * plan.torques.max())
    full = np.flatnonzero(signs)
    turns = full[1:][np.diff(signs[full]) != 0] - full[:-1][np.diff(signs[full]) != 0]
    assert len(turns) >= 3
    assert turns.min() * plan.t[1] > 0.08


def test_missing_casadi_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(InputError, match=r"needs CasADi; install it with: pip install 'ballbot\[plan\]'"):
        ballbot.plan(rough(), to=(1.0, 0.0, 0.0))


def test_a_plan_needs_exactly_one_aim():
    with pytest.raises(InputError, match="one of to, along and stop_from"):
        ballbot.plan(rough())
    with pytest.raises(InputError, match="margin"):
        ballbot.plan(rough(), to=(1.0, 0.0, 0.0), limits=replace(default_limits(rough()), margin=1.5))
    with pytest.raises(InputError, match="gives at most 6 N m"):
        ballbot.plan(rough(), to=(1.0, 0.0, 0.0), limits=replace(default_limits(rough()), torque=9.0))
    with pytest.raises(InputError, match="not all zero"):
        ballbot.plan(rough(), to=(0.0, 0.0, 0.0))


def test_a_plan_s_file_and_table_hold_its_states(tmp_path):
    plan = move()
    plan.write(tmp_path / "plan.csv")
    reference = read_reference(tmp_path / "plan.csv")
    for k in (0, 100, len(plan.t) - 1):
        np.testing.assert_allclose(reference(plan.t[k]), plan.states[k], atol=1e-12)
    np.testing.assert_allclose(reference(plan.t[-1] + 5.0), plan.states[-1], atol=1e-12)
    assert plan.c_table().count("{ ") == len(plan.states)
