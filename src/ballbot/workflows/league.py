"""The league: every controller on the same courses with the same seeds, and what the differences are worth.

The result of a run follows from robot, controller, course and seed alone, wherever and in whatever order it is
computed. The runs have an order, seeds outermost, in which their scores enter the checkpoint. The standings are means
over the seeds, and every controller against the first one, with intervals.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.interface import Feedback, estimator_of
from ballbot.errors import InputError
from ballbot.fitting.checkpoint import Arrays
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.log import Log
from ballbot.progress import Progress
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.workflows.comparison import (
    Estimate,
    OrderedResults,
    fraction_with_interval,
    initial_state_of,
    mean_with_interval,
    paired_difference,
)
from ballbot.workflows.courses import Course
from ballbot.workflows.metrics import Score, score, true_place

#: points of a track in a second, and the decimals they are kept with [m, rad]
_TRACK_RATE, _TRACK_DECIMALS = 10.0, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Where the robot really was in a run, ten times a second, to a tenth of a millimetre and of a milliradian."""

    t: NDArray[np.float64]  #: (N,) [s]
    x: NDArray[np.float64]  #: (N,) [m]
    y: NDArray[np.float64]  #: (N,) [m]
    psi: NDArray[np.float64]  #: (N,) [rad]
    ended: str | None  #: why the run stopped early


@dataclass(frozen=True, kw_only=True, eq=False)
class League:
    """What became of every game."""

    robot: str  #: its name
    courses: tuple[Course, ...]
    controllers: tuple[str, ...]  #: by name; the first is what the others are held against
    seeds: tuple[int, ...]
    scores: Mapping[
        tuple[str, str], tuple[Score, ...]
    ]  #: by course and controller, in the order of the seeds
    tracks: Mapping[tuple[str, str], Track]  #: of the first seed


def run_league(
    robot: Robot,
    controllers: Mapping[str, Feedback],
    courses: Sequence[Course],
    *,
    seeds: Sequence[int],
    processes: int | None = None,
    run: Run = DEFAULT_RUN,
) -> League:
    """Put every controller through every course with every seed.

    A seed gives all that is random in the plant, and the start: at rest at the origin, leaning by up to 0.02 rad.

    Parameters
    ----------
    robot : Robot
        As it is described; courses may differ from it. Its friction is true of the model and nothing to the twin.
    controllers : mapping of str to Feedback
        By name; every run gets a copy, and on the twin the on-board state that it is made for. They are pickled if
        there is more than one process.
    courses : sequence of Course
    seeds : sequence of int
    processes : int, optional
        One for each core where not given; with one, all is done in this process.
    run : Run, optional
        Its checkpoint answers for each run; its seed is not used.

    Raises
    ------
    InputError
        Where there is nothing to play, a controller fails, or a run cannot be scored.
    """
    if not (controllers and courses and seeds):
        raise InputError("There is nothing to compare: controllers, courses and seeds are needed.")
    games = [
        _Run(
            course=course,
            name=name,
            controller=controller,
            seed=seed,
            tracked=seed == seeds[0],
        )
        for seed in seeds
        for course in courses
        for name, controller in controllers.items()
    ]
    scores: dict[tuple[str, str], list[Score]] = {(g.course.name, g.name): [] for g in games}
    tracks: dict[tuple[str, str], Track] = {}
    done, whole = 0.0, sum(game.course.duration for game in games)
    with OrderedResults(partial(_run, robot), games, processes=processes) as ahead:
        for place, game in enumerate(games):
            question = np.array([place, game.seed], dtype=np.float64)
            numbers, codes, track = run.memoize("game", question, lambda place=place: ahead.result(place))
            key, found = (game.course.name, game.name), Score.from_arrays(numbers, codes)
            scores[key].append(found)
            if game.tracked:
                tracks[key] = Track(t=track[0], x=track[1], y=track[2], psi=track[3], ended=found.ended)
            done += game.course.duration
            run.progress(Progress(stage="comparing controllers", done=done, total=whole))
    return League(
        robot=robot.name,
        courses=tuple(courses),
        controllers=tuple(controllers),
        seeds=tuple(seeds),
        scores={key: tuple(found) for key, found in scores.items()},
        tracks=tracks,
    )


@dataclass(frozen=True, kw_only=True)
class _Run:
    course: Course
    name: str
    controller: Feedback
    seed: int
    tracked: bool


def _run(robot: Robot, game: _Run) -> Arrays:
    """Return the score's numbers, the codes of why the run ended, and the track (4, N), empty unless tracked."""
    course = game.course
    log = simulate(
        course.plant(robot, estimator=estimator_of(game.controller)),
        copy.deepcopy(game.controller),
        course.asked.reference(),
        duration=course.duration,
        initial_state=initial_state_of(game.seed),
        seed=game.seed,
    )
    try:
        found = score(log, settle=course.settle, disturbed=course.disturbed)
    except InputError as error:
        raise InputError(f"Course {course.name!r}: {error}") from None
    return *found.to_arrays(), _track(log, game.tracked)


def _track(log: Log, wanted: bool) -> NDArray[np.float64]:
    if not wanted:
        return np.empty((4, 0))
    step = max(1, round(1.0 / (_TRACK_RATE * log.sample_time))) if len(log) > 1 else 1
    place = true_place(log)
    return np.round(np.array([place[name][::step] for name in ("t", "x", "y", "psi")]), _TRACK_DECIMALS)


@dataclass(frozen=True)
class Metric:
    """A number of a score, as tables and figures show it."""

    key: str  #: of `Score`
    heading: str  #: of a table's column
    words: str  #: that name it in a sentence
    _: KW_ONLY
    unit: str  #: that it is shown in
    scale: float  #: from SI to that unit
    decimals: int


#: in the order of the tables; of all of them less is better
METRICS = (
    Metric("peak_position_error", "peak", "peak position error", unit="mm", scale=1e3, decimals=0),
    Metric("rms_position_error", "RMS", "RMS position error", unit="mm", scale=1e3, decimals=0),
    Metric(
        "peak_heading_error", "heading", "peak heading error", unit="deg", scale=180.0 / np.pi, decimals=1
    ),
    Metric("settling_time", "settling", "settling time", unit="s", scale=1.0, decimals=1),
    Metric("rms_torque", "torque", "RMS torque", unit="N m", scale=1.0, decimals=3),
    Metric("high_frequency_torque", "above 10 Hz", "torque above 10 Hz", unit="N m", scale=1.0, decimals=3),
    Metric("energy", "energy", "energy exchanged", unit="J", scale=1.0, decimals=1),
)
METRIC_BY_KEY = {metric.key: metric for metric in METRICS}
#: that are never zero, so that their ratios tell something
RATIOS = ("peak_position_error", "rms_position_error", "high_frequency_torque", "energy")


@dataclass(frozen=True, kw_only=True)
class Standing:
    """A controller on a course. A run that fell has no errors: it counts among the falls and nowhere else."""

    course: str
    controller: str
    runs: int
    falls: int
    fall_interval: tuple[float, float]  #: of their probability, 95 %
    arrived: int  #: runs that always came within the band at last
    means: Mapping[str, Estimate]  #: by the score's names, over the runs that stood, SI units
    differences: Mapping[str, Estimate]  #: from the first controller, seed by seed; empty for itself

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "runs": self.runs,
            "falls": self.falls,
            "fall_interval": self.fall_interval,
            "arrived": self.arrived,
            "means": {name: asdict(one) for name, one in self.means.items()},
            "differences": {name: asdict(one) for name, one in self.differences.items()},
        }


@dataclass(frozen=True, kw_only=True)
class Overall:
    """A controller over all courses."""

    controller: str
    runs: int
    falls: int
    fall_interval: tuple[float, float]  #: of their probability, 95 %
    ratios: Mapping[str, Estimate]  #: to the first controller, by the names in RATIOS; empty for itself

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "runs": self.runs,
            "falls": self.falls,
            "fall_interval": self.fall_interval,
            "ratios": {name: asdict(one) for name, one in self.ratios.items()},
        }


def standing(league: League, course: str, controller: str) -> Standing:
    """Return how a controller did on a course."""
    scores = league.scores[course, controller]
    first = league.scores[course, league.controllers[0]]
    falls = _falls(scores)
    numbers = [name for name in Score.__dataclass_fields__ if name not in ("ended", "arrived")]
    return Standing(
        course=course,
        controller=controller,
        runs=len(scores),
        falls=falls,
        fall_interval=fraction_with_interval(falls, len(scores)),
        arrived=sum(score.arrived for score in scores),
        means={name: mean_with_interval(_values(scores, name)) for name in numbers},
        differences={
            name: paired_difference(_values(scores, name), _values(first, name))
            for name in numbers
            if controller != league.controllers[0]
        },
    )


def overall(league: League, controller: str) -> Overall:
    """Return how a controller did over all courses.

    A ratio is the geometric mean over the courses of its number over the first controller's on the same seed; its
    interval is over the seeds. A seed's run in which either fell does not enter it.
    """
    mine = [league.scores[course.name, controller] for course in league.courses]
    first = [league.scores[course.name, league.controllers[0]] for course in league.courses]
    everything = [score for scores in mine for score in scores]
    falls = _falls(everything)
    return Overall(
        controller=controller,
        runs=len(everything),
        falls=falls,
        fall_interval=fraction_with_interval(falls, len(everything)),
        ratios={name: _ratio(mine, first, name) for name in RATIOS if controller != league.controllers[0]},
    )


def league_results(league: League) -> dict[str, object]:
    """Return what results.json holds of a league: standings with their intervals, and every run's score."""
    courses = {}
    for course in league.courses:
        controllers = {
            name: standing(league, course.name, name).to_dict()
            | {"scores": [score.to_dict() for score in league.scores[course.name, name]]}
            for name in league.controllers
        }
        courses[course.name] = {
            "about": course.about,
            "plant": "model" if course.scenario is None else "twin",
            "duration": course.duration,
            "settle": course.settle,
            "controllers": controllers,
        }
    return {
        "robot": league.robot,
        "seeds": league.seeds,
        "first": league.controllers[0],
        "overall": {name: overall(league, name).to_dict() for name in league.controllers},
        "courses": courses,
    }


def _values(scores: Sequence[Score], name: str) -> list[float]:
    return [float(getattr(score, name)) if score.ended is None else np.nan for score in scores]


def _falls(scores: Sequence[Score]) -> int:
    return sum(score.ended is not None for score in scores)


def _ratio(mine: Sequence[Sequence[Score]], first: Sequence[Sequence[Score]], name: str) -> Estimate:
    own, others = (np.array([_values(scores, name) for scores in part]) for part in (mine, first))
    logs = np.ma.masked_invalid(np.log(own / others)).mean(axis=0).filled(np.nan)  # over courses, (seeds,)
    found = mean_with_interval(logs)
    mean, low, high = np.exp([found.mean, found.low, found.high]).tolist()
    return Estimate(mean=mean, low=low, high=high, runs=found.runs)
