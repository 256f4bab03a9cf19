"""The league's tables as texts, for the page and for the terminal."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballbot.experiments.league.play import League
from ballbot.experiments.league.standings import (
    METRIC_BY_KEY,
    METRICS,
    RATIOS,
    Metric,
    Standing,
    overall,
    standing,
)
from ballbot.experiments.league.statistics import Estimate
from ballbot.report.tables import digits

OVERALL_HEADINGS = ("controller", *(METRIC_BY_KEY[key].heading for key in RATIOS), "falls")
STANDING_HEADINGS = ("controller", *(f"{one.heading} ({one.unit})" for one in METRICS), "falls")


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A controller's mean, and how it differs from the first one's."""

    mean: str
    difference: str = ""  #: with its interval
    shown: bool = False  #: the interval leaves zero out


def overall_rows(league: League) -> list[list[str]]:
    """Return a row for each controller: its ratios to the first one over all courses, and its falls."""
    rows = []
    for name in league.controllers:
        found = overall(league, name)
        ratios = [_ratio(found.ratios[key]) if found.ratios else "1" for key in RATIOS]
        rows.append([name, *ratios, f"{found.falls} of {found.runs}"])
    return rows


def standing_rows(league: League, course: str) -> list[list[str]]:
    """Return a row for each controller on a course: means over the runs that stood, and falls."""
    rows = []
    for name in league.controllers:
        found = standing(league, course, name)
        rows.append([name, *(_mean(found, metric) for metric in METRICS), _falls(found)])
    return rows


def metric_rows(league: League, course: str) -> list[tuple[str, list[Cell]]]:
    """Return a row for each metric on a course, its name and a cell for each controller; falls come last."""
    found = [standing(league, course, name) for name in league.controllers]
    rows = [(f"{one.heading} ({one.unit})", [_cell(each, one) for each in found]) for one in METRICS]
    return [*rows, ("falls", [Cell(mean=_falls(each)) for each in found])]


def _cell(found: Standing, metric: Metric) -> Cell:
    difference = found.differences.get(metric.key)
    if difference is None or math.isnan(difference.mean):
        return Cell(mean=_mean(found, metric))
    return Cell(
        mean=_mean(found, metric), difference=_difference(difference, metric), shown=difference.sign != 0
    )


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
    if math.isnan(found.mean):
        return "–"
    mean, low, high = digits(found.mean), digits(found.low), digits(found.high)
    return mean if math.isnan(found.low) else f"{mean} ({low}, {high})"


def _falls(found: Standing) -> str:
    return f"{found.falls} of {found.runs}"


def _signed(value: float, decimals: int) -> str:
    text = f"{value:+.{decimals}f}".replace("-", "−")
    return text if float(f"{value:.{decimals}f}") else text[1:]
