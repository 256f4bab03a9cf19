"""The page of a league, as HTML."""

from __future__ import annotations

import math
from functools import partial

from ballbot.experiments.league.play import League
from ballbot.experiments.league.standings import METRIC_BY_KEY, Overall, overall
from ballbot.experiments.league.statistics import Estimate
from ballbot.experiments.metrics import BAND, SETTLE
from ballbot.report.league_figures import course_figure, overview_figure, seed_shown
from ballbot.report.league_tables import (
    OVERALL_HEADINGS,
    metric_rows,
    overall_rows,
)
from ballbot.report.page import figure_markup, render
from ballbot.report.provenance import Provenance
from ballbot.report.style import drawn
from ballbot.report.tables import digits

_PEAK, _ROUGH = "peak_position_error", "high_frequency_torque"


def league_report(league: League, made: Provenance) -> str:
    """Return the page."""
    courses = [
        {
            "name": course.name,
            "title": _title(course.name),
            "about": course.about,
            "seconds": f"{course.duration:g}",
            "rows": metric_rows(league, course.name),
            "figure": figure_markup(drawn(partial(course_figure, league, course), name=f"course-{place}")),
            "pushed": bool(course.disturbed),
        }
        for place, course in enumerate(league.courses)
    ]
    plant = "the exact model with perfect sensors" if league.courses[0].scenario is None else "the twin"
    values: dict[str, object] = {
        "title": f"{league.robot}: {len(league.controllers)} controllers side by side",
        "lead": f"{len(league.courses)} courses on {plant}, {len(league.seeds)} seeds, the same for all.",
        "summary": [(name, _sentence(overall(league, name), league)) for name in league.controllers],
        "first": league.controllers[0],
        "overall_headings": OVERALL_HEADINGS,
        "overall_rows": overall_rows(league),
        "overview_figure": figure_markup(drawn(partial(overview_figure, league), name="overview")),
        "controllers": league.controllers,
        "courses": courses,
        "seed": seed_shown(league),
        "band": f"{1e3 * BAND:g}",
        "settle": f"{SETTLE:g}",
        "made": made,
    }
    return render("league", values)


def _title(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _sentence(found: Overall, league: League) -> str:
    """Return a controller over all courses in a sentence or two."""
    falls = (
        f"No fall in {found.runs} runs: the probability of a "
        f"fall is below {100 * found.fall_interval[1]:.2g} %."
        if not found.falls
        else f"{found.falls} of {found.runs} runs ended in a fall."
    )
    if not found.ratios:
        return f"The reference for the others. {falls}"
    known = [key for key in (_PEAK, _ROUGH) if not math.isnan(found.ratios[key].mean)]
    if not known:
        return falls
    words = ", ".join(_ratio_words(key, found.ratios[key], of=league.controllers[0]) for key in known)
    return f"{words[0].upper()}{words[1:]}. {falls}"


def _ratio_words(key: str, ratio: Estimate, *, of: str) -> str:
    interval = "" if math.isnan(ratio.low) else f" ({digits(ratio.low)} to {digits(ratio.high)})"
    return f"{METRIC_BY_KEY[key].words} {digits(ratio.mean)} times that of {of}{interval}"
