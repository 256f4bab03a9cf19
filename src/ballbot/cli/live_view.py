"""A live page of robots, simulated or real: the server that shows it, and the commands' options for it."""

from __future__ import annotations

import asyncio
import webbrowser
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ballbot.cli.context import WholeNumber
from ballbot.cli.output import notice_output
from ballbot.errors import InputError
from ballbot.robot import Robot

if TYPE_CHECKING:
    from ballbot.viewer.page import LivePage
    from ballbot.viewer.server import Source


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LiveOptions:
    """A live view of robots."""

    plant: Literal["model", "twin"] = "model"
    """The exact equations of motion (model) or the physics engine (twin)."""

    controller: tuple[str, ...] = ("none",)
    """none, full or partial (the nominal gain with that friction compensation), precise, a controller file, or your own
    as FILE.py:NAME. Each stands on the floor with a robot of its own. LABEL=... renames one."""

    scenario: str | None = None
    """The true friction, and of a twin the sensors and faults: a scenario (name or file)."""

    host: str = "127.0.0.1"
    """The address to listen on. Any but this computer's own lets others in who have the link with its token."""

    port: WholeNumber = 0
    """The port to listen on; a free one by default."""

    key: Path | None = None
    """A file with a real robot's key, for UDP to a robot that is not on this computer."""

    browser: Annotated[bool, Parameter(negative="--no-browser")] = True
    """Whether to open the page."""


def has_live_view() -> bool:
    """Return whether what a live view needs is installed."""
    return find_spec("websockets") is not None


def open_page(address: str) -> None:
    """Open an address in the browser."""
    if not webbrowser.open(address):
        notice_output().print("No browser could be opened; open the page in one.")


def simulate_live(
    robots: Mapping[str, Robot], options: LiveOptions, *, ready: Callable[[str], None] | None = None
) -> None:
    """Simulate robots, one of each for each controller, and serve their page until Ctrl-C.

    Parameters
    ----------
    robots : mapping
        By name.
    options : LiveOptions
    ready : callable, optional
        Called with the page's address when it can be opened; the browser opens it by default, if it is to.
    """
    from ballbot.viewer.live import live_entries, live_view_page
    from ballbot.viewer.live_process import LiveProcess
    from ballbot.workflows.candidates import parse_candidates

    _check_port(options)
    candidates = parse_candidates(options.controller)
    entries = live_entries(robots, candidates, plant=options.plant, scenario=options.scenario)
    page = live_view_page(entries)
    with LiveProcess(entries) as source:
        _serve(page, source, options, ready)


def watch_robot(port: str, robot: Robot, options: LiveOptions) -> None:
    """Serve a page of a real robot until Ctrl-C; nothing is sent to the robot but what keeps the link open.

    Parameters
    ----------
    port : str
        As for `ballbot run`.
    robot : Robot
        Gives the geometry and the friction.
    options : LiveOptions

    Raises
    ------
    InputError
        If the link fails, or the robot at the port has another number of wheels.
    """
    from ballbot.cli.robot_link import LinkOptions, connected
    from ballbot.viewer.monitor import RobotMonitor, monitor_page

    _check_port(options)
    with connected(port, LinkOptions(key=options.key)) as connection:
        page = monitor_page(robot, port)
        with RobotMonitor(connection.robot, robot) as source:
            _serve(page, source, options, None)


def _check_port(options: LiveOptions) -> None:
    if not 0 <= options.port < 65536:
        raise InputError(f"The port is {options.port}; it must be from 0 (any free one) to 65535.")


def _serve(page: LivePage, source: Source, options: LiveOptions, ready: Callable[[str], None] | None) -> None:
    from ballbot.viewer.server import Access, serve_live

    def announce(address: str) -> None:
        words = f"The live view is at {address}\nCtrl-C ends it."
        notice_output().print(words, markup=False, highlight=False, soft_wrap=True)
        if ready is not None:
            ready(address)
        elif options.browser:
            open_page(address)

    access = Access(host=options.host)
    try:
        asyncio.run(serve_live(page, source, access=access, port=options.port, ready=announce))
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the live view has ended.") from None
