"""What a log shows: the ball's rotation and the wheels against other ways to them, peaks, refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.viewer.motion import INTERVAL, LONGEST, integrated_rotation, motion_of
from tests.support.control_examples import FRICTION, alten
from tests.support.log_examples import smooth_log, with_wheels

ALTEN = Robot.load("alten")


def upright(t, **columns):
    zero = np.zeros_like(t)
    return Log({"t": t, **dict.fromkeys(("x", "y", "theta", "phi", "psi"), zero), **columns})


def test_ball_that_rolls_forward_turns_about_left():
    radius = ALTEN.ball.radius
    t = np.linspace(0.0, 2.0, 401)
    motion = motion_of(upright(t, x=np.pi * radius * t), ALTEN)  # one turn
    turns = Rotation.from_quat(np.column_stack([motion.columns[f"ball_{name}"] for name in "xyzw"]))
    assert motion.rows == 101
    # what was on top is in front after a quarter turn; a speed that stays the same is integrated exactly
    np.testing.assert_allclose(turns[25].apply([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(turns[-1].apply([0.0, 0.0, 1.0]), [0.0, 0.0, 1.0], atol=1e-9)


def test_integrated_rotation_is_the_product_of_the_turns():
    turns = np.random.default_rng(1).normal(0.0, 0.3, (200, 3))
    quaternions = integrated_rotation(turns)
    product = Rotation.identity()
    for turn in turns:
        product = Rotation.from_rotvec(turn) * product
    found = Rotation.from_quat(quaternions[-1][[1, 2, 3, 0]])
    assert (found.inv() * product).magnitude() < 1e-12  # rounding of 200 products
    assert (np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.0).all()


def test_no_peak_of_a_torque_is_lost():
    t = 0.001 * np.arange(1001)
    torque = np.zeros_like(t)
    torque[517], torque[803] = 4.0, -3.0
    columns = motion_of(upright(t, u1=torque, u2=0 * t, u3=0 * t), ALTEN).columns
    assert columns["u1_high"].max() == 4.0
    assert columns["u1_low"].min() == -3.0
    assert columns["torque_high"].max() == 4.0
    assert columns["u1_high"][10] == columns["u1_low"][10] == 0.0


def test_gap_in_a_pose_is_bridged_and_noted():
    t = np.linspace(0.0, 1.0, 101)
    phi = 0.1 * t
    phi[40:50] = np.nan
    motion = motion_of(upright(t, phi=phi), ALTEN)
    np.testing.assert_allclose(motion.columns["phi"], 0.1 * INTERVAL * np.arange(motion.rows), atol=1e-12)
    assert any("phi" in note for note in motion.notes)


def test_heading_that_wraps_turns_on():
    t = np.linspace(0.0, 4.0, 401)
    psi = (2.0 * t + np.pi) % (2.0 * np.pi) - np.pi
    assert motion_of(upright(t, psi=psi), ALTEN).columns["psi"][-1] == pytest.approx(8.0)


def test_friction_pushes_against_the_motion():
    log = with_wheels(smooth_log(), ALTEN)
    columns = motion_of(log, alten(FRICTION)).columns
    moving = np.abs(columns["wheel1_dot"]) > 0.1
    assert (columns["friction1"] * columns["wheel1_dot"])[moving].min() > 0.0
    t = log.t[0] + INTERVAL * np.arange(len(moving))
    x_dot, y_dot = (np.interp(t, log.t, log[name]) for name in ("x_dot", "y_dot"))
    assert (columns["floor_x"] * x_dot + columns["floor_y"] * y_dot).max() < 0.0
    size = np.hypot(columns["floor_x"], columns["floor_y"])
    # (m_b + m_r) g C_rr; interpolated where the direction turns
    assert size.max() == pytest.approx(0.007 * 9.81 * (3.0 + 17.076), rel=1e-6)
    assert "friction1" not in motion_of(log, ALTEN).columns


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        ({"t": [0.0, 1.0]}, "no theta and no phi and no psi"),
        ({"t": [0.0, LONGEST + 1.0]}, "--start and --end"),
        ({"t": [0.0, 1.0], "wheel4": [0.0, 1.0]}, "3 wheels"),
        ({"psi": [np.nan]} | {name: [0.0] for name in ("t", "x", "y", "theta", "phi")}, "no values of psi"),
    ],
)
def test_log_that_shows_no_robot_is_refused(columns, sentence):
    with pytest.raises(InputError, match=sentence):
        motion_of(Log({name: np.array(values) for name, values in columns.items()}), ALTEN)
