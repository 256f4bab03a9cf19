"""The controller: its law against NumPy's words for it, and what friction compensation must and must not do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot import Controller, InputError, Model, Robot, simulate
from ballbot.control.presets import design_gain, nominal_controller
from ballbot.log.columns import STATE_NAMES
from ballbot.mechanics.geometry import rotation, transforms
from ballbot.robot import Friction
from ballbot.robot.derived import encoder_step
from tests.support.control_examples import FRICTION, alten, four_wheeled, leaning

finite = st.floats(-1.0, 1.0)
states = st.lists(finite, min_size=10, max_size=10).map(np.array)
poses = st.tuples(finite, finite, finite).map(lambda p: np.array([p[0], p[1], 0, 0, p[2], 0, 0, 0, 0, 0]))
ROBOTS = alten(FRICTION), four_wheeled(friction=True)
#: robots with the gains designed for them
designed = st.deferred(lambda: st.sampled_from([(robot, design_gain(robot).gain) for robot in ROBOTS]))


def encoder_speeds(robot: Robot, state: np.ndarray) -> np.ndarray:
    return Model(robot).wheel_speed(state[:5], state[5:])


def turned_back(vector: np.ndarray, psi: float) -> np.ndarray:
    """S(psi) e: the pairs turned by -psi."""
    turned, back = vector.copy(), rotation(0.0, 0.0, -psi)[:2, :2]
    for first in (0, 2, 5, 7):
        turned[first : first + 2] = back @ vector[first : first + 2]
    return turned


def rolling_force(robot: Robot, state: np.ndarray, band: float) -> np.ndarray:
    """N C_rr v/|v| in the heading frame, its size a ramp below the band's speed."""
    v = (state[5] + 1j * state[6]) * np.exp(-1j * state[4])
    N = (robot.ball.mass + robot.body.mass) * robot.gravity
    force = N * robot.friction.rolling * v / max(abs(v), band * robot.ball.radius)
    return np.array([force.real, force.imag])


@given(
    design=designed,
    state=states,
    pose=poses,
    compensation=st.sampled_from(["none", "full"]),
    limit=st.sampled_from([2.0, 1e3]),
)
def test_law_equals_its_numpy_reference(design, state, pose, compensation, limit):
    robot, gain = design
    controller = Controller(robot, gain, compensation=compensation, torque_limit=limit)
    u = controller.gain @ turned_back(pose - state, state[4])
    if compensation == "full":
        f, w = robot.friction, encoder_speeds(robot, state)
        decay = np.exp(-(np.abs(w / f.stribeck_speed) ** f.stribeck_exponent))
        size = np.array(f.coulomb) + f.stribeck * decay
        u = u + f.viscous * w + size * np.clip(w / controller.speed_band, -1.0, 1.0)
        # the push over the ground of wheel torques u is ((A' u)_y, -(A' u)_x) / r_b; none about the vertical
        x, y = rolling_force(robot, state, controller.speed_band)
        T = robot.ball.radius * np.array([-y, x, 0.0])
        u = u + np.linalg.lstsq(transforms(robot).T_owb.T, T, rcond=None)[0]
    # short polynomials for exp and sin stand in the compiled law, good to 1e-12; gains reach 50 N m/rad
    np.testing.assert_allclose(controller.update(0.0, state, pose), limited(u, limit), rtol=1e-9, atol=1e-9)


def limited(u: np.ndarray, limit: float) -> np.ndarray:
    """The torques scaled about a mean that is what was asked or nearer to zero; far beyond it, each by itself."""
    if np.abs(u).max() <= limit:
        return u
    lean = u - u.mean()
    share = min(1.0, limit / np.abs(lean).max())
    turning = np.clip(u.mean(), -limit - share * lean.min(), limit - share * lean.max())
    falling = max(0.0, 1.0 - 2.0 * share)
    return (1.0 - falling) * (turning + share * lean) + falling * np.clip(u, -limit, limit)


def test_a_wheel_at_its_limit_does_not_turn_the_robot():
    """A lean about the first wheel's axis: the others give less, where limits of their own would turn the robot."""
    controller = Controller(alten(), design_gain(alten()).gain, torque_limit=2.0)
    torques = controller.update(0.0, leaning(0.1), np.zeros(10))
    assert np.abs(torques).max() == pytest.approx(2.0)
    assert torques.sum() == pytest.approx(0.0, abs=1e-9)


@given(design=designed, state=states, pose=poses)
def test_partial_compensation_never_adds_against_the_intended_motion(design, state, pose):
    robot, gain = design
    robot = robot.replace(friction=replace(robot.friction, rolling=0.0))
    u, full, partial = (
        Controller(robot, gain, torque_limit=1e3, compensation=one).update(0.0, state, pose)
        for one in ("none", "full", "partial")
    )
    full, partial = full - u, partial - u
    assert (partial * u >= -1e-9).all()
    helps = u * encoder_speeds(robot, state) > 1e-9
    np.testing.assert_allclose(partial[helps], full[helps], atol=1e-9)
    np.testing.assert_allclose(partial[u * encoder_speeds(robot, state) < -1e-9], 0.0, atol=1e-9)


@given(design=designed, state=states, pose=poses)
def test_partial_rolling_compensation_pushes_forward_or_not_at_all_and_does_not_turn(design, state, pose):
    robot, gain = design
    robot = robot.replace(friction=replace(Friction.none(robot.wheel_count), rolling=0.007))
    u = Controller(robot, gain, torque_limit=1e3).update(0.0, state, pose)
    controller = Controller(robot, gain, torque_limit=1e3, compensation="partial")
    added = controller.update(0.0, state, pose) - u
    T = transforms(robot).T_owb.T @ added
    assert abs(T[2]) < 1e-9
    push = np.array([T[1], -T[0]]) / robot.ball.radius
    wanted = rolling_force(robot, state, controller.speed_band) if np.any(added) else 0.0
    np.testing.assert_allclose(push, wanted, atol=1e-9)
    assert added @ u >= -1e-9


@pytest.mark.parametrize("place", [2, 3, 5, 6, 7, 8, 9])
def test_reference_with_a_lean_or_a_rate_is_refused(place):
    reference = np.zeros(10)
    reference[place] = 1e-3
    with pytest.raises(InputError, match=rf"asks for {STATE_NAMES[place]} = 0\.001.*A r"):
        nominal_controller(alten()).update(0.0, np.zeros(10), reference)


def test_a_flickering_encoder_count_does_not_make_the_motors_chatter():
    robot = alten(replace(FRICTION, viscous=(0.0, 0.0, 0.0), rolling=0.0))
    gain = design_gain(robot).gain
    count = encoder_step(robot) / 0.005
    bare, full = Controller(robot, gain), Controller(robot, gain, compensation="full")
    state = count * np.eye(10)[9]  # turning on the spot: encoder speed is A (0 0 -psi_dot)
    speeds = encoder_speeds(robot, state)
    added = full.update(0.0, state, np.zeros(10)) - bare.update(0.0, state, np.zeros(10))
    break_away = np.add(robot.friction.coulomb, robot.friction.stribeck)
    assert (np.abs(added) <= break_away * np.abs(speeds) / (8.0 * count) + 1e-12).all()
    np.testing.assert_array_equal(full.update(0.0, np.zeros(10), np.zeros(10)), np.zeros(3))


def test_the_robot_stands_still_without_a_limit_cycle():
    robot = alten(FRICTION)
    controller = nominal_controller(robot, compensation="full")
    log = simulate(robot, controller, "hold", duration=20.0, initial_state=leaning(0.01))
    change = np.diff(log.between(10.0, 20.0).torques, axis=0)
    # a sign that flipped from sample to sample would change the torque by twice the break-away torque, 0.3 N m
    assert np.abs(change).max() < 0.1


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"gain": np.zeros((4, 10))}, r"must be \(3, 10\)"),
        ({"gain": np.full((3, 10), np.inf)}, "not finite"),
        ({"sample_time": 0.0}, "sample time"),
        ({"torque_limit": -1.0}, "torque limit"),
        ({"speed_band": np.nan}, "speed band"),
        ({"compensation": "most"}, "'none', 'full' or 'partial'"),
        ({"gain": design_gain(alten())}, "The gain is a LqrDesign; it must be 3 rows of 10 numbers"),
    ],
)
def test_invalid_controllers_are_refused(values, sentence):
    with pytest.raises(InputError, match=sentence):
        Controller(alten(), **{"gain": np.zeros((3, 10)), **values})
