"""The live view in a browser, as a person uses it: start, push with the mouse, see it lean and recover, let it fall."""

import re
import signal
import time
from contextlib import contextmanager

import pytest

from tests.support.browser import PATIENCE, RIGHTMOST, new_tab
from tests.support.processes import Child

pytestmark = pytest.mark.browser

#: [s] for the simulation to start; the first time its code is compiled
COMPILING = 600.0
STATE = "document.querySelector('.state').textContent"
READINGS = "[...document.querySelectorAll('.label .live')].map((one) => one.textContent)"
RUNNING = f"/^(Running|The simulation runs)/.test({STATE})"
LEAN = f"Math.max(...{READINGS}.map((one) => parseFloat(one.split('lean ')[1])))"
OFF = f"Math.max(...{READINGS}.map((one) => parseFloat(one.split('off by ')[1])))"


@contextmanager
def live_view(*words):
    """Run `ballbot view` and yield the address that it shows."""
    with Child("-m", "ballbot", "view", *words, "--no-browser") as child:
        line = child.line(within=COMPILING)
        found = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", line)
        assert found, line
        yield found[0]
        child.send(signal.SIGINT)  # Ctrl-C
        assert child.end(within=PATIENCE) == 130, child.errors()
        assert child.errors().endswith("ballbot: the live view has ended.\n")


@pytest.fixture(scope="module")
def address():
    with live_view("alten", "--controller", "full") as found:
        yield found


@pytest.fixture
def tab(browser, address):
    with new_tab(browser) as one:
        start(one, address)
        yield one


def start(tab, address):
    """Open a live view and wait until its robots stand."""
    tab.page.goto(address)
    tab.wait(RUNNING, COMPILING)
    tab.page.click("button.reset")
    tab.wait(f"{LEAN} < 0.5 && {OFF} < 100")


def test_robot_pushed_with_the_mouse_leans_and_recovers(tab):
    box = tab.page.locator(".stage").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + 40, y)
    tab.wait(f"{LEAN} > 1")
    tab.keep("live_pushed")
    tab.page.mouse.up()
    tab.wait(f"{LEAN} < 0.5 && {OFF} < 100")
    assert tab.complaints == []
    assert {one.partition(":")[0] for one in tab.requests} <= {"http", "data"}


def test_settings_come_back_from_the_simulation_to_every_page(tab, browser, address):
    wheels, compensation = "input[aria-label=Wheels]", "select[aria-label='Friction compensation']"
    tab.page.fill(wheels, "2")
    tab.page.select_option(compensation, "partial")
    tab.page.click("button.play")
    tab.wait(f"{STATE} === 'Paused.'")
    with new_tab(browser) as other:
        other.page.goto(address)
        other.wait(f"{STATE} === 'Paused.'")
        assert other.page.input_value(wheels) == "2"
        assert other.page.input_value(compensation) == "partial"
        other.page.keyboard.press("Space")
    tab.wait(RUNNING)
    tab.page.fill(wheels, "1")


@pytest.mark.parametrize("dark", [False, True])
def test_phone_shows_everything_in_its_width(browser, address, dark):
    with new_tab(browser, size=(390, 844), dark=dark, phone=True) as tab:
        start(tab, address)
        assert tab.run("document.documentElement.scrollWidth") == 390
        assert tab.run(RIGHTMOST) <= 390
        tab.keep(f"live_phone_{'dark' if dark else 'light'}", whole=True)


def test_two_controllers_of_the_twin_stand_on_one_floor(browser):
    # without compensation a robot soon wanders by more than 100 mm, and on a busy machine the page looks too late
    words = ("alten", "--plant", "twin", "--controller", "full", "--controller", "precise")
    with live_view(*words) as address, new_tab(browser, dark=True) as tab:
        start(tab, address)
        assert tab.run("document.querySelectorAll('.label').length") == 2
        end = time.monotonic() + PATIENCE
        # again and again: on a busy machine the page may show nothing of the half second of one push
        while tab.run(f"{LEAN} <= 0.7"):
            assert time.monotonic() < end
            tab.page.keyboard.press("ArrowUp")
            tab.page.wait_for_timeout(200.0)
        tab.keep("live_two_dark")
        assert tab.complaints == []
