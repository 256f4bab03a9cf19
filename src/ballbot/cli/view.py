"""`ballbot view`: logs in three dimensions as a page in the browser, or robots that you push."""

from __future__ import annotations

import asyncio
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ballbot.cli import options
from ballbot.cli.context import ROBOT_BESIDE
from ballbot.cli.output import notice_output, open_page, progress_bar, show_written, standard_output
from ballbot.errors import InputError, every
from ballbot.files import check_file, write_text
from ballbot.log import Log
from ballbot.log.collection import named_files
from ballbot.robot import Robot
from ballbot.viewer import Layout, replay_page


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

    port: options.WholeNumber = 0
    """The port to listen on; a free one by default."""

    browser: Annotated[bool, Parameter(negative="--no-browser")] = True
    """Whether to open the page."""


_LIVE = LiveOptions()


def view(
    *shown: str,
    robot: str | None = None,
    layout: Layout = "side",
    start: float | None = None,
    end: float | None = None,
    mapping: options.Mapping = None,
    save: Path | None = None,
    live: LiveOptions = _LIVE,
) -> None:
    """Show logs in three dimensions, with plots that follow the time cursor; or simulate robots live.

    The page of logs needs no network and no server. Play, scrub, slow down, orbit; several logs stand side by side, or
    in one place as ghosts. A robot balances in real time: push it, drag its reference, change friction and floor. This
    needs `pip install 'ballbot[view]'`; Ctrl-C ends it.

    Example: `ballbot view run1/log.csv`

    Example: `ballbot view without=run1/log.csv with=run2/log.csv --robot alten --layout ghosts --save replay.html`

    Example: `ballbot view alten --plant twin`

    Parameters
    ----------
    shown
        Logs, at most four, or robots: presets' names or robot files.
        LABEL=LOG names a log in the page.
    robot
        The robot of the logs. If not given, each log's is the file robot.toml in the log's folder.
    layout
        side (each log in its own picture) or ghosts (all in one); the page can change it.
    start
        First time of the logs to show [s].
    end
        Time of the logs to stop at [s].
    save
        The HTML file to write; a robot is at rest in it. If no file is to be written, the browser opens.
    """
    if save is not None:
        check_file(save)
    if any(map(_is_port, shown)):
        raise InputError(f"A real robot is shown in the terminal: ballbot run monitor {shown[0]}")
    robots, paths = _sorted_out(shown)
    if robots and paths:
        raise InputError(f"{robots[0]} is a robot; name the robot of the logs with --robot {robots[0]}.")
    if not robots and not paths:
        raise InputError(
            "There is nothing to show. Name one or more logs, or a robot, as in: ballbot view alten"
        )
    if live != _LIVE and (paths or save):
        raise InputError("Options of a live view need a robot that is simulated, without logs and files.")
    if robots:
        described: dict[str, Robot] = {}
        for word, one in zip(robots, map(Robot.load, robots), strict=True):
            described[word if one.name in described else one.name] = one
        if save is None and find_spec("websockets") is not None:
            _simulate_live(described, live)
            return
        if save is None:
            notice_output().print("A live view needs: pip install 'ballbot[view]'", markup=False)
        page = replay_page({}, described, title=", ".join(described))
    else:
        logs = {
            name: _part(Log.read(path, mapping=mapping), path, start, end) for name, path in paths.items()
        }
        given = None if robot is None else Robot.load(robot)
        owners = {name: given or _owner(path) for name, path in paths.items()}
        page = replay_page(logs, owners, title=every(logs), layout=layout)
    if save is not None:
        write_text(save, page)
        show_written(save)
        return
    path = Path(tempfile.mkdtemp(prefix="ballbot-")) / "replay.html"
    write_text(path, page)
    show_written(path)
    open_page(path.resolve().as_uri())


def _is_port(word: str) -> bool:
    """Return whether a word names the port of a robot, and no file."""
    return re.match(r"/dev/|COM\d+($|\?)", word) is not None


def _sorted_out(shown: tuple[str, ...]) -> tuple[list[str], dict[str, Path]]:
    """Return the robots, and the logs' files by their names."""
    robots = [one for one in shown if one in Robot.presets() or Path(one).suffix == ".toml"]
    plain, labelled = [], []
    for one in (one for one in shown if one not in robots):
        label, equals, path = one.partition("=")
        if equals and not Path(one).exists():
            labelled.append((label, Path(path)))
            continue
        if not (Path(one).suffix or Path(one).exists()):
            Robot.load(one)  # refuses the misspelt preset, and names the nearest
        plain.append(Path(one))
    paths = named_files(plain) if plain else {}
    for label, path in labelled:
        if paths.setdefault(label, path) != path:
            raise InputError(f"Two logs have the label {label!r}. Give each its own.")
    return robots, paths


def _part(log: Log, path: Path, start: float | None, end: float | None) -> Log:
    if start is None and end is None:
        return log
    try:
        return log.between(float("-inf") if start is None else start, float("inf") if end is None else end)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _owner(path: Path) -> Robot:
    """Return the robot of a log, which is beside it."""
    beside = path.parent / ROBOT_BESIDE
    if not beside.is_file():
        raise InputError(
            f"The robot of {path} is not known: there is no {ROBOT_BESIDE} beside it. Name the robot with --robot."
        )
    return Robot.load(str(beside))


def _simulate_live(robots: Mapping[str, Robot], options: LiveOptions) -> None:
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
