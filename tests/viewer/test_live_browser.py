"""The live view in a browser, as a person uses it: start, push with the mouse, see it lean and recover, let it fall."""

import re
import signal
from contextlib import contextmanager

import pytest

from tests.support.browser import headless_browser, keep, new_tab
from tests.support.processes import Child

pytestmark = pytest.mark.browser

#: [s] for the simulation to start; the first time its code is compiled
COMPILING = 600.0
#: [s] for a process to end, on a busy machine
PATIENCE = 60.0
STATE = "document.querySelector('.state').textContent"
READINGS = "[...document.querySelectorAll('.label .live')].map((one) => one.textContent)"
RUNNING = f"/^(Running|The simulation runs)/.test({STATE})"
LEAN = f"Math.max(...{READINGS}.map((one) => parseFloat(one.split('lean ')[1])))"
OFF = f"Math.max(...{READINGS}.map((one) => parseFloat(one.split('off by ')[1])))"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with headless_browser(tmp_path_factory.mktemp("profile")) as address:
        yield address


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
    with new_tab(browser) as page:
        start(page, address)
        yield page


def start(tab, address, *, dark=False, phone=False):
    """Open a live view and wait until its robots stand."""
    width, height = (390, 844) if phone else (1280, 800)
    tab.screen(width, height, dark=dark, phone=phone)
    tab.go(address)
    tab.wait(RUNNING, COMPILING)
    tab.click("button.reset")
    tab.wait(f"{LEAN} < 0.5 && {OFF} < 100")


def place(tab, across=0.5, down=0.5):
    """Return a place of the picture."""
    box = "document.querySelector('.stage').getBoundingClientRect()"
    x, y = tab.run(f"[{box}.x + {across} * {box}.width, {box}.y + {down} * {box}.height]")
    return x, y


def slide(tab, label, value):
    tab.run(
        f"(() => {{ const s = document.querySelector('input[aria-label=\"{label}\"]'); s.value = {value}; "
        "s.dispatchEvent(new Event('input')); })()"
    )


def test_robot_pushed_with_the_mouse_leans_and_recovers(tab):
    x, y = place(tab)
    tab.mouse("mousePressed", x, y)
    tab.mouse("mouseMoved", x + 40, y)
    tab.wait(f"{LEAN} > 1")
    keep(tab.screenshot(), "live_pushed")
    tab.mouse("mouseReleased", x + 40, y)
    tab.wait(f"{LEAN} < 0.5 && {OFF} < 100")
    assert tab.complaints() == []
    assert {one.partition(":")[0] for one in tab.requests()} <= {"http", "data"}


def test_settings_come_back_from_the_simulation_to_every_page(tab, browser, address):
    slide(tab, "Wheels", 2)
    choose = "document.querySelector('select[aria-label=\"Friction compensation\"]')"
    tab.run(f"{choose}.value = 'partial'; {choose}.dispatchEvent(new Event('change'))")
    tab.click("button.play")
    tab.wait(f"{STATE} === 'Paused.'")
    with new_tab(browser) as other:
        other.go(address)
        other.wait(f"{STATE} === 'Paused.'")
        assert other.run("document.querySelector('input[aria-label=Wheels]').value") == "2"
        assert other.run(f"{choose}.value") == "partial"
        other.key(" ", "Space")
    tab.wait(RUNNING)
    slide(tab, "Wheels", 1)


@pytest.mark.parametrize("dark", [False, True])
def test_phone_shows_everything_in_its_width(browser, address, dark):
    with new_tab(browser) as tab:
        start(tab, address, dark=dark, phone=True)
        assert tab.run("document.documentElement.scrollWidth") == 390
        used = "[...document.querySelectorAll('button, select, input, canvas')]"
        assert tab.run(f"Math.max(...{used}.map((one) => one.getBoundingClientRect().right))") <= 390
        keep(tab.screenshot(whole=True), f"live_phone_{'dark' if dark else 'light'}")


def test_two_controllers_of_the_twin_stand_on_one_floor(browser):
    words = ("alten", "--plant", "twin", "--controller", "none", "--controller", "precise")
    with live_view(*words) as address, new_tab(browser) as tab:
        start(tab, address, dark=True)
        assert tab.run("document.querySelectorAll('.label').length") == 2
        tab.key("ArrowUp")
        tab.wait(f"{LEAN} > 0.7")
        keep(tab.screenshot(), "live_two_dark")
        assert tab.complaints() == []
