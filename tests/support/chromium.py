"""Chromium without a window, driven through pipes: what a program needs to use a page as a reader does.

The browser listens on no port. Commands and answers of its DevTools protocol go through two pipes that only this
process has, each message ended by a zero byte.
"""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import cast

from ballbot.errors import InputError

#: names under which Chromium and its relatives are installed
PROGRAMS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
)
#: [s] for the browser to answer, on a busy machine
PATIENCE = 60.0
#: WebGL without a graphics card too
_OPTIONS = ("--headless=new", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars")
#: gives the browser the pipes where it expects them, as files 3 and 4
_WITH_PIPES = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(one), fcntl.F_DUPFD, 10) for one in sys.argv[1:3]]
for place, end in zip((3, 4), ends):
    os.dup2(end, place)
os.execv(sys.argv[3], sys.argv[3:])
"""
Answer = dict[str, object]


def installed_browser() -> str | None:
    """Return the path of a Chromium that is installed, or None."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Browser:
    """A running browser; see `headless_browser`."""

    def __init__(self, commands: int, answers: int) -> None:
        self._commands, self._answers = commands, answers
        self._rest, self._number = b"", 0
        #: events of each tab that were heard so far, by its session
        self.events: dict[str, list[Answer]] = defaultdict(list)

    def call(self, method: str, parameters: dict[str, object], session: str = "") -> Answer:
        """Call a method of the protocol and return its result; events on the way are kept.

        InputError if the browser refuses it, ends, or gives no answer for `PATIENCE`.
        """
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        text = json.dumps(message | ({"sessionId": session} if session else {})).encode() + b"\0"
        try:
            while text:
                text = text[os.write(self._commands, text) :]
        except OSError:
            raise InputError("The browser has ended.") from None
        while True:
            answer = self._next_message()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise InputError(f"The browser refuses {method}: {answer['error']}")
                return cast("Answer", answer["result"])
            self.events[str(answer.get("sessionId", ""))].append(answer)

    def _next_message(self) -> Answer:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._answers], [], [], max(0.0, end - time.monotonic()))
            if not ready:
                raise InputError(f"The browser gave no answer for {PATIENCE:g} s.")
            more = os.read(self._answers, 1 << 20)
            if not more:
                raise InputError("The browser has ended.")
            self._rest += more
        text, _, self._rest = self._rest.partition(b"\0")
        return json.loads(text)

    def open_tab(self) -> str:
        """Open an empty tab and return its session."""
        # in a window of its own: what lies behind another one is not drawn
        target = self.call("Target.createTarget", {"url": "about:blank", "newWindow": True})["targetId"]
        attached = self.call("Target.attachToTarget", {"targetId": target, "flatten": True})
        return str(attached["sessionId"])


@contextmanager
def headless_browser(profile: Path) -> Iterator[Browser]:
    """Run Chromium with a profile folder of its own while the block runs.

    InputError if no Chromium is installed, or this system has no such pipes.
    """
    program = installed_browser()
    if program is None or sys.platform == "win32":
        raise InputError(
            "This needs Chromium, Chrome or Edge on Linux or macOS, and none was found (Debian and Ubuntu: "
            "apt-get install chromium)."
        )
    # Chromium's sandbox does not run as root
    sandbox = ("--no-sandbox",) if os.geteuid() == 0 else ()
    options = (*_OPTIONS, *sandbox, "--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank")
    (their_commands, commands), (answers, their_answers) = os.pipe(), os.pipe()
    wrapper = (sys.executable, "-c", _WITH_PIPES, str(their_commands), str(their_answers))
    with subprocess.Popen(
        (*wrapper, program, *options),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=(their_commands, their_answers),
    ) as process:
        for theirs in (their_commands, their_answers):
            os.close(theirs)
        try:
            yield Browser(commands, answers)
        finally:
            for ours in (commands, answers):
                os.close(ours)  # the browser ends by it
            with suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()


class Tab:
    """One page of a browser."""

    def __init__(self, browser: Browser) -> None:
        """Open an empty one."""
        self._browser, self._session = browser, browser.open_tab()
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def close(self) -> None:
        """Close the page."""
        self.call("Page.close")

    @property
    def events(self) -> list[Answer]:
        """What has happened in the page so far, as events of the protocol."""
        return self._browser.events[self._session]

    def call(self, method: str, **parameters: object) -> Answer:
        """Call a method of the protocol and return its result; see `Browser.call`."""
        return self._browser.call(method, parameters, self._session)

    def screen(self, width: int, height: int, *, dark: bool = False, phone: bool = False) -> None:
        """Set the window's size and the theme that the reader prefers."""
        size = {"width": width, "height": height, "deviceScaleFactor": 2 if phone else 1, "mobile": phone}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[theme])

    def go(self, address: str) -> None:
        """Open an address."""
        self.call("Page.navigate", url=address)
        self.wait("document.readyState === 'complete'")

    def open(self, path: Path) -> None:
        """Open a file from disk."""
        self.go(path.resolve().as_uri())

    def run(self, expression: str) -> object:
        """Return the value of a JavaScript expression in the page; InputError if it throws."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            raise InputError(f"The page's script failed: {found['exceptionDetails']}")
        return cast("Answer", found["result"]).get("value")

    def wait(self, expression: str, patience: float = PATIENCE) -> None:
        """Wait until a JavaScript expression is true, for so long at most [s].

        InputError if it does not become true.
        """
        end = time.monotonic() + patience
        while not self.run(expression):
            if time.monotonic() > end:
                raise InputError(f"The page did not come so far in {patience:g} s: {expression}")
            time.sleep(0.05)

    def screenshot(self, *, whole: bool = False, kind: str = "png") -> bytes:
        """Return the window, or the whole page, as PNG or JPEG."""
        picture = {"captureBeyondViewport": whole, "format": kind}
        return base64.b64decode(str(self.call("Page.captureScreenshot", **picture)["data"]))
