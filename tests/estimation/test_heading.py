"""Headings that begin again after a turn: in the estimators, in the law and in C, the robot turns by the short way."""

import ctypes

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot import Model, simulate
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import hold
from ballbot.estimation.heading import HEADING, JUMP, TURN, Heading
from ballbot.estimation.interface import Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.estimation.onboard import OnboardState
from ballbot.firmware.build import compilers
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.export import export_controller
from tests.support.compiled_firmware import Firmware, library
from tests.support.control_examples import FRICTION, alten

ROBOT = alten(FRICTION)
needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")


def wrapped(angles: np.ndarray) -> np.ndarray:
    """Return headings as of a sensor that begins again at -pi."""
    return (angles + np.pi) % TURN - np.pi


def unwrapped(*angles: float) -> list[float]:
    heading = Heading()
    return [heading.unwrapped(angle) for angle in angles]


@pytest.mark.parametrize("start", [-np.pi, 0.0])
@pytest.mark.parametrize("step", [0.3, -0.3, 1.5, -1.5])
def test_heading_within_one_turn_goes_on_over_many(start, step):
    angles = 0.2 + step * np.arange(60)
    within = (angles - start) % TURN + start
    # a product and a sum of each value, of up to 90 rad
    np.testing.assert_allclose(unwrapped(*within), angles + within[0] - angles[0], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    "angles",
    [
        (0.0, np.pi, 0.0, -np.pi),  # steps of half a turn
        (0.0, 4.7),
        (0.0, 2.0 * TURN, 0.0),  # two turns at once, and back
        (0.0, 3.0, 6.0, 9.0, 12.0, 7.0, 2.0),
        (2.0, 8.0),  # not within one turn
        (-3.1, 3.3),
    ],
)
def test_commanded_steps_and_several_turns_stay_as_they_are(angles):
    assert unwrapped(*angles) == list(angles)


#: of single precision, and no jump so near the threshold that its rounding decides
angles = st.one_of(st.floats(-3.5, 6.5, width=32), st.floats(-15.0, 15.0, width=32))


@needs_compiler
@settings(max_examples=100, deadline=None)
@given(st.lists(angles, min_size=2, max_size=30))
def test_c_unwraps_as_python_does(given_angles):
    function = library().functions.ballbot_unwrapped
    function.restype = ctypes.c_float
    memory = np.zeros(1, HEADING.dtype("single"))
    edges = (JUMP, -0.1, TURN + 0.1, 0.5 * TURN + 0.1, -0.5 * TURN - 0.1)
    jumps = np.abs(np.diff(given_angles))
    if min(abs(one - edge) for one in (*given_angles, *jumps) for edge in edges) < 1e-5:
        return
    found = [function(ctypes.c_void_p(memory.ctypes.data), ctypes.c_float(one)) for one in given_angles]
    # an angle of 200 rad at most, rounded twice
    np.testing.assert_allclose(found, unwrapped(*given_angles), rtol=0.0, atol=3e-5)


def turning(psi: float) -> Reading:
    zeros = np.zeros(3)
    return Reading(wheel_angles=zeros, wheel_speeds=zeros, gyro=zeros, attitude=np.array([0.0, 0.0, psi]))


@pytest.mark.parametrize("estimator", [OnboardState, KalmanFilter])
def test_estimated_heading_goes_on_where_the_measured_one_begins_again(estimator):
    psi, states = 3.1 + 0.001 * np.arange(120), []
    for given_psi in (psi, wrapped(psi)):
        one = estimator(ROBOT, sample_time=0.005)
        states.append(np.array([one.update(turning(float(angle))) for angle in given_psi]))
    # sine and cosine of an angle and of the same less a turn differ by its rounding
    np.testing.assert_allclose(states[1], states[0], rtol=0.0, atol=1e-12)


def torques_of(controller, measured, reference) -> np.ndarray:
    controller.reset()
    found = []
    for psi, wanted in zip(measured, reference, strict=True):
        state, asked = np.zeros(10), np.zeros(10)
        state[4], asked[4] = psi, wanted
        found.append(controller.update(0.0, state, asked))
    return np.array(found)


@pytest.mark.parametrize("make", [nominal_controller, precise_controller])
def test_torques_do_not_depend_on_where_headings_begin_again(make):
    law = make(ROBOT)
    psi = 3.0 + 0.01 * np.arange(60)
    reference = psi + 0.05
    whole = torques_of(law, psi, reference)
    for measured, wanted in (
        (psi, wrapped(reference)),
        (wrapped(psi), reference),
        (wrapped(psi), wrapped(reference)),
    ):
        np.testing.assert_allclose(torques_of(law, measured, wanted), whole, rtol=0.0, atol=1e-9)


def test_step_of_half_a_turn_keeps_its_sign():
    for sign in (1.0, -1.0):
        controller = precise_controller(ROBOT)
        log = simulate(Model(ROBOT), controller, hold(psi=sign * np.pi), duration=9.0)
        assert log["psi"][-1] == pytest.approx(sign * np.pi, abs=0.02)


@needs_compiler
def test_firmware_estimates_a_heading_that_goes_on():
    firmware = Firmware(export_controller(nominal_controller(ROBOT)).parameters)
    psi, found = 3.1 + 0.001 * np.arange(120), []
    for k, measured in enumerate(wrapped(psi).tolist()):
        firmware.update(reading_record(turning(measured), robot=ROBOT), 5000 * k, None)
        found.append(firmware.estimate[4])
    np.testing.assert_allclose(found, psi, rtol=0.0, atol=1e-6)
