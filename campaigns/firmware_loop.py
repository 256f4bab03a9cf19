"""The firmware's control law on the twin against Python's: software in the loop, on a course of the league.

.venv/bin/python -m campaigns.evidence firmware_loop

Both drive the same twin with the same seeds. Where a limit cycle amplifies rounding, two runs that differ in the last
bit differ by millimetres some seconds later. So the question is not whether the runs are the same, but whether their
errors differ on average.
"""

from __future__ import annotations

from collections.abc import Sequence

from ballbot import Robot
from ballbot.control.interface import Feedback
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.firmware.host import CompiledController
from ballbot.twin import Scenario
from ballbot.workflows.courses import LEAGUE, choose_courses
from ballbot.workflows.league import METRIC_BY_KEY, League, run_league, standing
from campaigns.section import Section

#: many: the nominal controller wanders by centimetres, and from run to run differently
SEEDS = tuple(range(300, 326))
COURSE = "square"
_METRICS = ("peak_position_error", "rms_position_error", "high_frequency_torque")


def pairs(seeds: Sequence[int] = SEEDS, *, processes: int | None = None) -> dict[str, League]:
    """Return, for each kind of controller, a league of Python's law and the same in C."""
    robot = Robot.load("alten").replace(friction=Scenario.nominal(Robot.load("alten")).friction)
    courses = [one for one in choose_courses(LEAGUE, robot, "twin") if one.name == COURSE]
    found = {}
    for name, controller in {
        "nominal, partial": nominal_controller(robot, compensation="partial"),
        "precise": precise_controller(robot),
    }.items():
        entrants: dict[str, Feedback] = {"Python": controller, "C": CompiledController(controller)}
        found[name] = run_league(robot, entrants, courses, seeds=seeds, processes=processes)
    return found


def campaign() -> Section:
    """Return the differences between the two laws on the twin."""
    found = pairs()
    rows = []
    for name, league in found.items():
        python, compiled = (standing(league, COURSE, one) for one in ("Python", "C"))
        for key in _METRICS:
            metric = METRIC_BY_KEY[key]
            means = [f"{metric.scale * one.means[key].mean:.3f}" for one in (python, compiled)]
            difference = compiled.differences[key]
            low, high = metric.scale * difference.low, metric.scale * difference.high
            rows.append([name, f"{metric.words} ({metric.unit})", *means, f"{low:.3f} to {high:.3f}"])
        rows.append([name, "falls", str(python.falls), str(compiled.falls), ""])
    return Section(
        title="The firmware's control law on the twin",
        before="Software in the loop: the control law in C and Python's on the league's course "
        f"{COURSE!r} of the nominal twin, {len(SEEDS)} seeds each, the same for both. The last column is the 95 % "
        "interval (Student's) of the mean difference, seed by seed.",
        columns=["controller", "number", "Python", "C", "difference"],
        rows=rows,
    )
