"""Playing the league: every controller, course and seed, over all cores, with a journal to go on from.

A game is one run; its numbers follow from robot, controller, course and seed alone, wherever and in whatever order it
is played. The games have an order, seeds outermost, in which their scores enter the journal.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.interface import Feedback, estimator_of
from ballbot.errors import InputError
from ballbot.experiments.compare import start
from ballbot.experiments.league.course import Course
from ballbot.experiments.metrics import true_place
from ballbot.experiments.run_ahead import RunAhead
from ballbot.experiments.score import Score, score
from ballbot.fitting.checkpoint import Arrays, Memoize, no_checkpoint
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.simulation.run import simulate

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


def play(
    robot: Robot,
    controllers: Mapping[str, Feedback],
    courses: Sequence[Course],
    *,
    seeds: Sequence[int],
    processes: int | None = None,
    recall: Memoize = no_checkpoint,
    progress: Callable[[float], None] | None = None,
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
    recall : Recall, optional
        A checkpoint's, for a league that can be resumed.
    progress : callable, optional
        Called with the share that is done, from 0 to 1.

    Raises
    ------
    InputError
        Where there is nothing to play, a controller fails, or a run cannot be scored.
    """
    if not (controllers and courses and seeds):
        raise InputError("There is nothing to compare: controllers, courses and seeds are needed.")
    games = [
        _Game(
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
    with RunAhead(partial(_play, robot), games, processes=processes) as ahead:
        for place, game in enumerate(games):
            question = np.array([place, game.seed], dtype=np.float64)
            numbers, codes, track = recall("game", question, lambda place=place: ahead.result(place))
            key, found = (game.course.name, game.name), Score.from_arrays(numbers, codes)
            scores[key].append(found)
            if game.tracked:
                tracks[key] = Track(t=track[0], x=track[1], y=track[2], psi=track[3], ended=found.ended)
            done += game.course.duration
            if progress:
                progress(done / whole)
    return League(
        robot=robot.name,
        courses=tuple(courses),
        controllers=tuple(controllers),
        seeds=tuple(seeds),
        scores={key: tuple(found) for key, found in scores.items()},
        tracks=tracks,
    )


@dataclass(frozen=True, kw_only=True)
class _Game:
    course: Course
    name: str
    controller: Feedback
    seed: int
    tracked: bool


def _play(robot: Robot, game: _Game) -> Arrays:
    """Return the score's numbers, the codes of why the run ended, and the track (4, N), empty unless tracked."""
    course = game.course
    log = simulate(
        course.plant(robot, estimator=estimator_of(game.controller)),
        copy.deepcopy(game.controller),
        course.asked.reference(),
        duration=course.duration,
        initial_state=start(game.seed),
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
