"""The replay in a browser, as a reader uses it: open from disk, play, scrub, slow down, orbit, both themes, a phone.

The pictures that it takes are kept in the folder that BALLBOT_SCREENSHOTS names, for people to look at.
"""

from importlib.resources import files

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbot.mechanics.geometry import rotation
from ballbot.robot import Robot
from ballbot.viewer import replay_page
from tests.support.browser import RIGHTMOST, new_tab
from tests.support.log_examples import smooth_log, with_wheels

pytestmark = pytest.mark.browser

ALTEN = Robot.load("alten")
CLOCK = "parseFloat(document.querySelector('.clock').textContent)"


@pytest.fixture
def tab(browser):
    with new_tab(browser) as one:
        yield one


@pytest.fixture(scope="module")
def replay(tmp_path_factory):
    log = with_wheels(smooth_log(), ALTEN)
    reference = {"ref_x": 0.3 * np.sin(1.1 * log.t), "ref_y": 0 * log.t}
    other = log.with_columns({"x": log["x"] + 0.05}).with_columns(reference)
    logs = {"a straight run": log.with_columns(reference), "a shifted run": other}
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    path.write_text(replay_page(logs, ALTEN, title="two runs"), encoding="utf-8")
    return path


def paused(tab, replay):
    """Open the replay and stop it."""
    tab.page.goto(replay.as_uri())
    tab.wait(f"{CLOCK} > 0.1")
    tab.page.click("button.play")


def scrub(tab, seconds):
    tab.page.fill(".time", str(seconds))


def picture(tab):
    """Return a picture of the scene after the next drawing."""
    tab.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return tab.page.screenshot()


def test_page_from_disk_plays_by_itself_without_a_word_on_the_console(tab, replay):
    tab.page.goto(replay.as_uri())
    tab.wait(f"{CLOCK} > 0.5")
    tab.page.click("button.play")
    tab.wait("document.querySelector('button.play').textContent === 'Play'")
    assert tab.run("document.querySelector('.no-picture')") is None
    assert tab.complaints == []
    assert {address.partition(":")[0] for address in tab.requests} <= {"file", "data"}


def test_scrubbing_shows_the_time_and_another_picture(tab, replay):
    paused(tab, replay)
    scrub(tab, 2)
    first = picture(tab)
    scrub(tab, 6)
    second = picture(tab)
    assert tab.run(CLOCK) == 6.0
    assert first != second
    scrub(tab, 2)
    assert picture(tab) == first
    tab.keep("side_light")


def test_orbit_follow_and_ghosts_change_the_picture(tab, replay):
    paused(tab, replay)
    scrub(tab, 3)
    pictures = [picture(tab)]
    tab.drag((200, 300), (320, 340))
    pictures.append(picture(tab))
    tab.page.click(".options label")
    pictures.append(picture(tab))
    tab.page.select_option("select[aria-label=Layout]", "ghosts")
    pictures.append(picture(tab))
    tab.keep("ghosts_follow")
    assert len(set(pictures)) == len(pictures)
    assert tab.complaints == []


@pytest.mark.parametrize("dark", [False, True])
def test_phone_shows_everything_in_its_width(browser, replay, dark):
    with new_tab(browser, size=(390, 844), dark=dark, phone=True) as tab:
        paused(tab, replay)
        scrub(tab, 3)
        picture(tab)
        assert tab.run("document.documentElement.scrollWidth") == 390
        # nothing that can be used is cut off on the right
        assert tab.run(RIGHTMOST) <= 390
        tab.keep(f"phone_{'dark' if dark else 'light'}", whole=True)


def test_page_turns_body_and_ball_as_the_mechanics_does(tab):
    source = (files("ballbot.viewer") / "web" / "linear.js").read_text(encoding="utf-8")
    random = np.random.default_rng(3)
    for _ in range(5):
        angles = random.uniform(-1.0, 1.0, 3)
        found = tab.run(
            f"(() => {{ {source}; return attitude({', '.join(map(str, angles))}, [1, 2, 3]); }})()"
        )
        matrix = np.array(found).reshape(4, 4).T
        np.testing.assert_allclose(matrix[:3, :3], rotation(*angles), atol=1e-12)
        np.testing.assert_allclose(matrix[:3, 3], [1.0, 2.0, 3.0])
    turn = Rotation.random(random_state=4)
    x, y, z, w = turn.as_quat()
    found = tab.run(f"(() => {{ {source}; return ofQuaternion([{w}, {x}, {y}, {z}], [0, 0, 0]); }})()")
    np.testing.assert_allclose(np.array(found).reshape(4, 4).T[:3, :3], turn.as_matrix(), atol=1e-12)
