"""Headless Chromium, driven over its own DevTools protocol: what a test needs to use a page as a reader does."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

_PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
#: WebGL without a graphics card; the sandbox needs rights that a container lacks
_OPTIONS = ("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
#: [s] for a page to do what a test waits for, on a busy machine
PATIENCE = 60.0


class Tab:
    """One page."""

    def __init__(self, connection: Any) -> None:
        """Take the connection to a page's DevTools."""
        self._connection, self._number, self.events = connection, 0, []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """Call a method of the protocol and return its result; events on the way are kept."""
        self._number += 1
        self._connection.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._connection.recv(timeout=PATIENCE))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def screen(self, width: int, height: int, *, dark: bool = False, phone: bool = False) -> None:
        """Set the window's size and the theme that the reader prefers."""
        size = {"width": width, "height": height, "deviceScaleFactor": 2 if phone else 1, "mobile": phone}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[theme])

    def open(self, path: Path) -> None:
        """Open a file from disk."""
        self.go(path.resolve().as_uri())

    def go(self, address: str) -> None:
        """Open an address."""
        self.call("Page.navigate", url=address)
        self.wait("document.readyState === 'complete'")

    def run(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait(self, expression: str, patience: float = PATIENCE) -> None:
        """Wait until a JavaScript expression is true, for so long at most [s]."""
        end = time.monotonic() + patience
        while not self.run(expression):
            assert time.monotonic() < end, f"not true in {patience:g} s: {expression}"
            time.sleep(0.05)

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

    def screenshot(self, *, whole: bool = False) -> bytes:
        """Return the window, or the whole page, as PNG."""
        data = self.call("Page.captureScreenshot", captureBeyondViewport=whole)["data"]
        return base64.b64decode(data)

    def complaints(self) -> list[str]:
        """Return what the page wrote to the console, and its errors."""
        self.run("0")
        kinds = ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled")
        return [json.dumps(one) for one in self.events if one["method"] in kinds]

    def requests(self) -> list[str]:
        """Return the addresses that the page asked for."""
        self.run("0")
        asked = [one for one in self.events if one["method"] == "Network.requestWillBeSent"]
        return [one["params"]["request"]["url"] for one in asked]


def keep(picture: bytes, name: str) -> None:
    """Write a picture into the folder that BALLBOT_SCREENSHOTS names, for people to look at."""
    folder = os.environ.get("BALLBOT_SCREENSHOTS")
    if folder:
        (Path(folder) / f"{name}.png").write_bytes(picture)


@contextmanager
def headless_browser(profile: Path) -> Iterator[str]:
    """Run Chromium with a profile folder of its own and yield the address of its DevTools; skip without a browser."""
    pytest.importorskip("websockets")
    program = next(filter(None, map(shutil.which, _PROGRAMS)), None)
    if program is None:
        pytest.skip("no Chromium: apt-get install chromium")
    command = [program, *_OPTIONS, "--remote-debugging-port=0", f"--user-data-dir={profile}", "about:blank"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield f"127.0.0.1:{_port(profile / 'DevToolsActivePort', process)}"
        finally:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()


def _port(file: Path, process: subprocess.Popen[bytes]) -> str:
    end = time.monotonic() + PATIENCE
    while not (file.is_file() and "\n" in file.read_text()):
        assert process.poll() is None, "Chromium ended at once"
        assert time.monotonic() < end, "Chromium did not start"
        time.sleep(0.05)
    return file.read_text().splitlines()[0]


@contextmanager
def new_tab(address: str) -> Iterator[Tab]:
    """Open an empty page in a running browser."""
    from websockets.sync.client import connect

    request = urllib.request.Request(f"http://{address}/json/new?about:blank", method="PUT")
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        target = json.load(answer)["webSocketDebuggerUrl"]
    with connect(target, max_size=None) as connection:
        yield Tab(connection)
