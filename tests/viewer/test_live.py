"""Simulated robots on one floor: pushes, falls, and changes of their world while they balance."""

import json

import numpy as np
import pytest

from ballbot.robot import Robot
from ballbot.viewer.live import LivePush, Request, World, live_entries
from ballbot.viewer.motion import INTERVAL
from ballbot.workflows.candidates import parse_candidates

ALTEN = {"alten": Robot.load("alten")}


def world(*controllers):
    return World(live_entries(ALTEN, parse_candidates(controllers or ("full",))))


def run(one, seconds):
    """Run a world and return the largest lean [rad] of its first robot."""
    leans = []
    for _ in range(round(seconds / INTERVAL)):
        one.tick()
        leans.append(np.abs(one.robots[0].measured.truth[2:4]).max())
    return max(leans)


def push(newtons):
    return LivePush(force=(newtons, 0.0), height=0.3, duration=0.2)


@pytest.mark.slow
def test_pushed_robot_leans_into_the_push_and_recovers():
    one = world()
    one.push(push(60.0))
    assert run(one, 2.0) > 0.03
    assert one.robots[0].measured.truth[0] > 0.1
    run(one, 8.0)
    x, y, theta, phi = one.robots[0].measured.truth[:4]
    assert np.hypot(theta, phi) < 0.02
    assert np.hypot(x, y) < 0.2  # the soft gain keeps moving about its reference


@pytest.mark.slow
def test_push_is_limited_to_a_share_of_the_weight():
    one = world()
    one.push(LivePush(force=(3e9, 4e9), height=0.3))
    robot = one.robots[0]
    assert np.hypot(*robot.push) == pytest.approx(0.6 * robot.body.robot.weight)
    assert robot.push[1] / robot.push[0] == pytest.approx(4.0 / 3.0)


@pytest.mark.slow
def test_robot_without_motors_falls_and_reset_puts_it_up():
    one = world("none", "full")
    one.change({"motors": False})
    one.push(LivePush(force=(20.0, 0.0), height=0.3, robot=0))
    run(one, 3.0)
    assert one.robots[0].ended == "fallen: lean past 1.2 rad"
    assert one.robots[1].ended is None  # upright without a push
    one.reset()
    assert [robot.ended for robot in one.robots] == [None, None]
    assert one.settings.motors
    np.testing.assert_array_equal(one.robots[0].measured.truth[:2], one.robots[0].home)


@pytest.mark.slow
def test_slow_motion_is_the_same_motion():
    worlds = world(), world()
    worlds[1].change({"pace": 0.1})
    for one in worlds:
        one.push(push(40.0))
    run(worlds[0], 1.0)
    run(worlds[1], 10.0)
    np.testing.assert_array_equal(*(one.robots[0].measured.truth for one in worlds))


@pytest.mark.slow
def test_changes_act_on_every_robot():
    one = world("none", "partial")
    one.change({"friction": 2.0, "rolling": 0.0, "slope_x": 0.03, "compensation": "full"})
    for robot in one.robots:
        assert robot.body.robot.friction.coulomb == tuple(2.0 * c for c in robot.friction.coulomb)
        assert robot.body.robot.friction.rolling == 0.0
    run(one, 0.3)
    assert one.robots[0].measured.truth[0] < 0.0  # the floor rises towards x
    # now they are the same robots, from homes that are rounded otherwise
    of_first, of_second = (robot.measured.truth[:5] - [*robot.home, 0.0, 0.0, 0.0] for robot in one.robots)
    np.testing.assert_allclose(of_first, of_second, atol=1e-9)


@pytest.mark.slow
def test_requests_are_made_with_the_next_tick_and_a_reset_after_what_came_before_it():
    one = world()
    one.take(Request(change={"x": 1.0, "friction": 2.0}))
    one.take(Request(reset=True))
    one.take(Request(change={"slope_x": 0.02, "paused": True}))
    one.tick()
    status = json.loads(one.status())
    assert {name: status["settings"][name] for name in ("x", "friction", "slope_x", "paused")} == {
        "x": 0.0, "friction": 2.0, "slope_x": 0.02, "paused": True}  # fmt: skip
    assert status["ended"] == [None]
    assert one.t == 0.0
    one.take(Request(change={"friction": 9.0}))
    one.tick()
    assert "friction" in json.loads(one.status())["message"]


@pytest.mark.slow
def test_error_in_a_users_controller_ends_its_robot_only(tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    sample_time = 0.005\n    def __init__(self, robot): pass\n    def reset(self): pass\n"
        "    def update(self, t, state, reference): raise ValueError('no idea')\n"
    )
    one = world("full", f"{tmp_path / 'mine.py'}:Mine")
    one.change({"compensation": "none"})  # the user's has none to change
    run(one, 0.2)
    assert one.robots[0].ended is None
    assert "no idea" in str(one.robots[1].ended)
