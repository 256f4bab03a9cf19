"""The league: every controller on the same courses with the same seeds, and the differences with intervals.

A grid (`ballbot.workflows.grid`) of many controllers on many courses. The standings are means over the seeds, and every
controller against the first one, with intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ballbot.control.interface import Feedback
from ballbot.control.overcompensation import has_friction
from ballbot.control.source import ControllerLike, as_controller
from ballbot.fitting.run import ALL_CORES, DEFAULT_RUN, Executor, Run
from ballbot.log import Log
from ballbot.results import to_results
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.rounding import digits
from ballbot.summary import Reported
from ballbot.twin.scenario import Scenario, assumed_friction
from ballbot.workflows.bounds import bounds_of
from ballbot.workflows.candidates import parse_candidates
from ballbot.workflows.courses import Course, PlantName, choose_courses
from ballbot.workflows.grid import Condition, GridRun, GridTable, LoopRobot, TwinRobot, grid_runs, run_grid
from ballbot.workflows.metrics import OF_SOME_COURSES, Score, falls_of, score_results, true_place, values_of
from ballbot.workflows.statistics import Estimate, fraction_with_interval, mean_ratio, mean_with_interval

DEFAULT_CONTROLLERS = ("none", "full", "partial")
#: a track's points in a second, and the decimals they are kept with [m]
_TRACK_RATE, _TRACK_DECIMALS = 10.0, 4

#: of the largest push, and the largest that is tried over the bound, which holds to first order
_HALVINGS, _BEYOND_BOUND = 9, 1.1

_Answer = tuple[Score, Log | None]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class League(Reported):
    """The results of every run."""

    robot: str  #: its name
    courses: tuple[Course, ...]
    controllers: tuple[str, ...]  #: by name; the others are compared with the first
    seeds: tuple[int, ...]
    scores: Mapping[tuple[str, str], tuple[Score, ...]]  #: by course and controller, seed by seed
    tracks: Mapping[tuple[str, str], Log]  #: the true path and the reference with the first seed
    #: by course, what no controller passes: SI units by the score's names, as `bounds_of`
    bounds: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    friction: str = ""  #: which friction was assumed, in a sentence, if the robot's file has none

    def to_dict(self) -> dict[str, object]:
        """Return the entries of results.json: standings with their intervals, and every run's score."""
        courses = {}
        for course in self.courses:
            controllers = {
                name: to_results(standing(self, course.name, name))
                | {"scores": [score_results(score) for score in self.scores[course.name, name]]}
                for name in self.controllers
            }
            courses[course.name] = {
                "about": course.about,
                "plant": course.on,
                "duration": course.duration,
                "settle": course.rules.settle,
                "controllers": controllers,
            } | ({"bounds": self.bounds[course.name]} if self.bounds.get(course.name) else {})
        return {
            "robot": self.robot,
            "friction": self.friction,
            "seeds": self.seeds,
            "first": self.controllers[0],
            "overall": {name: overall(self, name) for name in self.controllers},
            "courses": courses,
        }


def with_assumed_friction(robot: RobotLike) -> tuple[Robot, str]:
    """Return a robot with its own friction or the one assumed, and a sentence on the latter."""
    robot = as_robot(robot)
    if has_friction(robot.friction):
        return robot, ""
    friction = assumed_friction(robot)
    factor = digits(friction.coulomb[0] / Scenario.nominal(robot).friction.coulomb[0], 2)
    return robot.replace(friction=friction), (
        f"The robot file of {robot.name} has no friction: it runs with the nominal scenario's, the wheels' torques "
        f"times {factor} for its wheels' load. The controllers know it."
    )


def compare(
    robot: RobotLike,
    controllers: Mapping[str, ControllerLike] | Sequence[str] = DEFAULT_CONTROLLERS,
    *,
    courses: str = "motions",
    plant: PlantName = "model",
    seeds: Sequence[int] = (1, 2, 3),
    workers: Executor = ALL_CORES,
    run: Run = DEFAULT_RUN,
) -> League:
    """Compare controllers on the same courses with the same seeds.

    Parameters
    ----------
    robot : Robot, preset or robot file
        One whose file has no friction gets that of the nominal scenario for its load (`assumed_friction`).
    controllers : sequence of str, or mapping of str to Controller, controller file or function
        By name, or as `ballbot compare` names them.
    courses : str
        A set of courses, or courses of it, as `ballbot compare --courses` takes them.
    plant : {"model", "twin"}
        The compiled loop, or the physics engine.
    seeds : sequence of int
        Of the start and of all that is random in the plant.
    workers : Executor, optional
        All cores if not given.
    run : Run, optional
        Progress.

    Returns
    -------
    League

    Raises
    ------
    InputError
        If a name is unknown, and as `run_league`.

    Examples
    --------
    >>> league = compare("alten", ["none", "precise"], courses="square", seeds=[1])
    >>> one, other = (league.scores["square", name][0] for name in ("none", "precise"))
    >>> other.peak_position_error < one.peak_position_error
    True
    """
    known, assumed = with_assumed_friction(robot)
    if not isinstance(controllers, Mapping):
        controllers = {one.name: one.controller(known) for one in parse_candidates(controllers)}
    by_name = {name: as_controller(source, known) for name, source in controllers.items()}

    chosen = choose_courses(courses, known, plant)
    if assumed:
        chosen = [course.with_wheel_friction(known.friction) for course in chosen]
    found = run_league(known, by_name, chosen, seeds=seeds, workers=workers, run=run)
    return replace(found, friction=assumed)


def run_league(
    robot: RobotLike,
    controllers: Mapping[str, Feedback],
    courses: Sequence[Course],
    *,
    seeds: Sequence[int],
    workers: Executor = ALL_CORES,
    run: Run = DEFAULT_RUN,
) -> League:
    """Run every controller on every course with every seed; see `run_grid` for workers.

    A seed determines everything random in the plant, and the start: at rest at the origin, leaning by up to 0.02 rad.

    Parameters
    ----------
    robot : Robot, preset or robot file
        As described; courses may differ from it. The loop has its friction, the twin that of the scenario.
    controllers : mapping of str to Feedback
        By name; every run gets a copy, and on the twin the on-board state that it is made for.
    courses : sequence of Course
        All on the loop, or all on the twin.

    Raises
    ------
    InputError
        If there is nothing to run, a controller fails, or a run cannot be scored.
    """
    robot = as_robot(robot)
    ask = partial(_scored, seeds[0] if seeds else 0)
    solve = partial(run_grid, ask=ask, workers=workers, run=run)
    once = [course for course in courses if course.largest_push is None]
    plants = {course.name: course.plant(robot) for course in once}
    conditions = [_condition(course, plants[course.name], seed) for seed in seeds for course in once]
    answers: dict[tuple[str, str], tuple[_Answer, ...]] = {}
    if once or not courses:
        table = solve(grid_runs(controllers, conditions))
        answers = {
            (course.name, name): table.of(name, course.name) for course in once for name in controllers
        }
    bounds = {course.name: bounds_of(course, robot) for course in courses}
    for course in courses:
        if course.largest_push is not None:
            largest = _BEYOND_BOUND * bounds[course.name]["largest_impulse"]
            for name, controller in controllers.items():
                named = name, controller
                answers[course.name, name] = _largest_pushes(robot, named, course, seeds, solve, largest)
    return League(
        robot=robot.name,
        courses=tuple(courses),
        controllers=tuple(controllers),
        seeds=tuple(seeds),
        scores={key: tuple(score for score, _ in each) for key, each in answers.items()},
        tracks={key: track for key, each in answers.items() for _, track in each if track is not None},
        bounds=bounds,
    )


def _condition(course: Course, plant: LoopRobot | TwinRobot, seed: int) -> Condition:
    return Condition(
        plant=plant,
        reference=course.reference_spec.reference,
        duration=course.duration,
        seed=seed,
        course=course.name,
        rules=course.rules,
    )


def _largest_pushes(
    robot: Robot,
    named: tuple[str, Feedback],
    course: Course,
    seeds: Sequence[int],
    solve: Callable[[Sequence[GridRun]], GridTable[_Answer]],
    largest: float,
) -> tuple[_Answer, ...]:
    """Return the answer for each seed to the largest push from which the robot recovered; if to none, to a fall."""
    search = course.largest_push
    assert search is not None
    low, high, best = np.zeros(len(seeds)), np.full(len(seeds), largest), list[_Answer]()
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        pushed = zip(seeds, middle.tolist(), strict=True)
        plants = [course.plant(robot, search.push(impulse, seed)) for seed, impulse in pushed]
        conditions = [_condition(course, plant, seed) for seed, plant in zip(seeds, plants, strict=True)]
        answers = solve(grid_runs(dict([named]), conditions)).answers
        recovered = np.array([score.ended is None for score, _ in answers])
        low, high = np.where(recovered, middle, low), np.where(recovered, high, middle)
        pairs = zip(recovered.tolist(), answers, best or answers, strict=True)
        best = [new if better else old for better, new, old in pairs]
    found = zip(best, low.tolist(), strict=True)
    return tuple((replace(score, largest_impulse=impulse), track) for (score, track), impulse in found)


def _scored(first: int, run: GridRun, log: Log) -> tuple[Score, Log | None]:
    """Return a run's score, and its true path (t, x, y, ref_x, ref_y) if it is of the first seed."""
    if run.condition.seed != first:
        return run.score(log), None
    step = max(1, round(1.0 / (_TRACK_RATE * log.sample_time))) if len(log) > 1 else 1
    truth = true_place(log)
    names = ("t", "x", "y", "ref_x", "ref_y")
    track = {name: np.round(truth[name][::step], _TRACK_DECIMALS) for name in names}
    return run.score(log), Log(track, ended=log.ended)


#: that are never zero, so that their ratios are finite
RATIOS = ("peak_position_error", "rms_position_error", "high_frequency_torque", "energy")


@dataclass(frozen=True, kw_only=True)
class Standing:
    """A controller's results on a course. Runs that fell count as falls only, and have no errors."""

    runs: int
    falls: int
    fall_interval: tuple[float, float]  #: of their probability, 95 %
    arrived: int  #: runs that always settled within the band
    rested: int  #: runs that came to rest if they had to
    means: Mapping[str, Estimate]  #: by the score's names, over the runs that stood, SI units
    differences: Mapping[str, Estimate]  #: from the first controller, seed by seed; empty for itself


@dataclass(frozen=True, kw_only=True)
class Overall:
    """A controller over all courses."""

    runs: int
    falls: int
    fall_interval: tuple[float, float]  #: of their probability, 95 %
    ratios: Mapping[str, Estimate]  #: to the first controller, by the names in RATIOS; empty for itself


def standing(league: League, course: str, controller: str) -> Standing:
    """Return a controller's standing on a course."""
    scores = league.scores[course, controller]
    first = league.scores[course, league.controllers[0]]
    falls = falls_of(scores)
    shown = next(each.metrics for each in league.courses if each.name == course)
    numbers = [
        name
        for name in Score.__dataclass_fields__
        if name not in ("ended", "arrived", "rested") and (name not in OF_SOME_COURSES or name in shown)
    ]
    return Standing(
        runs=len(scores),
        falls=falls,
        fall_interval=fraction_with_interval(falls, len(scores)),
        arrived=sum(score.arrived for score in scores),
        rested=sum(score.rested for score in scores),
        means={name: mean_with_interval(values_of(scores, name)) for name in numbers},
        differences={
            name: mean_with_interval(values_of(scores, name) - values_of(first, name))
            for name in numbers
            if controller != league.controllers[0]
        },
    )


def overall(league: League, controller: str) -> Overall:
    """Return a controller's results over all courses except those that end in a fall.

    A ratio is the geometric mean over the courses of its number over the first controller's on the same seed; its
    interval is over the seeds. A seed's run in which either fell does not enter it.
    """
    courses = [course.name for course in league.courses if not course.until_fall]
    mine = [league.scores[course, controller] for course in courses]
    first = [league.scores[course, league.controllers[0]] for course in courses]
    everything = [score for scores in mine for score in scores]
    falls = falls_of(everything)
    return Overall(
        runs=len(everything),
        falls=falls,
        fall_interval=fraction_with_interval(falls, len(everything)),
        ratios={
            name: mean_ratio(
                *(np.array([values_of(scores, name) for scores in part]) for part in (mine, first))
            )
            for name in RATIOS
            if controller != league.controllers[0]
        },
    )
