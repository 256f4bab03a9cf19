"""What `ballbot view` shows, by the words that name it: robots, or logs with their robots."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from ballbot.errors import InputError, about
from ballbot.log import Log
from ballbot.log.collection import named_files
from ballbot.robot import Robot


def robots_and_logs(words: Sequence[str]) -> tuple[dict[str, Robot], dict[str, Path]]:
    """Return robots (presets or robot files), or files of logs (LOG or LABEL=LOG), by their names.

    InputError if there are both or neither, a word is the port of a real robot, or two logs have one label.
    """
    if port := next((word for word in words if re.match(r"/dev/|COM\d+($|\?)", word)), None):
        raise InputError(f"A real robot is shown in the terminal: ballbot run monitor {port}")
    robots: dict[str, Robot] = {}
    plain, labelled = list[Path](), list[tuple[str, Path]]()
    for word in words:
        label, equals, path = word.partition("=")
        if word in Robot.presets() or Path(word).suffix == ".toml":
            robot = Robot.load(word)
            robots[word if robot.name in robots else robot.name] = robot
        elif equals and not Path(word).exists():
            labelled.append((label, Path(path)))
        else:
            if not (Path(word).suffix or Path(word).exists()):
                Robot.load(word)  # refuses the misspelt preset, and names the nearest
            plain.append(Path(word))
    logs = named_files(plain) if plain else {}
    for label, path in labelled:
        if logs.setdefault(label, path) != path:
            raise InputError(f"Two logs have the label {label!r}. Give each its own.")
    if robots and logs:
        name = next(iter(robots))
        raise InputError(f"{name} is a robot; name the robot of the logs with --robot {name}.")
    if not robots and not logs:
        raise InputError(
            "There is nothing to show. Name one or more logs, or a robot, as in: ballbot view alten"
        )
    return robots, logs


def read_parts(
    paths: Mapping[str, Path],
    owners: Mapping[str, Robot],
    *,
    mapping: Path | None,
    start: float | None,
    end: float | None,
) -> dict[str, Log]:
    """Return the rows of logs from a start to an end [s]; InputError if a log cannot be read or has no such row."""
    logs = {name: Log.read(path, mapping=mapping, robot=owners[name]) for name, path in paths.items()}
    if start is None and end is None:
        return logs
    for name, log in logs.items():
        with about(paths[name]):
            logs[name] = log.between(-math.inf if start is None else start, math.inf if end is None else end)
    return logs


def robot_beside(path: Path) -> Robot:
    """Return the robot whose file lies beside a log; InputError if that file is missing."""
    beside = path.parent / "robot.toml"
    if not beside.is_file():
        raise InputError(
            f"The robot of {path} is not known: there is no robot.toml beside it. Name the robot with --robot."
        )
    return Robot.load(str(beside))
