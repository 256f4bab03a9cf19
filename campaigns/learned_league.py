"""Learned controllers beside the designed ones on the benchmark's courses, on the loop and on the twin.

.venv/bin/python -m campaigns.learned_league

Trainings and leagues that are finished are kept in build/learned_policies and build/learned_league.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.control.presets import precise_controller
from ballbot.fitting.run import Run, Threads
from ballbot.learning.learn import FILM_PARTS, Learned, learn
from ballbot.learning.robots import drawn_robots
from ballbot.learning.tasks import task_named
from ballbot.progress import ignore_progress
from ballbot.report.comparison import course_sheet
from ballbot.robot import Robot
from ballbot.twin.scenario import Scenario
from ballbot.workflows.candidates import parse_candidates
from ballbot.workflows.courses import Course, PlantName, choose_courses
from ballbot.workflows.league import League, run_league, standing
from ballbot.workflows.metrics import METRIC_BY_KEY, falls_of, values_of
from ballbot.workflows.statistics import mean_with_interval
from campaigns.section import Section, finished, markdown_table

PRESET = "alten"
DESIGNED = ("full", "partial", "precise")
#: the task whose policies run each course
TASK_OF = {
    "benchmark_hold": "balance",
    "benchmark_square": "track",
    "benchmark_figure_eight": "track",
    "step": "track",
    "push_8_newton_seconds": "push",
    "rising_pushes": "push",
    "velocity_steps": "drive",
    "stop": "drive",
    "faster": "drive",
    "slope_1": "balance",
    "slope_3": "balance",
    "slope_5": "balance",
    "payload_on_and_off": "balance",
    "carpet": "track",
    "uneven_floor": "track",
}
#: policies alone, and added to the precise controller; of each, trainings of a task
KINDS, TRAININGS = ("learned", "residual"), 3
#: on the twin each seed has another training
SEEDS, TWIN_SEEDS = 20, TRAININGS
_PACKAGES = ("mechanics", "simulation", "control", "estimation", "robot", "twin", "learning", "workflows")


def known_robot() -> Robot:
    """Return the robot with the nominal scenario's friction, which every controller is made for."""
    return Robot.load(PRESET).replace(friction=Scenario.nominal(PRESET).friction)


def trained(piece: tuple[str, str, int]) -> Learned:
    """Learn a task with a seed, alone or onto the precise controller."""
    name, kind, seed = piece
    robot = known_robot()
    robots = drawn_robots(robot, Scenario.nominal(PRESET), "boxes")
    base = precise() if kind == "residual" else None
    return learn(robots, task_named(name), base=base, run=Run(seed=seed, progress=ignore_progress))


def designed() -> dict[str, Feedback]:
    """Return the designed controllers by name."""
    found: dict[str, Feedback] = {
        one.name: one.controller(known_robot()) for one in parse_candidates(DESIGNED)
    }
    return found | {"precise": precise()}


def precise() -> Controller:
    """Return the precise controller as fast as the motors allow: without the cap of speed for people's safety."""
    controller = precise_controller(known_robot())
    shaping = controller.parts.shaping
    assert shaping is not None
    uncapped = replace(shaping, speed_cap=shaping.speed_limit)
    return controller.with_parts(replace(controller.parts, shaping=uncapped))


@dataclass(frozen=True, kw_only=True)
class Race:
    """Controllers on courses, all on the loop or all on the twin."""

    controllers: Mapping[str, Feedback]  #: by name
    courses: tuple[str, ...]
    plant: PlantName
    seeds: tuple[int, ...]

    def league(self) -> League:
        """Run it."""
        robot = known_robot()
        courses = choose_courses(",".join(self.courses), robot, self.plant)
        return run_league(robot, self.controllers, courses, seeds=self.seeds, workers=Threads(count=1))


def races(policies: Mapping[str, Controller]) -> dict[str, Race]:
    """Return the races with policies by "TASK_KIND_SEED": of a task on the loop, and with each seed on the twin."""
    found = {}
    for task in dict.fromkeys(TASK_OF.values()):
        courses = tuple(name for name, own in TASK_OF.items() if own == task)
        learned = {f"{kind} {k}": policies[f"{task}_{kind}_{k}"] for kind in KINDS for k in range(TRAININGS)}
        found[f"{task}_loop"] = Race(
            controllers=designed() | learned, courses=courses, plant="model", seeds=tuple(range(1, 1 + SEEDS))
        )
        for k in range(TWIN_SEEDS):
            own = {kind: learned[f"{kind} {k}"] for kind in KINDS}
            found[f"{task}_twin_{k}"] = Race(
                controllers=designed() | own, courses=courses, plant="twin", seeds=(1 + k,)
            )
    return found


def together(leagues: Sequence[League]) -> League:
    """Return leagues with other seeds each as one."""
    first = leagues[0]
    return replace(
        first,
        seeds=tuple(seed for league in leagues for seed in league.seeds),
        scores={
            key: tuple(score for league in leagues for score in league.scores[key]) for key in first.scores
        },
    )


def merit(league: League, course: Course, name: str) -> tuple[int, float]:
    """Return what makes a controller better on a course than another: fewer falls, then its first number."""
    metric = METRIC_BY_KEY[course.metrics[0]]
    result = standing(league, course.name, name)
    mean = result.means[metric.key].mean
    return 0 if course.until_fall else -result.falls, mean if metric.better == "above" else -mean


def middle(league: League, course: Course, kind: str) -> str:
    """Return the training of a kind that is neither the best nor the worst on a course."""
    names = sorted(_trainings(league, kind), key=lambda name: merit(league, course, name))
    return names[len(names) // 2]


def verdict(league: League, course: Course, kind: str) -> str:
    """Return whether all trainings of a kind beat a designed controller on a course, or all lose to it.

    One is better that falls less often, or equally often with the better first number: its difference seed by seed, by
    its 95 % interval.

    Policies alone have the best designed controller of the course as a rival, those that are added the precise one.
    """
    rivals = DESIGNED if kind == "learned" else ("precise",)
    rival = max(rivals, key=lambda name: merit(league, course, name))
    metric = METRIC_BY_KEY[course.metrics[0]]
    signs = []
    for name in _trainings(league, kind):
        own, other = league.scores[course.name, name], league.scores[course.name, rival]
        difference = mean_with_interval(values_of(own, metric.key) - values_of(other, metric.key)).sign
        fell = 0 if course.until_fall else falls_of(own) - falls_of(other)
        signs.append(-fell if fell else difference if metric.better == "above" else -difference)
    better, worse = sum(sign > 0 for sign in signs), sum(sign < 0 for sign in signs)
    if better == len(signs):
        return f"beats {rival}"
    if worse == len(signs):
        return f"loses to {rival}"
    return f"{rival}: {better} better, {worse} worse" if len(signs) > 1 else f"as {rival}"


def _trainings(league: League, kind: str) -> list[str]:
    return [name for name in league.controllers if name.startswith(kind)]


def rows_of(league: League, plant: str) -> list[list[str]]:
    """Return a row for each course: the designed controllers, and of each kind the middle training and the verdict."""
    scores = dict(league.scores)
    for course in league.courses:
        for kind in KINDS:
            scores[course.name, kind] = league.scores[course.name, middle(league, course, kind)]
    shown = course_sheet(replace(league, controllers=(*DESIGNED, *KINDS), scores=scores)).rows
    rows = []
    for course, (name, *cells) in zip(league.courses, shown, strict=True):
        learned, residual = (verdict(league, course, kind) for kind in KINDS)
        rows.append([f"{name}, {plant}", *map(str, cells[:-1]), learned, str(cells[-1]), residual])
    return rows


def curves(learned: Mapping[str, Learned]) -> str:
    """Return a table of the rewards in the course of the trainings, beside those of controllers without a policy."""
    rows = []
    for task in dict.fromkeys(TASK_OF.values()):
        row = [task]
        for kind in KINDS:
            own = [learned[f"{task}_{kind}_{k}"] for k in range(TRAININGS)]
            row.append(f"{own[0].baseline:.3f}")
            for part in FILM_PARTS[1:]:
                points = [one.curve[round(part * len(one.curve)) - 1] for one in own]
                reward, seconds = (
                    np.median([getattr(at, key) for at in points]) for key in ("reward", "seconds")
                )
                row.append(f"{reward:.3f} ({seconds:.0f} s)")
        rows.append(row)
    after = ["after 1/6", "after 1/3", "at its end"]
    return markdown_table(["task", "LQR", *after, "precise", *after], rows)


def _courses_of() -> str:
    by_task = {task: [name for name, own in TASK_OF.items() if own == task] for task in TASK_OF.values()}
    return "; ".join(f"{task}: {', '.join(names).replace('_', ' ')}" for task, names in by_task.items())


def campaign() -> Section:
    """Run what is missing and return the table of courses."""
    alone = Threads(count=1)
    tasks = tuple(dict.fromkeys(TASK_OF.values()))
    pieces = {f"{t}_{kind}_{k}": (t, kind, k) for t in tasks for kind in KINDS for k in range(TRAININGS)}
    learned = finished("learned_policies", trained, pieces, packages=_PACKAGES, workers=alone)
    to_run = races({name: one.controller for name, one in learned.items()})
    leagues = finished("learned_league", Race.league, to_run, packages=_PACKAGES, workers=alone)
    by_course = {}
    for task in tasks:
        on_twin = together([leagues[f"{task}_twin_{k}"] for k in range(TWIN_SEEDS)])
        for plant, league in (("loop", leagues[f"{task}_loop"]), ("twin", on_twin)):
            for course, row in zip(league.courses, rows_of(league, plant), strict=True):
                by_course[course.name, plant] = row
    return Section(
        title="Learned and designed controllers",
        before=f"The courses of `ballbot compare --courses benchmark`, preset {PRESET} with the nominal scenario's "
        f"friction: one number of each course, the mean of {SEEDS} seeds on the loop and of {TWIN_SEEDS} on the twin, "
        f"with its 95 % interval. A course has the policy of the task nearest to it ({_courses_of()}), which favours "
        f"learning. Of each task {TRAININGS} policies were learned alone and {TRAININGS} onto the precise controller; "
        "shown is the middle one of the course, on the twin another one with each seed. Beside them: whether all of "
        "them fall less often, or equally often and have the better number by the interval of the difference, seed "
        "by seed. Policies alone are compared with the best designed controller of the course, the others with the "
        "precise one, whose cap of speed for people's safety is raised to what the motors allow. "
        "A run that fell enters no mean but those of rising pushes and the largest speed. ≥ where some "
        "run had not arrived, or was not at rest, at its end.",
        columns=["course, plant", *DESIGNED, "learned", "which", "onto precise", "which"],
        rows=[by_course[name, plant] for name in TASK_OF for plant in ("loop", "twin")],
        after=f"The reward a second in the course of the trainings, with exploration, and by the clock: medians of "
        f"{TRAININGS}, alone beside the LQR and then onto the precise controller beside that one alone.\n\n"
        + curves(learned),
    )


if __name__ == "__main__":
    print(campaign().markdown())
