"""Headless Chromium, as a reader uses a page: mouse, keys, what the page wrote to the console and asked for."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.support import chromium
from tests.support.chromium import Browser


class Tab(chromium.Tab):
    """One page."""

    def run(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page."""
        return super().run(expression)

    def mouse(self, kind: str, x: float, y: float) -> None:
        """Let the mouse do one thing at a place of the window: mousePressed, mouseMoved or mouseReleased."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def press(self, x: float, y: float) -> None:
        """Press and release the mouse at a place of the window."""
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, x, y)

    def click(self, selector: str) -> None:
        """Press and release the mouse in the middle of an element."""
        self.run(f"document.querySelector('{selector}').scrollIntoView({{ block: 'nearest' }})")
        box = f"document.querySelector('{selector}').getBoundingClientRect()"
        self.press(*self.run(f"[{box}.x + {box}.width / 2, {box}.y + {box}.height / 2]"))

    def key(self, name: str, code: str = "") -> None:
        """Press and release a key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name, code=code or name)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag with the mouse from one place of the window to another."""
        steps = [start, *((s + (e - s) / 2 for s, e in zip(start, end, strict=True)),), end]
        for kind, place in zip(("mousePressed", "mouseMoved", "mouseMoved"), steps, strict=True):
            x, y = place
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1)
        x, y = end
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", buttons=0)

    def complaints(self) -> list[str]:
        """Return what the page wrote to the console, and its errors."""
        self.run("0")
        kinds = ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled")
        return [json.dumps(one) for one in self.events if one["method"] in kinds]

    def requests(self) -> list[str]:
        """Return the addresses that the page asked for."""
        self.run("0")
        events: list[Any] = [one for one in self.events if one["method"] == "Network.requestWillBeSent"]
        return [one["params"]["request"]["url"] for one in events]


def keep(picture: bytes, name: str) -> None:
    """Write a picture into the folder that BALLBOT_SCREENSHOTS names, for people to look at."""
    folder = os.environ.get("BALLBOT_SCREENSHOTS")
    if folder:
        (Path(folder) / f"{name}.png").write_bytes(picture)


@contextmanager
def headless_browser(profile: Path) -> Iterator[Browser]:
    """Run Chromium with a profile folder of its own; skip without one."""
    if chromium.installed_browser() is None:
        pytest.skip("no Chromium: apt-get install chromium")
    with chromium.headless_browser(profile) as running:
        yield running


@contextmanager
def new_tab(running: Browser) -> Iterator[Tab]:
    """Open an empty page in a running browser."""
    tab = Tab(running)
    yield tab
    tab.close()
