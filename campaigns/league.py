"""The league: every controller on every course of the nominal twin, with friction identified from its own logs.

.venv/bin/python -m campaigns.evidence league
"""

from __future__ import annotations

from collections.abc import Sequence

from ballbot import Robot
from ballbot.fitting.run import Run
from ballbot.progress import ProgressCallback, ignore_progress
from ballbot.report.comparison import OVERALL_HEADINGS, overall_rows
from ballbot.rounding import unit_heading
from ballbot.workflows.candidates import parse_candidates
from ballbot.workflows.courses import LEAGUE, Course, choose_courses
from ballbot.workflows.league import METRICS, League, Standing, run_league, standing
from campaigns.compensation import identified_robot
from campaigns.section import Section

SEEDS = tuple(range(200, 204))
#: what enters: the nominal gain with each compensation, with the Kalman filter's state, and the precise controller
ENTRANTS = ("none", "full", "partial", "partial@kalman", "precise")


def play_league(
    robot: Robot,
    courses: Sequence[Course],
    *,
    seeds: Sequence[int] = SEEDS,
    processes: int | None = None,
    progress: ProgressCallback = ignore_progress,
) -> League:
    """Put those who enter through the courses; `robot` has the friction that is compensated."""
    entrants = parse_candidates(ENTRANTS)
    return run_league(
        robot,
        {one.name: one.controller(robot) for one in entrants},
        courses,
        seeds=seeds,
        processes=processes,
        run=Run(progress=progress),
    )


def campaign() -> Section:
    """Return the section of docs/generated/evidence.md."""
    robot = identified_robot(Robot.load("alten"))
    league = play_league(robot, choose_courses(LEAGUE, robot, "twin"))
    return section(league)


def section(league: League) -> Section:
    """Return a league as a section: a row for each course and controller, the overall ratios below."""
    metrics = [one for one in METRICS if one.key != "rms_torque"]
    rows = [
        [
            course.name,
            name,
            *(_cell(standing(league, course.name, name), one.key) for one in metrics),
            _falls(league, course, name),
        ]
        for course in league.courses
        for name in league.controllers
    ]
    return Section(
        title="The league",
        before=f"The courses of `ballbot compare --scenarios league` on the nominal twin, {len(league.seeds)} seeds, "
        "the nominal gain without compensation and with full and partial compensation of the friction identified from "
        "two of the twin's own logs, and the precise controller; on-board state only, the Kalman filter's for precise "
        "and where the name says `@kalman`. Means over the seeds, and half the width of their 95 % "
        "intervals (Student's); [compare](../compare.md) defines the numbers.",
        columns=["course", "controller", *(unit_heading(one.heading, one.unit) for one in metrics), "falls"],
        rows=rows,
        after=_overall(league),
    )


def _overall(league: League) -> str:
    rows = "\n".join(f"| {' | '.join(row)} |" for row in overall_rows(league))
    return f"""Each number over {league.controllers[0]}'s on the same course and seed: geometric means over the \
courses, 95 % intervals over the seeds.

| {" | ".join(OVERALL_HEADINGS)} |
|---|{"---:|" * (len(OVERALL_HEADINGS) - 1)}
{rows}"""


def _cell(found: Standing, key: str) -> str:
    metric = next(one for one in METRICS if one.key == key)
    mean = found.means[key]
    if not mean.runs:
        return "–"
    late = "≥ " if key == "settling_time" and found.arrived < found.runs - found.falls else ""
    half = 0.5 * metric.scale * (mean.high - mean.low)
    return f"{late}{metric.scale * mean.mean:.{metric.decimals}f} ± {half:.{metric.decimals}f}"


def _falls(league: League, course: Course, name: str) -> str:
    found = standing(league, course.name, name)
    return f"{found.falls} of {found.runs}"
