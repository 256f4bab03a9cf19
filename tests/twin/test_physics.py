"""The twin's parts against laws written down without it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ballbot.mechanics.geometry import quaternion_of, rotation, transforms
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.twin import Scenario, Twin, twin_mjcf
from ballbot.twin.engine import Engine, attitude_of, body_rate
from ballbot.twin.faults import Softness
from ballbot.twin.parts import split_robot
from ballbot.twin.recording import twin_findings
from tests.support.twin_examples import ALTEN, INERTIA, block_of, lone_ball, turn, wheels_in_the_air


@pytest.mark.parametrize("scenario", Scenario.names())
def test_locked_twin_has_the_robot_s_mass_and_inertia(scenario: str) -> None:
    """With every wheel and roller locked, the body's block of MuJoCo's mass matrix is the robot file's."""
    engine = Engine(twin_mjcf(ALTEN, Scenario.named(scenario, ALTEN)))
    ml = ALTEN.body.mass * ALTEN.body.center_of_mass
    expected = np.zeros((6, 6))
    expected[:3, :3] = ALTEN.body.mass * np.eye(3)
    expected[3:, 3:] = [[4.37, 0, 0], [0, 4.37, 0], [0, 0, 0.193]]  # Appendix III, about the ball's centre
    expected[0, 4], expected[1, 3] = ml, -ml
    expected = np.triu(expected) + np.triu(expected, 1).T
    assert_allclose(block_of(engine, "body"), expected, atol=1e-12)  # sums of some sixty parts, rounding only
    assert_allclose(np.diag(block_of(engine, "ball")), 3 * [3.0] + 3 * [0.0242], rtol=1e-12)


def test_wheels_are_lighter_than_discs_if_the_body_is_too_light_for_them() -> None:
    """The published body of rob311 weighs less than three discs of its wheels' inertia would."""
    robot = Robot.load("rob311")
    wheel, rest = split_robot(robot, robot.wheels.rollers, point=False)
    assert wheel.mass < 2.0 * robot.wheels.inertia / robot.wheels.radius**2
    assert rest.mass + 3.0 * wheel.mass == pytest.approx(robot.body.mass)
    assert wheel.inertia()[2, 2] == pytest.approx(robot.wheels.inertia)
    engine = Engine(twin_mjcf(robot, Scenario.nominal(robot)))
    inertia = block_of(engine, "body")[3:, 3:]  # sums of some sixty parts, rounding only
    assert_allclose(inertia, robot.body.inertia_about_ball_center(), atol=1e-12)


def test_robots_that_record_would_refuse_are_found() -> None:
    wheels = replace(ALTEN.wheels, rollers=replace(ALTEN.wheels.rollers, rows=3))
    (found,) = twin_findings(ALTEN.replace(wheels=wheels))
    assert (found.code, found.severity) == ("robot-twin", "warning")
    assert "one or two rows of rollers, not 3" in found.text


def test_free_wheel_slows_down_by_the_stribeck_law() -> None:
    """(j_w + j_r) w_dot = -tau(w), against scipy's solution, from 8 rad/s to rest at zero."""
    scenario = replace(Scenario.nominal(ALTEN), backlash=0.0)
    engine, driveline = wheels_in_the_air(scenario)
    driveline.speeds[:] = 8.0

    def slow_down(_t: float, w: NDArray[np.float64], i: int) -> NDArray[np.float64]:
        b, c, s = (0.014, 0.016, 0.013)[i], (0.11, 0.09, 0.12)[i], (0.05, 0.04, 0.06)[i]
        return -(b * w + c + s * np.exp(-((np.abs(w) / 0.6) ** 1.1))) / INERTIA

    speeds = turn(engine, driveline, np.zeros(3), 900)  # the slowest wheel stops after 0.19 s
    for i in range(3):
        solution = solve_ivp(slow_down, (0, 0.1), [8.0], args=(i,), rtol=1e-9, atol=1e-9)
        # a first-order step of 0.5 ms errs by up to half a step of the deceleration, some 100 rad/s^2
        assert speeds[199][i] == pytest.approx(solution.y[0, -1], abs=0.03)
    assert np.abs(speeds[-1]).max() < 1e-6


def test_wheel_breaks_away_at_the_static_torque() -> None:
    scenario = replace(Scenario.nominal(ALTEN), backlash=0.0)
    for torque, moves in ((0.95, False), (1.05, True)):
        engine, driveline = wheels_in_the_air(scenario)
        speeds = np.array(turn(engine, driveline, torque * np.array([0.16, 0.13, 0.18]), 1000)[-1])  # c + s
        # half a second at a thousandth would be 0.03 degrees
        assert (speeds > 0.1).all() if moves else np.abs(speeds).max() < 1e-3


def test_wheel_follows_rotor_after_the_play() -> None:
    """Turning a rotor slowly to and fro, its wheel stays within half the play, and uses all of it."""
    scenario = Scenario.nominal(ALTEN)
    engine, driveline = wheels_in_the_air(scenario)
    play = engine.positions("play", 3)
    seen = []
    for k in range(4000):
        turn(engine, driveline, np.full(3, 0.4 * np.sin(2 * np.pi * 2.0 * k * scenario.timestep)), 1)
        seen.append(engine.qpos[play].copy())
    half = np.radians(0.5)
    for wheel in np.array(seen).T:
        assert wheel.max() == pytest.approx(half, rel=0.15)  # struck stops give a little
        assert wheel.min() == pytest.approx(-half, rel=0.15)


@pytest.mark.parametrize("direction", [0.0, 0.7])
def test_rolling_ball_slows_by_its_rolling_friction_and_stops(direction: float) -> None:
    """m v_dot + (j/r^2) v_dot = -N C_rr: the same deceleration at any speed, then rest."""
    engine = lone_ball(ALTEN, Scenario.nominal(ALTEN))
    forward = np.array([np.cos(direction), np.sin(direction)])
    engine.qvel[:2] = 0.2 * forward
    engine.qvel[3:5] = 0.2 / 0.11 * np.array([-forward[1], forward[0]])
    deceleration = 0.007 * 3.0 * 9.81 / (3.0 + 0.0242 / 0.11**2)
    speeds = []
    for _ in range(12000):
        engine.step()
        speeds.append(engine.qvel[:2] @ forward)
    t = 0.0005 * (1 + np.arange(12000))
    rolling = t < 4.0  # it stops at 4.85 s
    # 1 mm/s: the ball settles into the soft floor at the start
    assert_allclose(np.array(speeds)[rolling], 0.2 - deceleration * t[rolling], atol=1e-3)
    assert abs(speeds[-1]) < 1e-5


def test_pivoting_ball_slows_by_its_pivoting_friction() -> None:
    engine = lone_ball(ALTEN, Scenario.nominal(ALTEN))
    for _ in range(200):  # settle
        engine.step()
    engine.qvel[5] = 10.0
    for _ in range(40):
        engine.step()
    expected = 10.0 - 0.02 * 3.0 * 9.81 / 0.0242 * 0.02  # N times 0.02 m over j_b, for 20 ms
    assert engine.qvel[5] == pytest.approx(expected, rel=0.02)


def test_ball_turns_the_wheels_by_the_kinematics() -> None:
    """Encoders see A (z - w), signs and all, while ball and body roll freely; slip and softness remain.

    The rows are 0.1 mm apart here. At the nominal 6 mm a row meets the ball 1.4 degrees off the plane,
    which changes the lever by 2.5 % to and fro.
    """
    scenario = replace(
        Scenario.ideal(ALTEN), rollers=replace(Scenario.ideal(ALTEN).rollers, row_spacing=1e-4)
    )
    twin = Twin(ALTEN, scenario)
    state = np.array([0, 0, 0.0, 0, 0.4, 0.3, -0.2, 0.0, 0.0, 0.8])
    twin.reset(state, seed=2)
    A = transforms(ALTEN).T_owb
    errors, speeds = [], []
    for _ in range(40):
        m = twin.step(np.zeros(3), 0.005)
        x, y_dot = m.truth, m.truth[6]
        omega = np.array([-y_dot, x[5], 0.0]) / 0.11
        z = rotation(*x[2:5]).T @ omega
        expected = A @ (z - body_rate(x))
        errors.append(m.wheel_speeds - expected)
        speeds.append(expected)
    assert np.abs(speeds).max() > 2.0
    # rollers' ends leave the wheel's circle by some 40 um, contacts creep, counts are
    # 0.02 rad/s a sample: 1 % of the largest speed
    assert np.sqrt(np.mean(np.square(errors))) < 0.01 * np.abs(speeds).max()


def test_twin_becomes_the_exact_model_as_contacts_get_stiffer_and_steps_shorter() -> None:
    """Two independent mechanics, MuJoCo's contacts and the Lagrangian, meet: 0.3 s open loop, single-point wheels."""
    start = np.array([0, 0, 0.03, -0.02, 0.3, 0.1, -0.05, 0.05, 0.02, 0.4])
    times = 0.005 * np.arange(60)
    torques = 0.5 * np.stack([np.sin(9 * times), np.sin(7 * times + 1), np.cos(8 * times)], axis=1)
    model, exact = Model(ALTEN, step=1e-4), [start]
    for u in torques:
        exact.append(model.advance(exact[-1], u, 0.005))

    def errors(step: float) -> list[float]:
        scenario = replace(
            Scenario.ideal(ALTEN), wheel_contact="point", pivoting=10.0, floor_grip=2.0, roller_grip=2.0,
            timestep=step, contact_time=2 * step,
            softness=Softness(stiffness=0.025 / step**2, damping=0.15 / step),
        )  # fmt: skip
        twin = Twin(ALTEN, scenario)
        twin.reset(start, seed=1)
        off = np.abs([twin.step(u, 0.005).truth for u in torques] - np.array(exact[1:])).max(axis=0)
        return [part.max() for part in np.split(off, (2, 5, 7))]

    found = np.array([errors(5e-4 / 2**k) for k in range(4)])
    assert (found[1:] < 0.6 * found[:-1]).all()  # measured: 0.25 to 0.5 at each halving
    # a hundredth of the motion's 0.03 m, 0.17 rad, 0.14 m/s and 1.5 rad/s
    assert (found[-1] < [1e-5, 3e-4, 1e-3, 2e-3]).all()


def test_attitude_and_quaternion_agree_with_scipy() -> None:
    random = np.random.default_rng(5)
    for angles in random.uniform(-1.2, 1.2, (200, 3)):
        angles[2] *= 6.0
        by_scipy = Rotation.from_euler("XYZ", angles)
        mine = quaternion_of(*angles)
        assert_allclose(Rotation.from_quat(np.roll(mine, -1)).as_matrix(), by_scipy.as_matrix(), atol=1e-12)
        assert_allclose(attitude_of(mine, near_psi=angles[2] + 2.0), angles, atol=1e-12)
