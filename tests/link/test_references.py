"""References of a live robot: keys, courses, and the frame of the start."""

import os
from contextlib import closing, contextmanager
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.link.references import (
    KEY_STEP,
    KEY_TURN,
    KeyboardReference,
    in_robot_frame,
    in_start_frame,
    live_reference,
)
from ballbot.log import Log
from ballbot.mechanics.geometry import rotation

pytestmark = pytest.mark.skipif(os.name != "posix", reason="terminals are those of POSIX")


@contextmanager
def terminal():
    """Yield a keyboard reference, and what sends it keys."""
    import pty

    driver, own = pty.openpty()
    with closing(KeyboardReference(own)) as reference:
        reference.update(0.0)  # from now on keys come at once
        yield reference, partial(os.write, driver)
    os.close(driver)
    os.close(own)


def pose_of(reference, t=0.0):
    return reference.update(t)[[0, 1, 4]]


def test_arrow_keys_move_along_the_heading():
    with terminal() as (reference, press):
        press(b"\x1b[A\x1b[A\x1b[D")
        np.testing.assert_allclose(pose_of(reference), [2 * KEY_STEP, KEY_STEP, 0.0], atol=1e-15)
        press(b"," * 9 + b"\x1b[A")  # a quarter turn to the left: forward is now +y
        np.testing.assert_allclose(pose_of(reference), [2 * KEY_STEP, 2 * KEY_STEP, 9 * KEY_TURN], atol=1e-12)
        assert not reference.ended


@given(keys=st.binary(max_size=40))
def test_any_bytes_leave_a_finite_pose(keys):
    with terminal() as (reference, press):
        press(keys.translate(None, b"\x03\x1a\x1c") or b" ")  # without those that send signals
        found = reference.update(0.0)
    assert np.isfinite(found).all()
    assert not found[[2, 3, 5, 6, 7, 8, 9]].any()


def test_file_is_followed_from_the_start_of_the_run_on(tmp_path):
    t = 0.1 * np.arange(11)
    Log({"t": t, "ref_x": t, "ref_y": -2.0 * t, "ref_psi": 0.5 * t}).write(tmp_path / "course.csv")
    reference = live_reference(str(tmp_path / "course.csv"))
    for seconds in (0.0, 0.5, 1.0):
        pose = seconds * np.array([1.0, -2.0, 0.5])
        np.testing.assert_allclose(pose_of(reference, seconds), pose, atol=1e-12)
    assert not reference.ended


angles = st.floats(min_value=-0.4, max_value=0.4)
headings = st.floats(min_value=-7.0, max_value=7.0)


@given(angles, angles, headings, headings, st.lists(st.floats(-2.0, 2.0), min_size=7, max_size=7))
def test_frame_of_the_start(theta, phi, psi, start_psi, numbers):
    """A state in the frame of the start is the same motion: R_z(psi_0) takes it back to the robot's frame."""
    x, y, x_dot, y_dot, *rates = numbers
    state = np.array([x, y, theta, phi, psi, x_dot, y_dot, *rates])
    start = np.array([0.3, -0.7, start_psi])
    found = in_start_frame(state, start)
    turn = rotation(0.0, 0.0, start_psi)
    np.testing.assert_allclose(turn @ rotation(*found[2:5]), rotation(*state[2:5]), atol=1e-12)
    np.testing.assert_allclose(turn @ [*found[5:7], 0.0], [x_dot, y_dot, 0.0], atol=1e-12)
    np.testing.assert_allclose(turn[:2, :2] @ found[0:2] + start[:2], state[0:2], atol=1e-12)
    # the rates are those of the angles, by central differences of the attitude; their error is of the second order
    h = 1e-5
    moved = [in_start_frame(_advanced(state, step), start)[2:5] for step in (-h, h)]
    np.testing.assert_allclose(found[7:10], (moved[1] - moved[0]) / (2 * h), atol=1e-6)


def _advanced(state, step):
    moved = state.copy()
    moved[2:5] += step * state[7:10]
    return moved


@given(headings, headings)
def test_reference_in_the_robots_frame_comes_back(start_psi, psi):
    start = np.array([1.0, 2.0, start_psi])
    wanted = np.zeros(10)
    wanted[[0, 1, 4]] = 0.5, -0.25, psi
    np.testing.assert_allclose(in_start_frame(in_robot_frame(wanted, start), start), wanted, atol=1e-12)
