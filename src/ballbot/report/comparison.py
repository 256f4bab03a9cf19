"""Comparisons of controllers: runs side by side, and the league.

Of a league: tables, an overview with intervals, and each course as it was run with the first seed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.errors import every
from ballbot.log import Log
from ballbot.report.blocks import Cell, Paragraph, Result, Section, Sheet, section
from ballbot.report.palette import INK
from ballbot.report.series import Line, Look, Panel, TimeSeries, together, true_spans
from ballbot.report.style import LOOKS, LineStyle, drawn_picture, label_of, one_panel, thinned
from ballbot.report.words import capital
from ballbot.rounding import digits, interval, unit_heading
from ballbot.summary import counted
from ballbot.workflows.courses import Course
from ballbot.workflows.league import METRIC_BY_KEY, METRICS, RATIOS, League, Standing, overall, standing
from ballbot.workflows.metrics import BAND, SETTLE, Metric, position_error, settled, true_place
from ballbot.workflows.statistics import Estimate

#: looks of a study's candidates
RUN_LOOKS: Mapping[str, Look] = {
    "none": "second",
    "full": "fourth",
    "partial": "third",
    "precise": "first",
    "precise_without_compensation": "fifth",
}
CANDIDATE_NAMES: Mapping[str, str] = {
    "none": "soft gain",
    "full": "soft gain, full compensation",
    "partial": "soft gain, partial compensation",
    "precise": "precise",
    "precise_without_compensation": "precise without compensation",
}


def paths_figure(runs: Mapping[str, Log]) -> Figure:
    """Return each controller's path over the floor beside the reference."""
    figure = Figure(figsize=(7.4, min(2.8, 0.7 + 6.5 / len(runs))), layout="constrained")
    panels = figure.subplots(1, len(runs), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (name, log) in zip(panels, runs.items(), strict=True):
        place = true_place(log)
        axes.plot(log["ref_x"], log["ref_y"], label="reference", **LOOKS["reference"])
        x, y = thinned(place["x"], place["y"])
        axes.plot(x, y, label="robot", **LOOKS[RUN_LOOKS[name]])
        axes.plot(place["x"][:1], place["y"][:1], marker="o", color=INK, markersize=3.5, linestyle="none")
        title = CANDIDATE_NAMES[name].replace(" compensation", "\ncompensation")
        axes.set_title(title + (" (fell)" if log.ended else ""), fontsize=7.5)
        axes.set_aspect("equal")
        axes.set_xlabel("$x$ [m]")
    panels[0].set_ylabel("$y$ [m]")
    return figure


def position_error_series(runs: Mapping[str, Log], caption: str) -> TimeSeries:
    """Return the distance from the reference over time, with the reference below."""
    longest = max(runs.values(), key=len)
    t, lines = together(
        [
            (CANDIDATE_NAMES[name], RUN_LOOKS[name], log.t, 1e3 * position_error(log))
            for name, log in runs.items()
        ]
    )
    reference = (
        Line("reference x", longest["ref_x"], "measured"),
        Line("reference y", longest["ref_y"], "sixth"),
    )
    return TimeSeries(
        t,
        (Panel("distance from the reference [mm]", lines, from_zero=True), Panel("reference [m]", reference)),
        caption,
        shaded=true_spans(longest.t, settled(longest, SETTLE)),
        shade="errors count",
    )


def _overall_sheet(league: League) -> Sheet:
    """Return a row for each controller: its ratios to the first one over all courses, and its falls."""
    found = {name: overall(league, name) for name in league.controllers}
    rows = [
        (
            name,
            *(_estimate(one.ratios[key]) if one.ratios else "1" for key in RATIOS),
            f"{one.falls} of {one.runs}",
        )
        for name, one in found.items()
    ]
    caption = (
        f"Each number over {league.controllers[0]}'s on the same course with the same seed: geometric means over the "
        "courses, with 95 % intervals over the seeds."
    )
    headings = ("controller", *(METRIC_BY_KEY[key].heading for key in RATIOS), "falls")
    return Sheet(headings, rows, caption)


def metric_rows(league: League, course: str) -> list[list[str | Cell]]:
    """Return a row for each metric on a course: its name and each controller's mean, below it the difference."""
    found = [standing(league, course, name) for name in league.controllers]
    return [
        *([unit_heading(one.heading, one.unit), *(_cell(each, one) for each in found)] for one in METRICS),
        ["falls", *(f"{each.falls} of {each.runs}" for each in found)],
    ]


def _cell(found: Standing, metric: Metric) -> Cell:
    """Return a mean in the metric's unit, and below it how much it differs; a star where an interval shows it."""
    # a settling time is a lower bound where some run had not arrived at its end
    late = metric.key == "settling_time" and found.arrived < found.runs - found.falls
    text = f"{'≥ ' if late else ''}{digits(metric.scale * found.means[metric.key].mean)}"
    difference = found.differences.get(metric.key)
    if difference is None or math.isnan(difference.mean):
        return Cell(text)
    star = " *" if difference.sign else ""
    return Cell(text, f"{_estimate(difference, metric.scale, plus='+')}{star}")


def _estimate(found: Estimate, scale: float = 1.0, *, plus: str = "") -> str:
    """Return a mean with its interval, such as "−120 (−130 to −110)"; of too few seeds for one the mean."""

    def shown(value: float) -> str:
        return f"{plus if value > 0.0 else ''}{digits(scale * value)}".replace("-", "−")

    mean = shown(found.mean)
    return mean if math.isnan(found.low) else f"{mean} ({interval(found.low, found.high, shown)})"


#: of controllers in turn; of the first three as in the study's report
TRACK_LOOKS: tuple[Look, ...] = ("second", "first", "third", "fourth", "sixth", "fifth")


def course_figure(league: League, course: Course) -> Figure:
    """Draw each controller's path over the floor, of one run each, with the first seed."""
    figure, floor = one_panel("$x$ [m]", "$y$ [m]", width=5.2)
    asked = _asked(course, np.arange(0.0, course.duration, 0.1))
    floor.plot(asked[:, 0], asked[:, 1], marker="o" if np.ptp(asked) == 0.0 else None, **LOOKS["reference"])
    for index, name in enumerate(league.controllers):
        track = league.tracks[course.name, name]
        label = label_of(name) + (" (fell)" if track.ended else "")
        floor.plot(track.x, track.y, label=label, **line_of(index))
    floor.set_aspect("equal", adjustable="datalim")
    figure.legend(*floor.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def course_series(league: League, course: Course) -> TimeSeries:
    """Return each controller's distance from the reference over time, of the same runs."""
    runs = []
    for index, name in enumerate(league.controllers):
        track = league.tracks[course.name, name]
        wanted = _asked(course, track.t)
        distance = 1e3 * np.hypot(track.x - wanted[:, 0], track.y - wanted[:, 1])
        look = TRACK_LOOKS[index % len(TRACK_LOOKS)]
        runs.append((name + (" (fell)" if track.ended else ""), look, track.t, distance))
    t, lines = together(runs)
    pushes = ", ".join(f"{time:g} s" for time in course.disturbed)
    return TimeSeries(
        t,
        (Panel("distance from the reference [mm]", lines, levels=(1e3 * BAND,), from_zero=True),),
        f"The same runs over time.{f' Pushed at {pushes}.' if pushes else ''}",
        level=f"{1e3 * BAND:g} mm: has arrived",
    )


def line_of(index: int) -> LineStyle:
    """Return how the controller of that place is drawn; beyond the looks again, broader."""
    again, place = divmod(index, len(TRACK_LOOKS))
    look = LOOKS[TRACK_LOOKS[place]]
    return {**look, "linewidth": look["linewidth"] + 0.7 * again}


def _asked(course: Course, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the robot is asked to be (N, 2) at times (N,)."""
    reference = course.reference_spec.reference()
    return np.array([reference(float(moment))[:2] for moment in t]).reshape(-1, 2)


def league_report(league: League) -> Result:
    """Return the page of a league."""
    plant = "the compiled loop" if league.courses[0].on == "model" else "the twin"
    courses = counted(len(league.courses), "course")
    return Result(
        title=f"{league.robot}: {counted(len(league.controllers), 'controller')} side by side",
        lead=f"{courses} on {plant}, {counted(len(league.seeds), 'seed')}, the same for all.",
        verdict=[("", _verdict(league))],
        sections=[
            section("Over all courses", _overall_sheet(league)),
            *(_course_section(league, course, place) for place, course in enumerate(league.courses)),
        ],
        undecided=[
            "How the controllers compare on a real robot: these are simulated runs of the robot as described."
        ],
        data=league.to_dict(),
    )


def _course_section(league: League, course: Course, place: int) -> Section:
    caption = (
        f"Means over the runs that did not fall. Below them, how much more or less than {league.controllers[0]}'s, "
        "seed by seed, with its 95 % interval; a star where the interval leaves zero out."
    )
    first, count = league.seeds[0], len(league.seeds)
    shown = f"seed {first}" if count == 1 else f"seed {first}, the first of {count}"
    floor = f"The path over the floor of one run of each controller, {shown}. Broad: the reference."
    made = section(
        course.name.replace("_", " ").capitalize(),
        Paragraph(f"{course.about} A run lasts {course.duration:g} s."),
        Sheet(("", *league.controllers), metric_rows(league, course.name), caption),
        drawn_picture(f"course-{place}", floor, course_figure, league, course),
        course_series(league, course),
    )
    return replace(made, folded=place > 0)


def _verdict(league: League) -> str:
    """Return which controller is the most accurate of those that never fell, and by how much."""
    found = {name: overall(league, name) for name in league.controllers}
    first, runs = league.controllers[0], counted(found[league.controllers[0]].runs, "run")
    falls = [f"{name} in {one.falls}" for name, one in found.items() if one.falls]
    fell = f"Falls in {runs} each: {', '.join(falls)}." if falls else f"No fall in {runs} each."
    peaks = {
        name: one.ratios["peak_position_error"]
        for name, one in found.items()
        if one.ratios and not one.falls and not math.isnan(one.ratios["peak_position_error"].mean)
    }
    best = min(peaks, key=lambda name: peaks[name].mean, default=first)
    if best == first or peaks[best].mean >= 1.0:
        return f"No controller that never fell has a smaller peak error than {first}. {fell}"
    equal = [name for name, one in peaks.items() if name != best and one.low <= peaks[best].high]
    if peaks[best].high >= 1.0:
        equal.append(first)
    others = f" Not significantly less accurate: {every(equal)}." if equal else ""
    return f"{capital(best)} is the most accurate: peak error {_estimate(peaks[best])} times {first}'s.{others} {fell}"
