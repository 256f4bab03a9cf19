"""`ballbot view`: logs in three dimensions, as a page in the browser."""

from __future__ import annotations

import tempfile
import webbrowser
from pathlib import Path

from ballbot.cli.context import ROBOT_BESIDE, robot_beside
from ballbot.cli.output import notice_output, show_written
from ballbot.errors import InputError
from ballbot.files import check_file, write_text
from ballbot.log import Log
from ballbot.log.collection import named_files
from ballbot.robot import Robot
from ballbot.viewer import Layout, replay_page


def view(
    *shown: str,
    robot: str | None = None,
    layout: Layout = "side",
    start: float | None = None,
    end: float | None = None,
    mapping: Path | None = None,
    save: Path | None = None,
) -> None:
    """Show logs in three dimensions, with plots that follow the time cursor; or a robot at rest.

    The page needs no network and no server. Play, scrub, slow down, orbit; several logs stand side by side, or in one
    place as ghosts.

    Example: `ballbot view run1/log.csv`

    Example: `ballbot view without=run1/log.csv with=run2/log.csv --robot alten --layout ghosts --save replay.html`

    Parameters
    ----------
    shown
        Logs, at most four, or a robot: a preset's name or a robot file. LABEL=LOG names a log in the page.
    robot
        The logs' robot. If not given, each log's is the file robot.toml in the log's folder.
    layout
        side (each log in its own picture) or ghosts (all in one); the page can change it.
    start
        First time of the logs to show [s].
    end
        Time of the logs to stop at [s].
    mapping
        A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it.
    save
        The HTML file to write. If not given, a temporary one is written and opened in the browser.
    """
    if save is not None:
        check_file(save)
    robots, paths = _sorted_out(shown)
    if robots and paths:
        raise InputError(f"{robots[0]} is a robot; name the robot of the logs with --robot {robots[0]}.")
    if not paths:
        if not robots:
            raise InputError(
                "There is nothing to show. Name one or more logs, or a robot, as in: ballbot view alten"
            )
        loaded = {name: Robot.load(name) for name in robots}
        page = replay_page({}, {one.name: one for one in loaded.values()}, title=", ".join(loaded))
    else:
        logs = {
            name: _part(Log.read(path, mapping=mapping), path, start, end) for name, path in paths.items()
        }
        given = None if robot is None else Robot.load(robot)
        owners = {name: given or _owner(path) for name, path in paths.items()}
        page = replay_page(logs, owners, title=" and ".join(logs), layout=layout)
    path = Path(tempfile.mkdtemp(prefix="ballbot-")) / "replay.html" if save is None else save
    write_text(path, page)
    show_written(path)
    if save is None and not webbrowser.open(path.resolve().as_uri()):
        notice_output().print("No browser could be opened; open the file in one.")


def _sorted_out(shown: tuple[str, ...]) -> tuple[list[str], dict[str, Path]]:
    """Return the robots, and the logs' files by their names."""
    robots = [one for one in shown if one in Robot.presets() or Path(one).suffix == ".toml"]
    labels: dict[str, str] = {}
    plain = []
    for one in (one for one in shown if one not in robots):
        label, equals, path = one.partition("=")
        if not equals or Path(one).exists():
            plain.append(Path(one))
        elif label in labels:
            raise InputError(f"Two logs have the label {label!r}. Give each its own.")
        else:
            labels[label] = path
    paths = named_files(plain) if plain else {}
    both = [label for label in labels if label in paths]
    if both:
        raise InputError(f"Two logs are named {both[0]!r}. Give each its own label.")
    return robots, paths | {label: Path(path) for label, path in labels.items()}


def _part(log: Log, path: Path, start: float | None, end: float | None) -> Log:
    if start is None and end is None:
        return log
    try:
        return log.between(float("-inf") if start is None else start, float("inf") if end is None else end)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _owner(path: Path) -> Robot:
    """Return the robot of a log, which is beside it."""
    found = robot_beside(path)
    if found is None:
        raise InputError(
            f"The robot of {path} is not known: there is no {ROBOT_BESIDE} beside it. Name the robot with --robot."
        )
    return found
