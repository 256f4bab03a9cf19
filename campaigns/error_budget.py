"""What the precise controller's errors are made of: estimate, tracking and planning, on the compiled loop and the twin.

.venv/bin/python -m campaigns.evidence error_budget

Filter and controller were tuned on seeds below 940 of the loop and 600 to 605 of the twin.
"""

from functools import partial

import numpy as np

from ballbot.control.overcompensation import certain_friction
from ballbot.control.presets import precise_controller
from ballbot.control.references import named_reference
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot
from ballbot.simulation.imperfections import Imperfections
from ballbot.workflows.grid import Condition, GridRun, LoopRobot, TwinRobot, grid_runs, run_grid
from ballbot.workflows.metrics import SETTLE, settled
from campaigns.section import Section
from campaigns.twin_logs import NOMINAL, ROBOT, identified

#: a course, and how long it is followed [s]
COURSES = {"square": 32.0, "circle": 36.0, "figure_eight": 46.0}
LOOP_SEEDS, TWIN_SEEDS = range(1000, 1100), range(630, 636)
_COLUMNS = ("error", "worst", "estimate", "by heading", "by velocity", "tracking", "planning")
_FRICTIONLESS = ROBOT.replace(friction=Friction.none(ROBOT.wheel_count))


def campaign() -> Section:
    """Return the section of docs/generated/evidence.md."""
    found = identified().robot
    return Section(
        title="What the errors are made of",
        before=f"The precise controller with compensation on the compiled loop, with rollers and play "
        f"({len(LOOP_SEEDS)} seeds), and on the nominal twin ({len(TWIN_SEEDS)} seeds); friction identified from two "
        "logs of the twin. Medians over the seeds of each part's "
        "largest size once settled [mm]: the true error; the estimated position's, and its parts by heading (the true "
        "velocity, turned by the heading's error, summed up) and by velocity (the rest); tracking, of the estimated "
        "position from the reference; and planning, the error of a robot without friction whose controller sees the "
        "true state. The parts' peaks come at different times and do not add up.",
        columns=["course", "on", *_COLUMNS],
        rows=[[course, *cells] for course in COURSES for cells in budgets(found, course)],
    )


def budgets(known: Robot, course: str) -> list[list[str]]:
    """Return the cells of the loop and of the twin, whose filter and controller know a robot: medians [mm]."""
    true = ROBOT.replace(friction=NOMINAL.friction)
    ideal = LoopRobot(model=Model(_FRICTIONLESS), imperfections=Imperfections())
    planning = _parts(ideal, _FRICTIONLESS, course, range(1))[0][0]
    plants = {
        "loop": (LoopRobot.of(true, NOMINAL, known=known), LOOP_SEEDS),
        "twin": (TwinRobot(robot=ROBOT, scenario=NOMINAL, known=known), TWIN_SEEDS),
    }
    cells = []
    for name, (plant, seeds) in plants.items():
        parts = np.array(_parts(plant, known, course, seeds))
        error, *others = np.median(parts, axis=0)
        cells.append([name, *(f"{size:.1f}" for size in (error, parts[:, 0].max(), *others, planning))])
    return cells


def _parts(plant: LoopRobot | TwinRobot, known: Robot, course: str, seeds: range) -> list[tuple[float, ...]]:
    controller = precise_controller(known, compensated=certain_friction(known))
    reference = partial(named_reference, course)
    conditions = [
        Condition(plant=plant, reference=reference, duration=COURSES[course], seed=seed) for seed in seeds
    ]
    return list(run_grid(grid_runs({course: controller}, conditions), peaks).of(course))


def peaks(_: GridRun, log: Log) -> tuple[float, ...]:
    """Return the largest sizes of the error, of the estimate's, by heading and by velocity, and of tracking [mm]."""
    truth, counts = log.truth(), settled(log, SETTLE)
    place, seen = (of["x"] + 1j * of["y"] for of in (truth, log))
    wanted = log["ref_x"] + 1j * log["ref_y"]
    turned = (np.exp(1j * (log["psi"] - truth["psi"])) - 1.0) * (truth["x_dot"] + 1j * truth["y_dot"])
    by_heading = np.cumsum(turned) * log.sample_time
    parts = (place - wanted, seen - place, by_heading, seen - place - by_heading, seen - wanted)
    return tuple(1e3 * float(np.abs(part[counts]).max()) for part in parts)
