"""The planner by itself: its motion ends where the reference does, within torques, and is one of the flat output."""

import numpy as np
import pytest

from ballbot.control.controller import Controller
from ballbot.control.parts import Parts
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.planner import MOTION_TORQUE, Planner
from ballbot.control.references import circle, drive, hold
from tests.support.control_examples import alten

SAMPLE, TORQUE = 0.005, 1.6


def planned(reference, duration: float) -> tuple[np.ndarray, ...]:
    """Return s and s'' (N, 2), the ball's places and a of a plan, and the torque for 1 m/s^2; without a gain."""
    parts = Parts(planner=Planner(torque_limit=TORQUE / MOTION_TORQUE), feed_forward=FeedForward())
    controller = Controller(alten(), np.zeros((3, 10)), parts=parts, torque_limit=1e3)
    own, memory, rows = controller.record["planner"][0], controller.memory["planner"], []
    for k in range(round(duration / SAMPLE)):
        controller.update(k * SAMPLE, np.zeros(10), reference(k * SAMPLE))
        place, now = memory["place"][0].copy(), memory["now"][0].copy()
        second = 0.5 * (memory["lead"][0] + memory["lag"][0])
        rows.append((place, second, place - (own["square"] - own["ball"]) * second, now))
    by_second = np.abs(controller.record["feed_forward"]["by_second"][0][:, 0]).max()
    return (*(np.array(column) for column in zip(*rows, strict=True)), by_second)


@pytest.mark.parametrize("speed", [0.5, 1.4])
def test_a_fast_reference_that_stops_at_once_is_not_overshot(speed):
    reference = drive(speed=speed, begin=1.0, ramp=4.0, end=8.0)
    _, _, ball, a, by_second = planned(reference, 12.0)
    end = reference(12.0)[0]
    # ten steps do not bring the multipliers quite to where they belong
    assert ball[:, 0].max() < end + 0.01
    assert ball[-1, 0] == pytest.approx(end, abs=1e-3)
    assert by_second * np.abs(a[:, 0]).max() < 1.1 * TORQUE
    # a double integrator stops in v^2/(2 a); leaning and coming upright take 0.2 s each, a plan up to 0.08 s
    way = end - ball[round(8.0 / SAMPLE), 0]
    assert way < speed**2 / (2.0 * TORQUE / by_second) + 0.48 * speed


def test_the_motion_is_one_of_the_flat_output():
    s, second, _, a, _ = planned(hold(x=0.5, y=-0.3), 3.0)
    found = np.diff(s, 2, axis=0) / SAMPLE**2
    # a is linear between knots: the second difference is off by the twelfth of h^2 and the fourth derivative
    np.testing.assert_allclose(found, second[1:-1], atol=2e-3)
    assert np.abs(a).max() > 0.5


def test_a_slow_reference_is_followed_without_delay():
    bend = circle(radius=0.5, period=30.0)
    ball = planned(bend, 10.0)[2]
    np.testing.assert_allclose(ball[-1], bend(10.0)[:2], atol=2e-3)  # a sample is 0.5 mm


def test_the_plan_rests_where_the_reference_does():
    s, second, _, a, _ = planned(hold(x=0.2), 6.0)
    assert s[-1, 0] == pytest.approx(0.2, abs=1e-12)
    assert not second[-1].any()
    assert not a[-1].any()
