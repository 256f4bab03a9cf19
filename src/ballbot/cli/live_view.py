"""A live page of simulated robots: the server that shows it, and the commands' options for it."""

from __future__ import annotations

import asyncio
import webbrowser
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Annotated, Literal

from cyclopts import Parameter

from ballbot.cli.context import WholeNumber
from ballbot.cli.output import notice_output, progress_bar, standard_output
from ballbot.errors import InputError
from ballbot.robot import Robot


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

    browser: Annotated[bool, Parameter(negative="--no-browser")] = True
    """Whether to open the page."""


def has_live_view() -> bool:
    """Return whether what a live view needs is installed."""
    return find_spec("websockets") is not None


def open_page(address: str) -> None:
    """Open an address in the browser."""
    if not webbrowser.open(address):
        notice_output().print("No browser could be opened; open the page in one.")


def simulate_live(robots: Mapping[str, Robot], options: LiveOptions) -> None:
    """Simulate robots, by their names, one of each for each controller, and serve their page until Ctrl-C."""
    from ballbot.viewer.live import World, live_entries, live_view_page
    from ballbot.viewer.server import Access, serve_live
    from ballbot.workflows.candidates import parse_candidates

    if not 0 <= options.port < 65536:
        raise InputError(f"The port is {options.port}; it must be from 0 (any free one) to 65535.")
    candidates = parse_candidates(options.controller)
    entries = live_entries(robots, candidates, plant=options.plant, scenario=options.scenario)
    page = live_view_page(entries)
    with progress_bar(standard_output(), "starting the simulation"):
        world = World(entries)
        world.prepare()

    def announce(address: str) -> None:
        words = f"The live view is at {address}\nCtrl-C ends it."
        notice_output().print(words, markup=False, highlight=False, soft_wrap=True)
        if options.browser:
            open_page(address)

    access = Access(host=options.host)
    try:
        asyncio.run(serve_live(page, world, access=access, port=options.port, ready=announce))
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the live view has ended.") from None
