"""Headless Chromium by Playwright, as a reader uses a page; what the page complains about and asks for is kept."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, CDPSession, Page

#: names under which Chromium and its relatives are installed
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
#: WebGL without a graphics card too; Chromium's sandbox does not run as root
_OPTIONS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
#: [s] for the browser to answer, on a busy machine
PATIENCE = 180.0
#: where what a reader can use ends on the right, in JavaScript
RIGHTMOST = (
    "Math.max(...[...document.querySelectorAll('button, select, input, canvas')]"
    ".map((one) => one.getBoundingClientRect().right))"
)


@dataclass
class Tab:
    """One page."""

    page: Page
    debugger: CDPSession
    complaints: list[str] = field(default_factory=list)  #: what it wrote to the console, and its errors
    requests: list[str] = field(default_factory=list)  #: the addresses that it asked for

    def run(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page, whose policy forbids Playwright's own `evaluate`."""
        asked = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        found = self.debugger.send("Runtime.evaluate", asked)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait(self, expression: str, patience: float = PATIENCE) -> None:
        """Wait until a JavaScript expression is true, for so long at most [s]."""
        end = time.monotonic() + patience
        while not self.run(expression):
            assert time.monotonic() < end, f"the page did not come so far in {patience:g} s: {expression}"
            self.page.wait_for_timeout(50.0)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag with the mouse from one place of the window to another."""
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(*end, steps=2)
        self.page.mouse.up()

    def keep(self, name: str, *, whole: bool = False) -> None:
        """Write a picture into the folder that BALLBOT_SCREENSHOTS names, for people to look at."""
        folder = os.environ.get("BALLBOT_SCREENSHOTS")
        if folder:
            self.page.screenshot(path=Path(folder) / f"{name}.png", full_page=whole)


@contextmanager
def headless_browser() -> Iterator[Browser]:
    """Run the Chromium that is installed; skip without it or without Playwright."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright, of the extra `test`, is missing")
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip("no Chromium: apt-get install chromium")
    with api.sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=program, args=_OPTIONS)


@contextmanager
def new_tab(
    running: Browser, *, size: tuple[int, int] = (1280, 800), dark: bool = False, phone: bool = False
) -> Iterator[Tab]:
    """Open an empty page of a size, in the theme that the reader prefers."""
    context = running.new_context(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="dark" if dark else "light",
        device_scale_factor=2 if phone else 1,
        is_mobile=phone,
    )
    page = context.new_page()
    tab = Tab(page, context.new_cdp_session(page))
    tab.page.on("console", lambda said: tab.complaints.append(said.text))
    tab.page.on("pageerror", lambda error: tab.complaints.append(str(error)))
    tab.page.on("request", lambda asked: tab.requests.append(asked.url))
    yield tab
    context.close()
