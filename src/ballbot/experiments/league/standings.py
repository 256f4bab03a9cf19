"""Who did how well: means over the seeds, and every controller against the first one, with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass

import numpy as np

from ballbot.experiments.league.play import League
from ballbot.experiments.league.statistics import (
    Estimate,
    mean_with_interval,
    paired_difference,
    share_with_interval,
)
from ballbot.experiments.score import Score


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
        fall_interval=share_with_interval(falls, len(scores)),
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
        fall_interval=share_with_interval(falls, len(everything)),
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
