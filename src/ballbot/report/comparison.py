"""Comparisons of controllers: runs side by side, and the league.

Of a league: tables, an overview with intervals, and each course as it was run with the first seed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.log import Log
from ballbot.report.blocks import Cell, Paragraph, Report, Section, Sheet, section
from ballbot.report.palette import BLUE, GREEN, INK, MUTED, ORANGE, SHADE, VIOLET, YELLOW
from ballbot.report.provenance import Provenance
from ballbot.report.series import Line, Look, Panel, TimeSeries, together, true_spans
from ballbot.report.style import REFERENCE, LineStyle, drawn_picture, label_of, plain_log_ticks, thinned
from ballbot.report.words import ratio_digits
from ballbot.rounding import unit_heading
from ballbot.summary import counted
from ballbot.workflows.comparison import Estimate
from ballbot.workflows.courses import Course
from ballbot.workflows.league import (
    METRIC_BY_KEY,
    METRICS,
    RATIOS,
    League,
    Overall,
    Standing,
    overall,
    standing,
)
from ballbot.workflows.metrics import BAND, SETTLE, Metric, position_error, settled, true_place

RUN_LINES: Mapping[str, LineStyle] = {
    "none": {"color": ORANGE, "linestyle": "--", "linewidth": 1.2},
    "full": {"color": MUTED, "linestyle": ":", "linewidth": 1.4},
    "partial": {"color": GREEN, "linestyle": "-.", "linewidth": 1.3},
    "precise": {"color": BLUE, "linestyle": "-", "linewidth": 1.2},
    "precise_without_compensation": {"color": VIOLET, "linestyle": "-", "linewidth": 1.2},
}
RUN_LABELS: Mapping[str, str] = {
    "none": "no compensation",
    "full": "full compensation",
    "partial": "partial compensation",
    "precise": "precise",
    "precise_without_compensation": "precise, none",
}


def paths_figure(runs: Mapping[str, Log]) -> Figure:
    """Return each controller's path over the floor beside the reference."""
    figure = Figure(figsize=(7.4, 2.8), layout="constrained")
    panels = figure.subplots(1, len(runs), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (name, log) in zip(panels, runs.items(), strict=True):
        place = true_place(log)
        axes.plot(log["ref_x"], log["ref_y"], label="reference", **REFERENCE)
        x, y = thinned(place["x"], place["y"])
        axes.plot(x, y, label="robot", **RUN_LINES[name])
        axes.plot(place["x"][:1], place["y"][:1], marker="o", color=INK, markersize=3.5, linestyle="none")
        axes.set_title(RUN_LABELS[name] + (" (fell)" if log.ended else ""))
        axes.set_aspect("equal")
        axes.set_xlabel("$x$ [m]")
    panels[0].set_ylabel("$y$ [m]")
    return figure


#: the same candidates over time
_RUN_LOOKS: Mapping[str, Look] = {
    "none": "second",
    "full": "fourth",
    "partial": "third",
    "precise": "first",
    "precise_without_compensation": "fifth",
}


def position_error_series(runs: Mapping[str, Log], caption: str) -> TimeSeries:
    """Return the distance from the reference over time, with the reference below."""
    longest = max(runs.values(), key=len)
    t, errors = together([(log.t, 1e3 * position_error(log)) for log in runs.values()])
    lines = [
        Line(name=RUN_LABELS[name], values=values, look=_RUN_LOOKS[name])
        for name, values in zip(runs, errors, strict=True)
    ]
    reference = (
        Line(name="reference x", values=longest["ref_x"], look="measured"),
        Line(name="reference y", values=longest["ref_y"], look="sixth"),
    )
    return TimeSeries(
        t=t,
        panels=(
            Panel(label="distance from the reference [mm]", lines=lines, from_zero=True),
            Panel(label="reference [m]", lines=reference),
        ),
        caption=caption,
        shaded=true_spans(longest.t, settled(longest, SETTLE)),
        shade="errors count",
    )


OVERALL_HEADINGS = ("controller", *(METRIC_BY_KEY[key].heading for key in RATIOS), "falls")


def overall_rows(league: League) -> list[list[str]]:
    """Return a row for each controller: its ratios to the first one over all courses, and its falls."""
    rows = []
    for name in league.controllers:
        found = overall(league, name)
        ratios = [_ratio(found.ratios[key]) if found.ratios else "1" for key in RATIOS]
        rows.append([name, *ratios, f"{found.falls} of {found.runs}"])
    return rows


def metric_rows(league: League, course: str) -> list[list[str | Cell]]:
    """Return a row for each metric on a course: its name and each controller's mean, below it the difference."""
    found = [standing(league, course, name) for name in league.controllers]
    rows: list[list[str | Cell]] = [
        [unit_heading(one.heading, one.unit), *(_cell(each, one) for each in found)]
        for one in _with_decimals(found)
    ]
    return [*rows, ["falls", *(_falls(each) for each in found)]]


def _with_decimals(found: Sequence[Standing]) -> list[Metric]:
    """Return the metrics with up to two more decimals, so that small means are not written as zero."""
    metrics = []
    for metric in METRICS:
        means = [metric.scale * one.means[metric.key].mean for one in found]
        needed = (-math.floor(math.log10(mean)) for mean in means if 0.0 < mean < math.inf)
        most = metric.decimals + 2
        decimals = max([metric.decimals, *(one for one in needed if one <= most)])
        metrics.append(replace(metric, decimals=decimals))
    return metrics


def _cell(found: Standing, metric: Metric) -> Cell:
    difference = found.differences.get(metric.key)
    if difference is None or math.isnan(difference.mean):
        return Cell(text=_mean(found, metric))
    below = _difference(difference, metric)
    return Cell(text=_mean(found, metric), below=f"{below}{' *' if difference.sign else ''}")


def _mean(found: Standing, metric: Metric) -> str:
    """Return a mean in the metric's unit; a settling time with >= where some run had not arrived at its end."""
    mean = found.means[metric.key].mean
    if math.isnan(mean):
        return "–"
    late = metric.key == "settling_time" and found.arrived < found.runs - found.falls
    return f"{'≥ ' if late else ''}{metric.scale * mean:.{metric.decimals}f}"


def _difference(difference: Estimate, metric: Metric) -> str:
    """Return a difference and its interval in the metric's unit, such as "−120 (−130, −110)"."""
    mean, low, high = (
        _signed(metric.scale * value, metric.decimals)
        for value in (difference.mean, difference.low, difference.high)
    )
    return mean if math.isnan(difference.low) else f"{mean} ({low}, {high})"


def _ratio(found: Estimate) -> str:
    interval = "" if math.isnan(found.low) else f" ({ratio_digits(found.low)}, {ratio_digits(found.high)})"
    return f"{ratio_digits(found.mean)}{interval}"


def _falls(found: Standing) -> str:
    return f"{found.falls} of {found.runs}"


def _signed(value: float, decimals: int) -> str:
    text = f"{value:+.{decimals}f}".replace("-", "−")
    return text if float(f"{value:.{decimals}f}") else text[1:]


#: distinguished by dash and weight as well as by colour; of the first three as in the study's report
_COLORS = (ORANGE, BLUE, GREEN, VIOLET, INK, YELLOW)
#: the same in time series
_TRACK_LOOKS: tuple[Look, ...] = ("second", "first", "third", "fourth", "sixth", "fifth")
_DASHES = ("--", "-", "-.", ":")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")

#: an interval that reaches zero has no end on a logarithmic scale: its bar is cut at this share of the mean
_SHORTEST = 0.25
#: what the overview shows
_SHOWN_METRICS = ("peak_position_error", "high_frequency_torque")


def overview_figure(league: League) -> Figure:
    """Draw peak position error and rough torque of each controller on each course, with 95 % intervals."""
    rows = len(league.courses)
    height = 0.7 + rows * (0.16 + 0.1 * len(league.controllers)) + 0.17 * -(-len(league.controllers) // 2)
    figure = Figure(figsize=(7.4, height), layout="constrained")
    panels = figure.subplots(1, len(_SHOWN_METRICS), sharey=True, squeeze=False)[0]
    for axes, key in zip(panels, _SHOWN_METRICS, strict=True):
        metric = METRIC_BY_KEY[key]
        for place in range(1, rows, 2):
            axes.axhspan(place - 0.5, place + 0.5, color=SHADE, linewidth=0)
        for index in range(len(league.controllers)):
            _draw_controller(axes, league, index, metric)
        axes.set_xscale("log")
        plain_log_ticks(axes.xaxis)
        axes.set_xlabel(unit_heading(metric.words, metric.unit))
        axes.grid(visible=False, axis="y")
    panels[0].set_yticks(range(rows), [label_of(course.name.replace("_", " ")) for course in league.courses])
    panels[0].set_ylim(rows - 0.5, -0.5)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def course_figure(league: League, course: Course) -> Figure:
    """Draw each controller's path over the floor, of one run each, with the first seed."""
    figure = Figure(figsize=(5.2, 3.4), layout="constrained")
    floor = figure.subplots()
    asked = _asked(course, np.arange(0.0, course.duration, 0.1))
    floor.plot(asked[:, 0], asked[:, 1], marker="o" if np.ptp(asked) == 0.0 else None, **REFERENCE)
    for index, name in enumerate(league.controllers):
        track = league.tracks[course.name, name]
        label = label_of(name) + (" (fell)" if track.ended else "")
        floor.plot(track.x, track.y, label=label, **line_of(index))
    floor.set_aspect("equal", adjustable="datalim")
    floor.set(xlabel="$x$ [m]", ylabel="$y$ [m]")
    figure.legend(*floor.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def course_series(league: League, course: Course) -> TimeSeries:
    """Return each controller's distance from the reference over time, of the same runs."""
    runs, names = [], []
    for name in league.controllers:
        track = league.tracks[course.name, name]
        wanted = _asked(course, track.t)
        runs.append((track.t, 1e3 * np.hypot(track.x - wanted[:, 0], track.y - wanted[:, 1])))
        names.append(name + (" (fell)" if track.ended else ""))
    t, distances = together(runs)
    lines = [
        Line(name=name, values=values, look=_TRACK_LOOKS[place % len(_TRACK_LOOKS)])
        for place, (name, values) in enumerate(zip(names, distances, strict=True))
    ]
    pushes = ", ".join(f"{time:g} s" for time in course.disturbed)
    return TimeSeries(
        t=t,
        panels=(
            Panel(
                label="distance from the reference [mm]", lines=lines, levels=(1e3 * BAND,), from_zero=True
            ),
        ),
        caption=f"The same runs over time.{f' Pushed at {pushes}.' if pushes else ''}",
        level=f"{1e3 * BAND:g} mm: has arrived",
    )


def seed_shown(league: League) -> str:
    """Return which seed the courses are drawn with, in words."""
    first, count = league.seeds[0], len(league.seeds)
    return f"seed {first}" if count == 1 else f"seed {first}, the first of {count}"


def line_of(index: int) -> LineStyle:
    """Return how the controller of that place is drawn."""
    again, kind = divmod(index, len(_DASHES))
    return {
        "color": _COLORS[index % len(_COLORS)],
        "linestyle": _DASHES[kind],
        "linewidth": 1.2 + 0.7 * again,
    }


def _draw_controller(axes: Axes, league: League, index: int, metric: Metric) -> None:
    """Draw one controller's means with their intervals."""
    name, count = league.controllers[index], len(league.controllers)
    color, marker = _COLORS[index % len(_COLORS)], _MARKERS[index % len(_MARKERS)]
    for row, course in enumerate(league.courses):
        found = standing(league, course.name, name)
        one = found.means[metric.key]
        place = row + 0.7 * ((index + 0.5) / count - 0.5)
        if np.isfinite(one.low):
            ends = metric.scale * np.array([max(one.low, _SHORTEST * one.mean), one.high])
            axes.plot(ends, [place, place], color=color, linewidth=1.4)
        label = label_of(name) if row == 0 else None
        mark = {"marker": marker, "color": color, "markersize": 4, "linestyle": "", "label": label}
        axes.plot(metric.scale * one.mean, place, **mark)
        if found.falls and metric.key == _SHOWN_METRICS[0]:
            _mark_falls(axes, found, metric, place)


def _mark_falls(axes: Axes, found: Standing, metric: Metric, place: float) -> None:
    """Write beside a mark how many runs fell, with the controller's name where there is no mark."""
    one = found.means[metric.key]
    words = f"{found.falls} of {found.runs} fell"
    if one.runs:
        at, transform = metric.scale * (one.high if np.isfinite(one.high) else one.mean), axes.transData
    else:
        at, transform = 0.01, axes.get_yaxis_transform()
        words = f"{label_of(found.controller)}: {words}"
    axes.text(at, place, f" {words}", va="center", color=INK, fontsize=7, transform=transform)


def _asked(course: Course, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the robot is asked to be (N, 2) at times (N,)."""
    reference = course.reference_spec.reference()
    return np.array([reference(float(moment))[:2] for moment in t]).reshape(-1, 2)


_PEAK, _ROUGH = "peak_position_error", "high_frequency_torque"


def league_report(league: League, made: Provenance) -> Report:
    """Return the page of a league."""
    plant = "the compiled loop" if league.courses[0].on == "model" else "the twin"
    first, courses = league.controllers[0], counted(len(league.courses), "course")
    caption = (
        f"Each number over {first}'s on the same course with the same seed: geometric means over the courses, with "
        "95 % intervals over the seeds."
    )
    overview = (
        "Means over the seeds with their 95 % intervals, on logarithmic scales; a bar ends at a quarter of its mean "
        "at the least."
    )
    undecided = [_open_sentence(name, league) for name in league.controllers[1:]]
    return Report(
        title=f"{league.robot}: {counted(len(league.controllers), 'controller')} side by side",
        lead=f"{courses} on {plant}, {counted(len(league.seeds), 'seed')}, the same for all.",
        verdict=[(name, _sentence(overall(league, name), league)) for name in league.controllers],
        sections=[
            section(
                "Over all courses",
                Sheet(headings=OVERALL_HEADINGS, rows=overall_rows(league), caption=caption),
                drawn_picture("overview", partial(overview_figure, league), overview),
            ),
            *(_course_section(league, course, place) for place, course in enumerate(league.courses)),
        ],
        undecided=[*(words for words in undecided if words), _BEYOND],
        made=made,
    )


def _course_section(league: League, course: Course, place: int) -> Section:
    first = league.controllers[0]
    caption = (
        f"Means over the runs that did not fall. Below them, how much more or less than {first}'s, seed by seed, "
        "with its 95 % interval; a star where the interval leaves zero out."
    )
    floor = (
        f"The path over the floor of one run of each controller, {seed_shown(league)}. Broad: the reference."
    )
    return section(
        _title(course.name),
        Paragraph(text=f"{course.about} A run lasts {course.duration:g} s."),
        Sheet(headings=("", *league.controllers), rows=metric_rows(league, course.name), caption=caption),
        drawn_picture(f"course-{place}", partial(course_figure, league, course), floor),
        course_series(league, course),
    )


def _open_sentence(name: str, league: League) -> str:
    """Return in which of the ratios a controller may equal the first; empty if in none."""
    ratios = overall(league, name).ratios
    open_ones = [
        METRIC_BY_KEY[key].words
        for key, one in ratios.items()
        if math.isnan(one.low) or one.low <= 1.0 <= one.high
    ]
    if not open_ones:
        return ""
    return f"Whether {name} differs from {league.controllers[0]} in {', '.join(open_ones)}: no interval leaves one out."


_BEYOND = "How the controllers compare on a real robot: these are simulated runs of the robot as its file describes it."


def _title(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _sentence(found: Overall, league: League) -> str:
    """Return a controller over all courses in a sentence or two."""
    falls = (
        f"No fall in {counted(found.runs, 'run')}: the probability of a "
        f"fall is below {100 * found.fall_interval[1]:.2g} %."
        if not found.falls
        else f"{found.falls} of {found.runs} runs ended in a fall."
    )
    if not found.ratios:
        return f"The reference for the others. {falls}"
    known = [key for key in (_PEAK, _ROUGH) if not math.isnan(found.ratios[key].mean)]
    if not known:
        return falls
    words = ", ".join(_ratio_phrase(key, found.ratios[key], of=league.controllers[0]) for key in known)
    return f"{words[0].upper()}{words[1:]}. {falls}"


def _ratio_phrase(key: str, ratio: Estimate, *, of: str) -> str:
    interval = "" if math.isnan(ratio.low) else f" ({ratio_digits(ratio.low)} to {ratio_digits(ratio.high)})"
    return f"{METRIC_BY_KEY[key].words} {ratio_digits(ratio.mean)} times that of {of}{interval}"
