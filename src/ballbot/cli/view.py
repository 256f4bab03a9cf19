"""`ballbot view`: logs in three dimensions as a page in the browser, or simulated robots to push."""

import asyncio
import secrets
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli import options
from ballbot.cli.output import notice, open_page, progress_bar, show_written, standard_output
from ballbot.errors import InputError, every
from ballbot.files import check_file, write_text
from ballbot.robot import Robot
from ballbot.viewer import Layout, replay_page
from ballbot.viewer.shown import read_parts, robot_beside, robots_and_logs
from ballbot.workflows.courses import PlantName


def view(
    *shown: str,
    robot: str | None = None,
    layout: Layout = "side",
    start: float | None = None,
    end: float | None = None,
    mapping: options.Mapping = None,
    save: Path | None = None,
    plant: PlantName | None = None,
    controller: tuple[str, ...] = (),
    scenario: str | None = None,
    port: options.WholeNumber | None = None,
    browser: Annotated[bool, Parameter(negative="--no-browser")] = True,
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
        The robot of the logs. If not given, the file robot.toml in each log's folder.
    layout
        side (each log in its own picture) or ghosts (all in one); the page can change it.
    start
        First time of the logs to show [s].
    end
        Last time of the logs to show [s].
    save
        The HTML file to write; a robot is at rest in it. If no file is to be written, the browser opens.
    plant
        For a live view: the exact equations of motion (model, the default) or the physics engine (twin).
    controller
        none, full or partial (the nominal gain with that friction compensation), precise, a controller file, or your
        own as FILE.py:NAME; none if not given. Each stands on the floor with a robot of its own. LABEL=... renames one.
    scenario
        The true friction, and for the twin also sensors and faults: a scenario's name or file.
    port
        The port of this computer to listen on; a free one by default. `ssh -L` brings it to another computer.
    browser
        Whether to open the page.
    """
    if save is not None:
        check_file(save)
    robots, paths = robots_and_logs(shown)
    live = any(option is not None for option in (plant, scenario, port)) or controller or not browser
    if live and (paths or save):
        raise InputError(
            "--plant, --controller, --scenario, --port and --no-browser are for a live view; name a robot to "
            "simulate, without logs and without --save."
        )
    if robots and save is None:
        if find_spec("websockets") is not None:
            show_live(
                robots,
                controller or ("none",),
                plant=plant or "model",
                scenario=scenario,
                port=port or 0,
                browser=browser,
            )
            return
        notice("A live view needs: pip install 'ballbot[view]'")
    given = None if robot is None else Robot.load(robot)
    owners = robots or {name: given or robot_beside(path) for name, path in paths.items()}
    logs = read_parts(paths, owners, mapping=mapping, start=start, end=end)
    page = replay_page(logs, owners, title=every(logs) if logs else ", ".join(robots), layout=layout)
    path = save or Path(tempfile.mkdtemp(prefix="ballbot-")) / "replay.html"
    write_text(path, page)
    sentence = f"The page shows {every(logs)}." if logs else f"The page shows {every(robots)} at rest."
    step = f"open {path} in a browser; it needs no network." if save else "give --save FILE to keep the page."
    show_written(path, sentence, next_step=step)
    if save is None:
        open_page(path.resolve().as_uri())


def show_live(
    robots: Mapping[str, Robot],
    controllers: Sequence[str],
    *,
    plant: PlantName,
    scenario: str | None,
    port: int,
    browser: bool,
) -> None:
    """Simulate each robot once with each controller, and serve their page until Ctrl-C."""
    from ballbot.viewer.live import World, live_entries, live_view_page
    from ballbot.viewer.server import serve_live
    from ballbot.workflows.candidates import parse_candidates

    if not 0 <= port < 65536:
        raise InputError(f"The port is {port}; it must be from 0 (any free one) to 65535.")
    entries = live_entries(robots, parse_candidates(controllers), plant=plant, scenario=scenario)
    page = live_view_page(entries)
    with progress_bar(standard_output(), "starting the simulation"):
        world = World(entries)
        world.prepare()

    def announce(address: str) -> None:
        notice(f"The live view is at {address}\nCtrl-C ends it.")
        if browser:
            open_page(address)

    try:
        asyncio.run(serve_live(page, world, token=secrets.token_urlsafe(24), port=port, ready=announce))
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the live view has ended.") from None
