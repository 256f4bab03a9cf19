"""A friction law that a user registers: in robot files, in the equations, at rest, and refused."""

# ruff: noqa: ARG001, ARG005 (a law has the arguments speed and load, whether it uses them or not)

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballbot import InputError, LawParameter, Model, Robot, register_friction_law, simulate_batch
from ballbot.control.friction_table import LARGEST_ERROR, friction_table
from ballbot.control.overcompensation import cautious_friction, compensation_margin
from ballbot.control.presets import nominal_controller
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot import Friction
from ballbot.robot.components import scaled_friction
from ballbot.simulation.driveline import Driveline, simulate_driveline
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.upside_down import ClampedBall, simulate_balls
from ballbot.twin import Scenario
from ballbot.twin.driveline import TwinDriveline
from ballbot.twin.engine import Engine
from ballbot.twin.mjcf import twin_mjcf
from ballbot.twin.scenario_file import load_scenario, scenario_text
from tests.support.friction_law_examples import FRICTION, dry, robot_by_law

STATE = np.array([0.0, 0.0, 0.02, 0.01, 0.3, 0.3, -0.1, 0.2, 0.1, 0.6])
TORQUES = np.array([0.3, -0.2, 0.25])


def test_law_survives_the_robot_file_and_its_parameters_are_stated_as_any_other(tmp_path):
    robot = robot_by_law().annotated(sources={"friction.own.quadratic": "measured: by hand"})
    robot = robot.annotated(standard_deviations={"friction.own.quadratic": (1e-4, 2e-4, 3e-4)})
    robot.write(tmp_path / "robot.toml")
    read = Robot.load(tmp_path / "robot.toml")
    assert read == robot
    assert read.sources["friction.own.quadratic"] == "measured: by hand"
    assert read.standard_deviations == robot.standard_deviations
    assert read.replace({"friction.own.teeth": 0.2, "friction.own.quadratic": 1e-3}).friction.own == (
        ("quadratic", (1e-3,) * 3),
        ("teeth", 0.2),
    )


def test_law_of_a_python_file_beside_the_robot_s_is_found_from_any_folder(tmp_path):
    lines = ("import ballbot", "def flat(speed, load, coulomb):", "    return coulomb")
    (tmp_path / "laws.py").write_text("\n".join([*lines, "ballbot.register_friction_law(flat)"]))
    robot = Robot.load("alten").replace({"friction.coulomb": 0.1, "friction.law": f"{tmp_path}/laws.py:flat"})
    robot.write(tmp_path / "robot.toml")
    text = (tmp_path / "robot.toml").read_text().replace(f"{tmp_path}/", "")
    assert 'law = "laws.py:flat"' in text
    (tmp_path / "robot.toml").write_text(text)
    program = "import sys, ballbot; print(ballbot.Robot.load(sys.argv[1]).friction.breakaway)"
    command = [sys.executable, "-c", program, tmp_path / "robot.toml"]
    assert subprocess.check_output(command, text=True, cwd="/") == "(0.1, 0.1, 0.1)\n"


def test_motion_is_that_of_an_integrator_of_another_library():
    """While no wheel stops, SciPy's DOP853 solves the equations of the bare robot with the friction as a torque."""
    model, bare = Model(robot_by_law(), step=5e-4), Model(robot_by_law().replace(friction=Friction.none(3)))

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        q, q_dot, v = x[:5], x[5:], x[5:7]
        w = bare.wheel_speed(q, q_dot)
        net = TORQUES - np.array(FRICTION.viscous) * w - dry(w, TORQUES) * np.sign(w)
        push = np.zeros(5)
        push[:2] = -robot_by_law().rolling_force * v / np.linalg.norm(v)
        return np.concatenate(
            [q_dot, bare.acceleration(q, q_dot, net) + np.linalg.solve(bare.mass_matrix(q), push)]
        )

    wanted = solve_ivp(rate, (0.0, 0.05), STATE, method="DOP853", rtol=1e-12, atol=1e-12)
    speeds = np.array([bare.wheel_speed(x[:5], x[5:]) for x in wanted.y.T])
    assert (np.sign(speeds) == np.sign(speeds[0])).all()
    # RK4 of 0.5 ms: 1e-13 of its own error, and the rounding of a hundred steps
    np.testing.assert_allclose(model.advance(STATE, TORQUES, 0.05), wanted.y[:, -1], rtol=0, atol=1e-11)


@pytest.mark.parametrize("share", [0.98, 1.1])
def test_wheels_hold_up_to_the_law_s_break_away_torque(share):
    """Upright and at rest the wheels' torques have to exceed c + s + m |u|."""
    limit = (np.array(FRICTION.coulomb) + np.array(FRICTION.stribeck)) / (1.0 - 0.1)
    end = Model(robot_by_law()).advance(np.zeros(10), share * limit, 0.1)
    assert (end == 0.0).all() == (share < 1.0)


def test_scaled_friction_is_so_many_times_the_law_and_twice_the_friction_is_compensated_twice():
    speeds = np.array([[0.2, -1.0, 3.0]])
    once, twice = (
        wheel_friction(speeds, one, torque=TORQUES) for one in (FRICTION, scaled_friction(FRICTION, 2.0))
    )
    np.testing.assert_allclose(twice, 2.0 * once, rtol=1e-14)
    full = nominal_controller(robot_by_law(), compensation="full")
    margin = compensation_margin(full, scaled_friction(FRICTION, 0.5))
    assert margin.largest == pytest.approx(2.0)


def test_friction_that_is_uncertain_by_the_law_s_own_parameter_is_compensated_less():
    covariance = np.zeros((25, 25))
    assert cautious_friction(FRICTION, covariance) == FRICTION
    covariance[21, 21] = 0.004**2  # b_2 of the first wheel
    cautious = cautious_friction(FRICTION, covariance)
    quadratic = np.array(dict(cautious.own)["quadratic"])
    assert quadratic[0] < 0.004
    assert quadratic[1:].tolist() == [0.006, 0.005]


def test_table_is_the_law_within_its_error_and_a_law_with_a_step_is_refused():
    table = friction_table(robot_by_law())
    assert table.error < 0.5 * LARGEST_ERROR
    np.testing.assert_allclose(table.load, 0.1)
    speeds = np.random.default_rng(0).uniform(0.0, table.speeds[-1], 1000)
    found = np.array([np.interp(speeds, table.speeds, row) for row in table.sizes]).T
    np.testing.assert_allclose(found, dry(np.repeat(speeds[:, None], 3, axis=1), 0.0), rtol=table.error)

    def step(speed, load, coulomb):
        return coulomb * np.where(speed < 1.0, 2.0, 1.0)

    register_friction_law(step)
    robot = Robot.load("alten").replace({"friction.coulomb": 0.1, "friction.law": "step"})
    with pytest.raises(InputError, match=r"cannot be compensated: .* \d+ % of the friction; at most 2 %"):
        nominal_controller(robot, compensation="full")


@pytest.mark.parametrize(
    ("law", "parameters", "words"),
    [
        (lambda w, load: w, (), "they must be speed, load"),
        (lambda speed, load, roughness: roughness, (), "each described or one of"),
        (
            lambda speed, load, quadratic: speed**2 * quadratic,
            (LawParameter(name="quadratic", symbol="q", meaning="other", usual=(0.0, 1.0), default=0.0),),
            "another parameter quadratic",
        ),
        (lambda speed, load, coulomb: coulomb + 0.1, (), "not proportional to coulomb"),
    ],
)
def test_functions_that_are_no_law_are_refused(law, parameters, words):
    with pytest.raises(InputError) as refusal:
        register_friction_law(law, parameters=parameters, name="refused")
    assert words in str(refusal.value)


def test_function_that_cannot_be_compiled_is_refused_with_what_it_may_use():
    def branching(speed, load, coulomb):
        return coulomb if np.all(speed < 1.0) else 2.0 * coulomb

    register_friction_law(branching)
    with pytest.raises(InputError, match=r"branching cannot be compiled: .*np\.where"):
        Model(Robot.load("alten").replace({"friction.law": "branching"}))


def test_robots_that_contradict_their_law_are_refused():
    robot = robot_by_law()
    for change, words in (
        ({"own": ()}, "has the parameters ['quadratic', 'teeth']"),
        ({"load": (0.1, 0.1, 0.1)}, "terms of the classical law"),
        ({"law": "toothet"}, "did you mean 'toothed'"),
        ({"own": (("quadratic", (-1.0, 0.0, 0.0)), ("teeth", 0.0))}, "friction.own.quadratic[0] is -1"),
    ):
        with pytest.raises(InputError) as refusal:
            robot.replace(friction=replace(FRICTION, **change))
        assert words in str(refusal.value)


@pytest.mark.sample
def test_loop_with_gear_play_and_sensors_runs_under_the_law():
    robot = robot_by_law()
    controller, play = nominal_controller(robot, compensation="full"), Imperfections(backlash=np.radians(1.0))
    run = simulate_batch(Model(robot), controller, "hold", duration=1.0, imperfections=play)
    assert np.abs(run.states[0, :, 2:4]).max() < 0.1


def test_twin_has_the_friction_of_the_law_and_its_scenario_file_states_it(tmp_path):
    scenario = replace(Scenario.nominal("alten"), friction=FRICTION)
    engine = Engine(twin_mjcf(Robot.load("alten"), scenario))
    driveline = TwinDriveline(Robot.load("alten"), scenario, engine)
    driveline.speeds[:] = speeds = np.array([1.5, -0.3, 8.0])
    torques = np.array([0.5, -1.0, 0.2])
    driveline.command(torques)
    driveline.prepare_step()
    sizes = engine.dry_friction[engine.velocities("wheel", 3)]
    np.testing.assert_allclose(sizes, dry(speeds, torques), rtol=1e-12)
    (tmp_path / "toothed.toml").write_text(scenario_text(replace(scenario, name="toothed")))
    assert load_scenario(tmp_path / "toothed.toml", "alten").friction == FRICTION
    for text, words in (
        ('[friction]\nlaw = "toothet"', "did you mean 'toothed'"),
        (
            '[friction]\nlaw = "toothed"\nown.quadratic = [-1.0, 0.0, 0.0]',
            r"friction.own.quadratic\[0\] is -1",
        ),
        ("[friction]\nown.quadratic = [0.0, 0.0, 0.0]", "friction.own.quadratic is no parameter of the law"),
    ):
        (tmp_path / "wrong.toml").write_text(text)
        with pytest.raises(InputError, match=words):
            load_scenario(tmp_path / "wrong.toml", "alten")


def test_driveline_and_ball_upside_down_turn_by_the_law():
    """SciPy's DOP853 under the formula, while no wheel changes its sign."""
    robot, line = robot_by_law(), Driveline.of_wheel(robot_by_law(), 1)
    ball, torques = ClampedBall.of_robot(robot), np.array([0.5, -0.4, 0.45])
    starts = np.array([3.0, -2.0, 4.0])
    start = np.linalg.solve(ball.A, starts)

    def rate(_: float, omega: np.ndarray) -> np.ndarray:
        w = ball.A @ omega
        return ball.push() @ (torques - np.array(FRICTION.viscous) * w - dry(w, torques) * np.sign(w))

    def spin(_: float, w: np.ndarray) -> np.ndarray:
        return (torques[1] - FRICTION.viscous[1] * w + dry(np.full(3, w), torques)[1]) / line.inertia

    common = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}
    wanted = solve_ivp(rate, (0.0, 0.2), start, **common)
    alone = solve_ivp(spin, (0.0, 0.2), [-2.0], **common)
    omega = simulate_balls(
        ball, friction=FRICTION, initial=[start], torques=[np.tile(torques, (40, 1))], sample_time=0.005
    )
    np.testing.assert_allclose(omega[0, -1], wanted.y[:, -1], rtol=1e-9)
    motion = simulate_driveline(line, np.full(40, torques[1]), sample_time=0.005, initial_speed=-2.0)
    assert motion.speeds[-1] == pytest.approx(alone.y[0, -1], rel=1e-9)
    # it holds up to c + s + m |u|
    limit = sum(FRICTION.coulomb[1:2] + FRICTION.stribeck[1:2]) / (1.0 - 0.1)
    for share in (0.999, 1.001):
        moved = simulate_driveline(line, np.full(20, share * limit), sample_time=0.005).speeds.any()
        assert moved == (share > 1.0)
