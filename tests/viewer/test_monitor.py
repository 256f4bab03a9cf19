"""A real robot in the live view: what its states become, and that nothing goes back to it."""

import time

import numpy as np
import pytest

from ballbot.control.safety import StopReason
from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.viewer.live import LivePush
from ballbot.viewer.live_process import Request
from ballbot.viewer.monitor import RobotMonitor, monitor_names, monitor_page
from tests.support.monitored_link import Link, state

ALTEN = Robot.load("alten")
#: [s] for the thread that reads the robot
PATIENCE = 60.0


def frames_of(link):
    """Return a table of the frames, by name, and the last status."""
    with RobotMonitor(link, ALTEN) as monitor:
        assert monitor.send(Request(push=LivePush(force=(1.0, 0.0), height=0.1), reset=True)) is False
        end = time.monotonic() + PATIENCE
        while monitor._thread.is_alive():
            assert time.monotonic() < end, "the thread that reads the robot does not end"
            time.sleep(0.01)
        rows, _ = monitor.frames_after(0)
    names = ("t", "paused", "rate", *monitor_names(3))
    table = np.frombuffer(rows, dtype="<f4").reshape(-1, len(names))
    return dict(zip(names, table.T, strict=True)), monitor.status


def test_states_become_frames_at_50_a_second():
    found, status = frames_of(Link([state(k, x=0.001 * k) for k in range(41)]))
    np.testing.assert_allclose(found["t"], np.arange(0.0, 0.201, 0.02), atol=1e-6)
    np.testing.assert_allclose(found["x"], 0.2 * found["t"], atol=1e-6)
    np.testing.assert_allclose(found["theta"], 0.02, rtol=1e-6)
    np.testing.assert_allclose(found["wheel1"], 0.01 * 200 * found["t"], atol=1e-6)
    np.testing.assert_allclose(found["u3"], 0.5)
    # the ball has rolled 0.04 m: a turn about y by 0.04 over its radius
    angle = 2.0 * np.arctan2(found["ball_y"][-1], found["ball_w"][-1])
    assert angle == pytest.approx(0.04 / ALTEN.ball.radius, rel=1e-5)
    assert status.message == "The robot is armed."


def test_without_an_estimate_the_imus_attitude_is_shown():
    found, _ = frames_of(Link([state(0, valid=0, armed=0)]))
    np.testing.assert_allclose(
        [found[name][0] for name in ("theta", "phi", "psi")], [0.01, -0.02, 0.3], rtol=1e-6
    )


@pytest.mark.parametrize(
    ("last", "sentence"),
    [
        ({"armed": 0}, "The robot is not armed."),
        (
            {"armed": 0, "stop": 1 + list(StopReason).index(StopReason.LEAN)},
            "it leaned further than its limit",
        ),
    ],
)
def test_status_says_what_the_robot_does(last, sentence):
    _, status = frames_of(Link([state(0), state(1, **last)]))
    assert sentence in status.message
    assert status.phase == "running"


def test_lost_link_ends_the_view():
    _, status = frames_of(Link([state(0)], ending="The robot has been silent for 50 ms."))
    assert status.phase == "ended"
    assert "silent" in status.message


def test_nothing_is_asked_of_the_robot():
    link = Link([state(k) for k in range(20)])
    frames_of(link)
    assert link.calls == []


def test_robot_with_other_wheels_is_refused():
    with pytest.raises(InputError, match="4 wheels"):
        RobotMonitor(Link([], wheel_count=4), ALTEN)


def test_page_of_a_monitor_has_no_controls_of_a_simulation():
    page = monitor_page(ALTEN, "/dev/ttyACM0").html
    assert '"monitor":true' in page
    assert "push_x" not in page.split('type="application/json"')[1].split("</script>")[0]
