"""The replay as HTML: one page that opens from disk, or a part of another page.

The page has no address of anything else: scripts, styles and data are in it. Its Content-Security-Policy allows these
by their SHA-256 and nothing more, so that no script that a log's name could bring runs, and nothing is sent or fetched.
"""

import base64
import hashlib
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import Literal

import numpy as np

from ballbot.errors import InputError, about
from ballbot.log import LogsLike, as_logs
from ballbot.printable import printable_line
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.drawing import BodyShape, body_shape, row_offsets, wheel_shapes
from ballbot.viewer.motion import BODY_NOTE, INTERVAL, ReplayMotion, motion_of, robot_at_rest
from ballbot.viewer.packing import packed

#: robots side by side, or all in one place with the others as ghosts of the first
Layout = Literal["side", "ghosts"]

#: logs in one replay
MOST_RUNS = 4
#: of the runs, in the order in which the figures of reports have them (`ballbot.report.comparison`)
RUN_COLORS = ("orange", "blue", "teal", "violet")
#: of every picture, in the order in which they use one another
_SCRIPTS = ("element", "linear", "meshes", "renderer", "packing", "runs", "camera", "scene", "plots", "view")
#: length of the arrow of a large force [m], over the ball's radius
_ARROW = 2.5


@dataclass(frozen=True, kw_only=True)
class ReplayPart:
    """A replay to stand within a page: its element with its data, and what the page needs once, besides uPlot."""

    element: str  #: HTML
    style: str  #: CSS
    script: str  #: runs after the elements, for all of them


def replay_part(
    logs: LogsLike,
    robot: RobotLike | Mapping[str, RobotLike],
    *,
    layout: Layout = "side",
    autoplay: bool = False,
) -> ReplayPart:
    """Return a replay of logs as a part of a page.

    At most `MOST_RUNS` logs; time counts from each log's start. With an empty mapping the robots stand at rest. The
    robot is that of all logs, or of each by the log's name. The page can change the layout.

    InputError if there is no robot or there are too many logs, or one cannot be shown
    (`ballbot.viewer.motion.motion_of`).
    """
    shown = {} if isinstance(logs, Mapping) and not logs else as_logs(logs)
    named = {name or "run": log for name, log in shown.items()}
    if isinstance(robot, Mapping):
        robots = {name: as_robot(source) for name, source in robot.items()}
    else:
        described = as_robot(robot)
        robots = dict.fromkeys(named or [described.name], described)
    names = list(named or robots)
    _check_number(len(names), "logs")
    motions = {}
    for name in names:
        with about(name):
            motions[name] = motion_of(named[name], robots[name]) if named else robot_at_rest(robots[name])
    data: dict[str, object] = {
        "layout": layout,
        "autoplay": autoplay,
        "arrow": _arrow([(motions[name], robots[name]) for name in names]),
        "runs": [
            _run(name, motions[name], robots[name], color)
            for name, color in zip(names, RUN_COLORS, strict=False)
        ],
    }
    return ReplayPart(
        element=_element("replay", data), style=web_file("replay.css"), script=_script("replay")
    )


def _element(kind: str, data: dict[str, object]) -> str:
    """Return the element that a script fills, with its data."""
    # no "<" can end the script's element
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return (
        f'<div data-ballbot-{kind}="{kind}"><noscript>The picture needs JavaScript.</noscript></div>\n'
        f'<script type="application/json" id="{kind}">{text}</script>'
    )


def replay_page(
    logs: LogsLike,
    robot: RobotLike | Mapping[str, RobotLike],
    *,
    title: str,
    layout: Layout = "side",
    lead: str = "",
) -> str:
    """Return a replay of logs as a whole page, with a sentence or two as `lead` under the title; see `replay_part`.

    >>> replay_page({}, "alten", title="A robot at rest")[:15]
    '<!doctype html>'
    """
    part = replay_part(logs, robot, layout=layout, autoplay=True)
    style = web_file("uPlot.min.css") + part.style + web_file("page.css")
    script = plot_script() + _script("replay", "page")
    return _document(
        title,
        lead=lead,
        body=f"{part.element}\n",
        style=style,
        script=script,
        policy=f"{_policy(style, script)}; base-uri 'none'; form-action 'none'",
    )


@dataclass(frozen=True, kw_only=True)
class LivePage:
    """The page of a live view, and the Content-Security-Policy of its scripts and styles for its server."""

    html: str
    policy: str


def live_page(
    robots: Mapping[str, Robot],  # by name, at most `MOST_RUNS`
    *,
    world: Sequence[str],  # names of a frame's first values
    # names and homes: the names of each robot's values in a frame, and where it starts [m]
    names: Sequence[Sequence[str]],
    homes: Sequence[tuple[float, float]],
    notes: Sequence[str],  # what is shown, in sentences
    title: str,
) -> LivePage:
    """Return the page of a live view, which shows the robots at rest until the first frame comes.

    InputError if there is no robot, or there are too many.
    """
    _check_number(len(robots), "robots")
    first = next(iter(robots.values()))
    newtons = _round_below(0.25 * first.weight)
    runs = [
        {
            "name": printable_line(name),
            "color": color,
            "robot": robot_shape(robot),
            "interval": INTERVAL,
            "names": row_names,
            "home": home,
            "mass": robot.ball.mass + robot.body.mass,
            "center": robot.body.center_of_mass,
        }
        for (name, robot), row_names, home, color in zip(
            robots.items(), names, homes, RUN_COLORS, strict=False
        )
    ]
    data: dict[str, object] = {
        "world": world,
        "arrow": {"newtons": newtons, "metres": _ARROW * first.ball.radius},
        "runs": runs,
        "notes": [printable_line(note) for note in (*notes, BODY_NOTE)],
    }
    style = "".join(map(web_file, ("uPlot.min.css", "replay.css", "live.css", "page.css")))
    script = plot_script() + _script("live", "page")
    text = _document(title, lead="", body=_element("live", data), style=style, script=script, policy="")
    policy = f"{_policy(style, script)}; img-src data:; base-uri 'none'; form-action 'none'"
    return LivePage(html=text, policy=policy)


def _policy(style: str, script: str) -> str:
    return f"default-src 'none'; script-src {hash_source(script)}; style-src {hash_source(style)}"


def _document(title: str, *, lead: str, body: str, style: str, script: str, policy: str) -> str:
    """Return a whole page; its server gives the policy if it has none."""
    shown, words = (html.escape(printable_line(text)) for text in (title, lead))
    below = f'<p class="lead">{words}</p>\n' if lead else ""
    given = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n' if policy else ""
    icon = "" if policy else '<link rel="icon" href="data:,">\n'  # else a browser asks the server for one
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
{given}{icon}<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="generator" content="Ballbot {version("ballbot")}">
<title>{shown}</title>
<style>{style}</style>
</head>
<body>
<main>
<header><h1>{shown}</h1><button type="button" data-ballbot-theme>Theme</button></header>
{below}{body}</main>
<script>{script}</script>
</body>
</html>
"""


def hash_source(text: str) -> str:
    """Return a script or style as a Content-Security-Policy allows it."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def web_file(name: str, package: str = "ballbot.viewer") -> str:
    """Return a script or style sheet of a package's `web` folder."""
    return (files(package) / "web" / name).read_text(encoding="utf-8")


@cache
def plot_script() -> str:
    """Return uPlot, which draws time series (MIT licence), with its licence."""
    return f"/*! uPlot:\n{web_file('uPlot.LICENSE')}*/\n{web_file('uPlot.iife.min.js')}\n"


@cache
def _script(*scripts: str) -> str:
    parts = "\n".join(web_file(f"{name}.js") for name in (*_SCRIPTS, *scripts))
    return f'(() => {{\n"use strict";\n{parts}\n}})();'


def _check_number(count: int, what: str) -> None:
    if count == 0:
        raise InputError("There is nothing to show. Name one or more logs, or a robot.")
    if count > MOST_RUNS:
        raise InputError(f"{count} {what} are given; a view shows at most {MOST_RUNS}.")


def _run(name: str, motion: ReplayMotion, robot: Robot, color: str) -> dict[str, object]:
    return {
        "name": printable_line(name),
        "color": color,
        "robot": robot_shape(robot),
        "interval": motion.interval,
        "rows": motion.rows,
        "columns": {key: packed(values) for key, values in motion.columns.items()},
        "signals": [asdict(signal) for signal in motion.signals],
        "notes": [printable_line(note) for note in motion.notes],
    }


def robot_shape(robot: Robot) -> dict[str, object]:
    """Return what the page draws of a robot, in the body frame with its origin at the ball's center [m]."""
    wheels, radius = robot.wheels, robot.wheels.radius
    return {
        "ball_radius": robot.ball.radius,
        "wheel_radius": radius,
        "rollers": {
            "radius": wheels.rollers.radius,
            "half_length": float(np.sqrt(radius * wheels.rollers.radius)),
            "per_row": wheels.rollers.per_row,
            "offsets": row_offsets(wheels).tolist(),
        },
        "wheels": [
            {key: getattr(wheel, key).tolist() for key in ("contact", "rolling", "axle", "center")}
            for wheel in wheel_shapes(robot)
        ],
        "body": asdict(shown_body(robot)),
    }


def shown_body(robot: Robot) -> BodyShape:
    """Return the body as it is drawn: if its lower disc lies within ball and wheels, the picture begins above them."""
    body, wheels, radius = body_shape(robot.body), robot.wheels, robot.wheels.radius
    half = (wheels.rollers.rows - 1) * wheels.rollers.row_spacing / 2.0 + wheels.rollers.radius
    above = radius * abs(np.cos(wheels.tilt)) + half * abs(np.sin(wheels.tilt))
    highest = max(float(wheel.center[2]) for wheel in wheel_shapes(robot)) + above
    bottom = max(body.bottom, robot.ball.radius, highest) + 0.2 * radius
    return BodyShape(radius=body.radius, bottom=bottom, top=max(body.top, bottom + radius))


def _arrow(shown: Sequence[tuple[ReplayMotion, Robot]]) -> dict[str, float] | None:
    """Return how long the arrow of a force is: `metres` for `newtons`, round; None if no log has torques."""
    forces, radius = [], 0.0
    for motion, robot in shown:
        radius = max(radius, robot.ball.radius)
        if "torque_high" in motion.columns:
            forces.append(float(np.quantile(motion.columns["torque_high"], 0.95)) / robot.wheels.radius)
    largest = max(forces, default=0.0)
    if not largest > 0.0:
        return None
    newtons = _round_below(largest)
    return {"newtons": newtons, "metres": _ARROW * radius * newtons / largest}


def _round_below(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, the greatest up to a value above zero."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= value * (1.0 + 1e-12)))
