"""Candidates of `study`: the accuracy of the precise controller.

.venv/bin/python -m campaigns.evidence choice

The friction is identified from two logs of the nominal twin, as in the demo. The controllers are the study's
candidates (`ballbot.workflows.controller_choice.candidates`), run on the nominal twin with other seeds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import Reference, circle, figure_eight, square
from ballbot.robot import Robot
from ballbot.twin import Scenario
from ballbot.workflows.controller_choice import candidates
from ballbot.workflows.grid import Condition, Grid, GridTable, TwinRobot, run_grid
from ballbot.workflows.metrics import Score
from ballbot.workflows.statistics import MedianEstimate, Paired, median_with_interval
from campaigns.compensation import identified
from campaigns.section import Section

ALTEN = Robot.load("alten")
SAMPLE_TIME = 0.005
SEEDS = tuple(range(600, 620))
#: of the study's targets: each a reference, and how long it is followed [s]
COURSES: Mapping[str, tuple[Reference, float]] = {
    "square": (square(), 32.0),
    "circle": (circle(), 40.0),
    "figure eight": (figure_eight(), 46.0),
}


def _runs(tried: Mapping[str, Controller]) -> GridTable[Score]:
    """Run controllers on the nominal twin, on all cores."""
    plant = TwinRobot(robot=ALTEN, scenario=Scenario.nominal(ALTEN), known=ALTEN)
    conditions = [
        Condition(
            plant=plant, reference=partial(_reference, course), duration=duration, seed=seed, course=course
        )
        for course, (_, duration) in COURSES.items()
        for seed in SEEDS
    ]
    return run_grid(Grid(controllers=tried, conditions=conditions))


def _reference(course: str) -> Reference:
    return COURSES[course][0]


def _peaks(scores: Sequence[Score]) -> NDArray[np.float64]:
    return np.array([one.peak_position_error if one.ended is None else np.nan for one in scores])


def choice() -> Section:
    """Run none and precise on three courses, 20 seeds each."""
    known = candidates(identified(ALTEN), sample_time=SAMPLE_TIME)
    found = _runs({name: known[name] for name in ("none", "precise")})
    rows = []
    for course in COURSES:
        scores = [found.of(name, course) for name in ("none", "precise")]
        none, precise = map(_peaks, scores)
        falls = [sum(one.ended is not None for one in runs) for runs in scores]
        ratio = Paired(none, precise).median_ratio
        rows.append(
            [
                course,
                _millimetres(median_with_interval(none)),
                _millimetres(median_with_interval(precise)),
                f"{1e3 * max(precise):.1f}",
                f"{ratio.median:.1f} ({ratio.low:.1f} to {ratio.high:.1f})",
                f"{falls[0]} and {falls[1]} of {len(SEEDS)}",
            ]
        )
    return Section(
        title="The precise controller and the soft gain on three courses",
        before="The precise controller and the nominal gain without compensation on the nominal twin, "
        f"{len(SEEDS)} seeds, friction identified from two of its logs, on-board sensors only. Peak error of the true "
        "position once settled [mm]: median over the seeds with its 95 % interval, and the ratio seed by seed.",
        columns=["course", "none", "precise", "precise, worst", "none / precise", "falls"],
        rows=rows,
    )


def _millimetres(estimate: MedianEstimate) -> str:
    return f"{1e3 * estimate.median:.1f} ({1e3 * estimate.low:.1f} to {1e3 * estimate.high:.1f})"
