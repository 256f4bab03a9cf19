"""The benchmark on every preset: Ballbot's own controllers on the loop, the best one on the twin.

.venv/bin/python -m campaigns.evidence benchmark

A preset without friction has the nominal scenario's for its wheels' load, as `ballbot compare` assumes, on the loop
and on the twin. Presets that are finished are kept in build/benchmark.
"""

import numpy as np

from ballbot.fitting.run import Threads
from ballbot.report.comparison import course_sheet
from ballbot.robot import Robot
from ballbot.workflows.league import League, compare, overall
from campaigns.section import Section, finished

CONTROLLERS = ("none", "full", "partial", "precise")
SEEDS, TWIN_SEEDS = 16, 1
_PACKAGES = ("mechanics", "simulation", "control", "estimation", "robot", "twin", "workflows")


def best(league: League) -> str:
    """Return the controller with the fewest falls and of these the least RMS error."""

    def rank(name: str) -> tuple[int, float]:
        of = overall(league, name)
        ratio = of.ratios["rms_position_error"].mean if of.ratios else 1.0
        return of.falls, ratio if np.isfinite(ratio) else np.inf

    return min(league.controllers, key=rank)


def results_of(preset: str) -> list[list[str]]:
    """Return a row for each course: bound, the controllers' numbers on the loop, and the best one's on the twin."""
    league = compare(preset, CONTROLLERS, courses="benchmark", seeds=range(1, 1 + SEEDS))
    chosen = best(league)
    twin = compare(preset, (chosen,), courses="benchmark", plant="twin", seeds=range(1, 1 + TWIN_SEEDS))
    rows = zip(course_sheet(league).rows, course_sheet(twin).rows, strict=True)
    return [[f"{preset}, {row[0]}", *map(str, row[1:]), f"{chosen}: {other[2]}"] for row, other in rows]


def campaign() -> Section:
    """Run the missing presets and return the section of docs/generated/evidence.md."""
    presets = {name: name for name in Robot.presets()}
    done = finished("benchmark", results_of, presets, packages=_PACKAGES, workers=Threads(count=1))
    return Section(
        title="The benchmark",
        before="The courses of `ballbot compare --courses benchmark` on every preset; one without friction has the "
        f"nominal scenario's for its wheels' load. One number of each course, the mean of {SEEDS} seeds on the "
        f"compiled loop with its 95 % interval; and the best controller on the twin, {TWIN_SEEDS} seed. The bound "
        "([what it holds for](../benchmark.md#bounds)) is of motors, grip and lean, whatever the controller; ×: a mean "
        "over it. A run that fell enters no mean but those of the largest push and the largest speed, up to 8 m/s. ≥ "
        "where some run had not arrived, or was not at rest, at its end.",
        columns=["preset, course", "bound", *CONTROLLERS, "on the twin, best"],
        rows=[row for preset in presets for row in done[preset]],
    )
