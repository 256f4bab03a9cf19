"""Comparisons of controllers: runs side by side, the league, and two in turn on a live robot.

Of a league: tables, an overview with intervals, and each course as it was run with the first seed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from ballbot.errors import every
from ballbot.log import Log
from ballbot.report.blocks import Bullets, Cell, Column, Paragraph, Result, Section, Sheet, section, sheet_of
from ballbot.report.palette import INK
from ballbot.report.series import Line, Look, Panel, TimeSeries, together, true_spans
from ballbot.report.style import LOOKS, drawn_picture, label_of, thinned
from ballbot.report.words import capital
from ballbot.rounding import digits, interval, unit_heading
from ballbot.summary import counted
from ballbot.workflows.alternation import Alternation
from ballbot.workflows.controller_choice import ControllerChoice
from ballbot.workflows.controller_prediction import SHOWN
from ballbot.workflows.courses import Course
from ballbot.workflows.league import RATIOS, League, Standing, overall, standing
from ballbot.workflows.metrics import (
    BAND,
    METRIC_BY_KEY,
    METRICS,
    SETTLE,
    Metric,
    position_error,
    settled,
    true_place,
)
from ballbot.workflows.statistics import Estimate

#: looks of the first, second, ... controller; of a study these are the soft gain and the chosen controller
TRACK_LOOKS: tuple[Look, ...] = ("second", "first", "third", "fourth", "sixth", "fifth")
#: panels of a figure side by side
_MOST_COLUMNS = 5
_SOFT = {
    "none": "soft gain",
    "full": "soft gain, full compensation",
    "partial": "soft gain, partial compensation",
}


def candidate_name(candidate: str) -> str:
    """Return a candidate's name in sentences."""
    return _SOFT.get(candidate, candidate.replace("_", " "))


def shown_runs(choice: ControllerChoice) -> dict[str, Log]:
    """Return a study's runs on the first robot as figures name them: the soft gain and the chosen one first."""
    order = dict.fromkeys(("none", choice.chosen or "none", *choice.runs))
    return {candidate_name(name): choice.runs[name] for name in order}


def _with_looks(runs: Mapping[str, Log]) -> list[tuple[str, Look, Log]]:
    return [(name, TRACK_LOOKS[k % len(TRACK_LOOKS)], log) for k, (name, log) in enumerate(runs.items())]


def paths_figure(runs: Mapping[str, Log]) -> Figure:
    """Return each controller's path over the floor beside the reference, all to one scale."""
    columns = min(len(runs), _MOST_COLUMNS)
    rows = math.ceil(len(runs) / columns)
    figure = Figure(figsize=(7.4, rows * min(2.8, 0.7 + 6.5 / columns)), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    places = [(log[f"{of}x"], log[f"{of}y"]) for log in map(true_place, runs.values()) for of in ("", "ref_")]
    ends = np.array(
        [(values.min(), values.max()) for values in map(np.concatenate, zip(*places, strict=True))]
    )
    middle, half = ends.mean(axis=1), 0.05 + 0.55 * float(np.ptp(ends, axis=1).max())
    for axes, (name, look, log) in zip(panels.flat, _with_looks(runs), strict=False):
        position = true_place(log)
        at_rest = not (np.ptp(log["ref_x"]) or np.ptp(log["ref_y"]))
        axes.plot(log["ref_x"], log["ref_y"], marker="o" if at_rest else None, **LOOKS["reference"])
        axes.plot(*thinned(position["x"], position["y"]), label="robot", **LOOKS[look])
        axes.plot(position["x"][:1], position["y"][:1], "o", color=INK, markersize=3.5)
        title = label_of(name).replace(" compensation", "\ncompensation")
        axes.set_title(title + (" (fell)" if log.ended else ""), fontsize=7.5)
        axes.set(xlim=middle[0] + (-half, half), ylim=middle[1] + (-half, half), aspect="equal")
    for axes in panels.flat[len(runs) :]:
        axes.set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("$x$ [m]")
    for axes in panels[:, 0]:
        axes.set_ylabel("$y$ [m]")
    return figure


def position_error_series(
    runs: Mapping[str, Log], caption: str, *, settle: float | None = SETTLE, band: float = BAND
) -> TimeSeries:
    """Return the distance from the reference over time, with the reference below.

    The times from `settle` s after the start and each jump of the reference on are shaded, unless that is None.
    """
    longest = max(runs.values(), key=len)
    t, distances = together(
        [
            (name + (" (fell)" if log.ended else ""), look, log.t - log.t[0], 1e3 * position_error(log))
            for name, look, log in _with_looks(runs)
        ]
    )
    reference = (
        Line("reference x", longest["ref_x"], "measured"),
        Line("reference y", longest["ref_y"], "sixth"),
    )
    return TimeSeries(
        t,
        (
            Panel("distance from the reference [mm]", distances, levels=(1e3 * band,), from_zero=True),
            Panel("reference [m]", reference),
        ),
        caption,
        shaded=() if settle is None else true_spans(t, settled(longest, settle)),
        shade="errors count",
        level=f"{1e3 * band:g} mm: has arrived",
    )


def _overall_sheet(league: League) -> Sheet:
    """Return a row for each controller: its ratios to the first one over all courses, and its falls."""
    totals = {name: overall(league, name) for name in league.controllers}
    rows = [
        (
            name,
            *(_estimate(total.ratios[key]) if total.ratios else "1" for key in RATIOS),
            f"{total.falls} of {total.runs}",
        )
        for name, total in totals.items()
    ]
    caption = (
        f"Each number over {league.controllers[0]}'s on the same course with the same seed: geometric means over the "
        f"courses, with 95 % intervals over the seeds. {league.friction}"
    )
    headings = ("controller", *(METRIC_BY_KEY[key].heading for key in RATIOS), "falls")
    return Sheet(headings, rows, caption)


def course_sheet(league: League) -> Sheet:
    """Return a row for each course: first metric, bound, each controller's mean with its interval, and the falls."""

    def cell(course: Course, metric: Metric, name: str) -> str:
        result = standing(league, course.name, name)
        fell = f", {result.falls} of {result.runs} fell" if result.falls and not course.until_fall else ""
        mean = result.means[metric.key]
        if math.isnan(mean.mean):
            return f"–{fell}"
        ratio = _ratio(league, course, metric, mean.mean)
        return f"{'≥ ' if _is_bound(result, metric) else ''}{_estimate(mean, metric.scale)}{ratio}{fell}"

    rows, bounded = [], any(league.bounds.values())
    for course in league.courses:
        metric = METRIC_BY_KEY[course.metrics[0]] if course.metrics else METRICS[0]
        of = course.name.replace("_", " ")
        cells = [cell(course, metric, name) for name in league.controllers]
        heading = f"{of}: {unit_heading(metric.heading, metric.unit)}"
        rows.append((heading, *([_bound(league, course, metric)] if bounded else []), *cells))
    caption = "One number of each course, the first of its own table below: means with their 95 % intervals."
    if bounded:
        caption += " The bound holds for every controller of this robot; ×: a mean over it."
    return Sheet(("course", *(["bound"] if bounded else []), *league.controllers), rows, caption)


def _bound(league: League, course: Course, metric: Metric) -> str:
    """Return what no controller passes, or nothing."""
    bound = league.bounds.get(course.name, {}).get(metric.key)
    return "" if bound is None else digits(metric.scale * bound)


def _ratio(league: League, course: Course, metric: Metric, mean: float) -> str:
    """Return a mean over the bound, such as ", × 0.62", if there is one."""
    bound = league.bounds.get(course.name, {}).get(metric.key)
    return "" if bound is None else f", × {digits(mean / bound, 2)}"


def metric_rows(league: League, course: Course) -> list[list[str | Cell]]:
    """Return a row for each metric of a course: its name and each controller's mean, below it the difference."""
    standings = [standing(league, course.name, name) for name in league.controllers]
    metrics = [METRIC_BY_KEY[key] for key in course.metrics] or METRICS
    rows: list[list[str | Cell]] = []
    for metric in metrics:
        bound = _bound(league, course, metric)
        heading = unit_heading(metric.heading, metric.unit) + (f", bound {bound}" if bound else "")
        rows.append([heading, *(_cell(each, metric) for each in standings)])
    falls: list[str | Cell] = ["falls", *(f"{each.falls} of {each.runs}" for each in standings)]
    return rows if course.until_fall else [*rows, falls]


def _cell(result: Standing, metric: Metric) -> Cell:
    """Return a mean in the metric's unit, and below it the difference, with a star if it is significant."""
    text = (
        f"{'≥ ' if _is_bound(result, metric) else ''}{digits(metric.scale * result.means[metric.key].mean)}"
    )
    difference = result.differences.get(metric.key)
    if difference is None or math.isnan(difference.mean):
        return Cell(text)
    shown = _estimate(difference, metric.scale, plus="+", beside=result.means[metric.key].mean)
    star = " *" if difference.sign and not shown.startswith("0") else ""
    return Cell(text, f"{shown}{star}")


def _is_bound(result: Standing, metric: Metric) -> bool:
    """Return whether a time is only a lower bound: at its end some run had not arrived, or was not at rest."""
    completed = {"settling_time": result.arrived, "stopping_time": result.rested}
    return completed.get(metric.key, result.runs) < result.runs - result.falls


def _estimate(estimate: Estimate, scale: float = 1.0, *, plus: str = "", beside: float = 0.0) -> str:
    """Return a mean with its interval, such as "−120 (−130 to −110)"; with too few seeds, the mean alone.

    The rounding error in a difference of equal numbers, which are near `beside`, is shown as 0.
    """

    def shown(value: float) -> str:
        text = digits(scale * value, beside=1e-6 * scale * beside)
        return f"{plus if value > 0.0 and text != '0' else ''}{text}".replace("-", "−")

    mean = shown(estimate.mean)
    return mean if math.isnan(estimate.low) else f"{mean} ({interval(estimate.low, estimate.high, shown)})"


def course_tracks(league: League, course: Course) -> dict[str, Log]:
    """Return each controller's run of a course with the first seed."""
    return {name: league.tracks[course.name, name] for name in league.controllers}


def league_report(league: League) -> Result:
    """Return the page of a league."""
    plant = "the compiled loop" if league.courses[0].on == "model" else "the twin"
    courses, seeds = counted(len(league.courses), "course"), counted(len(league.seeds), "seed")
    return Result(
        title=f"{league.robot}: {counted(len(league.controllers), 'controller')} side by side",
        lead=f"{courses} on {plant}, {seeds}, the same for all.",
        verdict=[("", _verdict(league)), ("", league.friction)],
        sections=[
            section("Over all courses", _overall_sheet(league), course_sheet(league)),
            *(_course_section(league, course, index) for index, course in enumerate(league.courses)),
        ],
        undecided=[
            "How the controllers compare on a real robot: these are simulated runs of the robot as described."
        ],
        data=league.to_dict(),
    )


def _course_section(league: League, course: Course, index: int) -> Section:
    caption = (
        f"Means over the runs that did not fall. Below them, how much more or less than {league.controllers[0]}'s, "
        "seed by seed, with its 95 % interval; a star marks an interval that excludes zero."
    )
    until = ", or until the robot falls" if course.until_fall else ""
    first, count = league.seeds[0], len(league.seeds)
    shown = f"seed {first}" if count == 1 else f"seed {first}, the first of {count}"
    floor = f"The path over the floor of one run of each controller, {shown}. Broad: the reference."
    pushes = ", ".join(f"{push.time:g} s" for push in course.scenario.pushes)
    over_time = f"The same runs over time.{f' Pushed at {pushes}.' if pushes else ''}"
    tracks = course_tracks(league, course)
    results = section(
        course.name.replace("_", " ").capitalize(),
        Paragraph(f"{course.about} A run lasts {course.duration:g} s{until}."),
        Bullets([f"Published: {fact}" for fact in course.published]),
        Sheet(("", *league.controllers), metric_rows(league, course), caption),
        drawn_picture(f"course-{index}", floor, paths_figure, tracks),
        position_error_series(tracks, over_time, settle=None, band=course.rules.band),
    )
    return replace(results, folded=index > 0)


def _verdict(league: League) -> str:
    """Return which controller is the most accurate of those that never fell, and by how much."""
    if all(course.until_fall for course in league.courses):
        return "Each course gets harder until the robot falls; the tables have how far each controller gets."
    totals = {name: overall(league, name) for name in league.controllers}
    first, runs = league.controllers[0], counted(totals[league.controllers[0]].runs, "run")
    falls = [f"{name} in {total.falls}" for name, total in totals.items() if total.falls]
    fell = f"Falls in {runs} each: {', '.join(falls)}." if falls else f"No fall in {runs} each."
    peaks = {
        name: total.ratios["peak_position_error"]
        for name, total in totals.items()
        if total.ratios and not total.falls and not math.isnan(total.ratios["peak_position_error"].mean)
    }
    best = min(peaks, key=lambda name: peaks[name].mean, default=first)
    if best == first or peaks[best].mean >= 1.0:
        return f"No controller that never fell has a smaller peak error than {first}. {fell}"
    equal = [name for name, peak in peaks.items() if name != best and peak.low <= peaks[best].high]
    if peaks[best].high >= 1.0:
        equal.append(first)
    others = f" Not significantly less accurate: {every(equal)}." if equal else ""
    return f"{capital(best)} is the most accurate: peak error {_estimate(peaks[best])} times {first}'s.{others} {fell}"


def alternation_report(
    alternation: Alternation,
    logs: Sequence[Log],
    *,
    controllers: tuple[str, str],  # files of the controllers before and after
    about: str,
    origin: Mapping[str, object],  # the provenance with the robot's
) -> Result:
    """Return the page of two controllers in turn."""
    runs = [f"{k} {'after' if k % 2 == 0 else 'before'}" for k in range(1, len(logs) + 1)]
    verdicts = [
        f"Run {2 * k} against the prediction: {verdict.recommendation}. {verdict.reason}"
        for k, verdict in enumerate(alternation.verdicts, start=1)
    ]
    open_names = [
        name.replace("_", " ") for name, gain in alternation.gains.items() if gain.verdict == "undecided"
    ]
    alike = (
        f"Whether {', '.join(open_names)} differ: their intervals contain 1. More --rounds make them narrow."
    )
    named = {f"run {name}": log for name, log in zip(runs, logs, strict=True)}
    over_time = position_error_series(named, "The runs one over another, from their starts.")
    return Result(
        title="Two controllers in turn on a live robot",
        lead=f"{about} Before: {controllers[0]}. After: {controllers[1]}.",
        verdict=[("", _conclusion(alternation))],
        sections=[
            section("Compared", *_gains_and_runs(alternation, runs), Bullets(verdicts)),
            section("Over time", over_time),
        ],
        undecided=[
            alike if open_names else "",
            "Where the robot truly was: the errors are those of its own position, which drifts.",
        ],
        data={
            "recommendation": alternation.recommendation,
            "conclusion": _conclusion(alternation),
            "runs": alternation.performances,
            "gains": alternation.gains,
            "verdicts": [
                {
                    "recommendation": verdict.recommendation,
                    "reason": verdict.reason,
                    "outside": [
                        quantity.name for quantity in verdict.quantities if quantity.place != "inside"
                    ],
                }
                for verdict in alternation.verdicts
            ],
            "controllers": dict(zip(("before", "after"), controllers, strict=True)),
            "provenance": origin,
        },
    )


def _gains_and_runs(alternation: Alternation, runs: Sequence[str]) -> tuple[Sheet, Sheet]:
    names = {name: quantity.words for name, quantity in SHOWN.items()} | {"torque_margin": "torque used"}
    gains = sheet_of(
        alternation.gains.items(),
        [
            Column("quantity", lambda row: names[row[0]]),
            Column("factor", lambda row: f"{row[1].factor:.2f}"),
            Column("95 % interval", lambda row: f"{row[1].low:.2f} to {row[1].high:.2f}"),
            Column("", lambda row: row[1].verdict),
            Column("drift from run to run", lambda row: f"{round(100.0 * (row[1].drift - 1.0)):+d} %"),
        ],
        caption="After over before, the drift removed.",
    )
    performances = [
        (
            unit_heading(shown.words, shown.unit),
            *(shown.shown(getattr(performance, name)) for performance in alternation.performances),
        )
        for name, shown in SHOWN.items()
    ]
    return gains, Sheet(("quantity", *runs), performances, "Runs in turn.")


def _conclusion(alternation: Alternation) -> str:
    """Return the result of runs in turn in one or two sentences."""
    advice = f"{alternation.recommendation.capitalize()} the controller by the study's prediction."
    gain = alternation.gains.get("peak_error")
    if gain is None:
        return f"{advice} A run ended before it settled, so that the errors are not compared."
    size = f"The peak error is {gain.factor:.2f} times as large ({gain.low:.2f} to {gain.high:.2f})"
    if gain.verdict == "undecided":
        return f"{advice} {size}, which decides nothing; repeat the comparison with more --rounds."
    return f"{advice} {size}."
