"""The league's figures: an overview with intervals, and each course as it was run with the first seed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from ballbot.experiments.league.course import Course
from ballbot.experiments.league.play import League
from ballbot.experiments.league.standings import METRIC_BY_KEY, Metric, Standing, standing
from ballbot.experiments.metrics import BAND
from ballbot.report.style import BLUE, GREEN, INK, MUTED, ORANGE, REFERENCE, Line, label_of

#: told apart by dash and weight as well as by colour; of the first three as in the study's report
_COLORS = (ORANGE, BLUE, GREEN, INK, "#8a4f7d", MUTED)
_DASHES = ("--", "-", "-.", ":")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")

#: an interval that reaches zero has no end on a logarithmic scale: its bar is cut at this share of the mean
_SHORTEST = 0.25
#: what the overview shows
_SHOWN = ("peak_position_error", "high_frequency_torque")


def overview_figure(league: League) -> Figure:
    """Draw peak position error and rough torque of each controller on each course, with 95 % intervals."""
    rows = len(league.courses)
    height = 0.9 + rows * (0.16 + 0.1 * len(league.controllers))
    figure = Figure(figsize=(7.4, height), layout="constrained")
    panels = figure.subplots(1, len(_SHOWN), sharey=True, squeeze=False)[0]
    for axes, key in zip(panels, _SHOWN, strict=True):
        metric = METRIC_BY_KEY[key]
        for place in range(1, rows, 2):
            axes.axhspan(place - 0.5, place + 0.5, color="#f4f6f8", linewidth=0)
        for index in range(len(league.controllers)):
            _draw_controller(axes, league, index, metric)
        axes.set_xscale("log")
        _plain_ticks(axes)
        axes.set_xlabel(f"{metric.words} [{metric.unit}]")
        axes.grid(visible=False, axis="y")
    panels[0].set_yticks(range(rows), [label_of(course.name.replace("_", " ")) for course in league.courses])
    panels[0].set_ylim(rows - 0.5, -0.5)
    figure.legend(
        *panels[0].get_legend_handles_labels(),
        loc="outside upper center",
        ncols=min(6, len(league.controllers)),
    )
    return figure


def course_figure(league: League, course: Course) -> Figure:
    """Draw each controller's path over the floor and its distance from the reference over time, of one run each.

    Of the first seed's, which the title says.
    """
    figure = Figure(figsize=(7.4, 2.9), layout="constrained")
    floor, errors = figure.subplots(1, 2, width_ratios=(2, 3))
    t = np.arange(0.0, course.duration, 0.1)
    asked = _asked(course, t)
    floor.plot(asked[:, 0], asked[:, 1], marker="o" if np.ptp(asked) == 0.0 else None, **REFERENCE)
    for index, name in enumerate(league.controllers):
        track = league.tracks[course.name, name]
        line, wanted = line_of(index), _asked(course, track.t)
        label = label_of(name) + (" (fell)" if track.ended else "")
        floor.plot(track.x, track.y, **line)
        distance = np.hypot(track.x - wanted[:, 0], track.y - wanted[:, 1])
        errors.plot(track.t, 1e3 * distance, label=label, **line)
        if track.ended:
            errors.plot(track.t[-1:], 1e3 * distance[-1:], marker="x", color=line["color"], markersize=6)
    errors.axhline(1e3 * BAND, color=MUTED, linewidth=0.8)
    for time in course.disturbed:
        errors.axvline(time, color=MUTED, linewidth=0.8)
    floor.set_aspect("equal", adjustable="datalim")
    floor.set(xlabel="$x$ [m]", ylabel="$y$ [m]", title=seed_shown(league))
    errors.set(xlabel="time [s]", ylabel="distance from the\nreference [mm]")
    errors.set_ylim(bottom=0.0)
    errors.margins(x=0.01)
    figure.legend(
        *errors.get_legend_handles_labels(), loc="outside upper center", ncols=min(6, len(league.controllers))
    )
    return figure


def seed_shown(league: League) -> str:
    """Return which seed the courses are drawn with, in words."""
    first, count = league.seeds[0], len(league.seeds)
    return f"seed {first}" if count == 1 else f"seed {first}, the first of {count}"


def line_of(index: int) -> Line:
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
        if found.falls and metric.key == _SHOWN[0]:
            _tell_falls(axes, found, metric, place)


def _tell_falls(axes: Axes, found: Standing, metric: Metric, place: float) -> None:
    """Write beside a mark how many runs fell, with the controller's name where there is no mark."""
    one = found.means[metric.key]
    words = f"{found.falls} of {found.runs} fell"
    if one.runs:
        at, transform = metric.scale * (one.high if np.isfinite(one.high) else one.mean), axes.transData
    else:
        at, transform = 0.01, axes.get_yaxis_transform()
        words = f"{label_of(found.controller)}: {words}"
    axes.text(at, place, f" {words}", va="center", color=INK, fontsize=7, transform=transform)


def _plain_ticks(axes: Axes) -> None:
    """Label a logarithmic axis 1, 2, 5, 10 where it has less than two decades, else by its decades."""
    low, high = axes.get_xlim()
    narrow = high < 100.0 * low
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _asked(course: Course, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the robot is asked to be (N, 2) at times (N,)."""
    reference = course.asked.reference()
    return np.array([reference(float(moment))[:2] for moment in t]).reshape(-1, 2)
