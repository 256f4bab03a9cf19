"""Planned fast moves of the thesis's robot: their times, what bounds them, and how robots follow them.

.venv/bin/python -m campaigns.evidence fast_moves

The robot has the nominal scenario's friction and the precise controller; simulated robots have the scenario's sensors,
noise and play. The twin's wheels have rollers and slip. Motions that are finished are kept in build/fast_moves.
"""

from dataclasses import dataclass, replace

import numpy as np

from ballbot.control.presets import precise_controller
from ballbot.fitting.run import Threads
from ballbot.robot import Robot
from ballbot.rounding import percent
from ballbot.twin.scenario import Scenario
from ballbot.workflows.collocation import FAMILIES, Planner
from ballbot.workflows.plan import Followed, default_limits, follow, plan
from campaigns.section import Section, finished

SEEDS, TWIN_SEEDS = 100, 20
_PACKAGES = ("mechanics", "simulation", "control", "estimation", "robot", "twin", "workflows")


@dataclass(frozen=True, kw_only=True)
class Move:
    """A motion to plan."""

    name: str
    to: tuple[float, float, float] | None = None
    stop_from: float | None = None  #: [m/s]; nan for the largest steady speed
    margin: float = 0.2


MOVES = {
    f"{name}_{round(100 * margin)}": Move(name=words, to=to, stop_from=speed, margin=margin)
    for name, words, to, speed in (
        ("stop", "stop from 1.4 m/s", None, 1.4),
        ("short_stop", "stop from 0.8 m/s", None, 0.8),
        ("move", "2 m ahead, rest to rest", (2.0, 0.0, 0.0), None),
        ("fastest", "stop from the largest speed", None, np.nan),
        ("turn", "to [1 -1 π]", (1.0, -1.0, np.pi), None),
    )
    for margin in (0.2, 0.1)
}


def result_of(move: Move) -> list[str]:
    """Return the row of a motion."""
    robot = Robot.load("alten")
    scenario = Scenario.nominal(robot)
    robot = robot.replace(friction=scenario.friction)
    limits, speed = replace(default_limits(robot), margin=move.margin), move.stop_from
    if speed is not None and np.isnan(speed):
        top, _ = Planner(robot=robot, limits=limits).top_speed(np.array([1.0, 0.0]))
        speed = 0.999 * top
    found = plan(robot, to=move.to, stop_from=speed, limits=limits)
    controller = precise_controller(robot)
    loop = follow(found, controller, scenario, runs=SEEDS)
    twin = follow(found, controller, scenario, runs=TWIN_SEEDS, twin=True)
    used = found.used.max(axis=0)[FAMILIES.index(found.bound)]
    of_speed = f", {speed:.2f} m/s" if speed is not None and move.stop_from != speed else ""
    return [
        f"{move.name}{of_speed}",
        percent(move.margin),
        f"{found.duration:.2f}",
        f"{found.distance:.2f}",
        f"{found.bound}, {percent(used)}",
        *_followed(loop),
        *_followed(twin),
    ]


def _followed(result: Followed) -> tuple[str, str]:
    return f"{result.fell} of {result.runs}", f"{1e3 * result.peak_error:.0f}, {1e3 * result.end_error:.0f}"


def campaign() -> Section:
    """Plan and follow the motions that are missing, and return the section of docs/generated/evidence.md."""
    done = finished("fast_moves", result_of, MOVES, packages=_PACKAGES, workers=Threads(count=1))
    return Section(
        title="Planned fast moves",
        before="`alten` with the nominal scenario's friction and the precise controller, whose torque limit of 2.17 N m"
        " keeps the wheels' grip. Time and way of the move or the stop; the limit that bounds it, and what is used of"
        f" it; and simulated robots that follow it, {SEEDS} on the loop and {TWIN_SEEDS} on the twin: how many fell,"
        " and the largest distance of the others from the plan, and that two seconds after its end.",
        columns=[
            "motion",
            "margin",
            "time [s]",
            "way [m]",
            "bound by",
            "loop: fell",
            "off, at the end [mm]",
            "twin: fell",
            "off, at the end [mm]",
        ],
        rows=[done[name] for name in MOVES],
    )
