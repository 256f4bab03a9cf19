"""An axis's identification: figures of its friction, closed-loop force and open-loop position, and its page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import RenderableType
from rich.text import Text

from ballbot.findings import Finding, texts
from ballbot.identification.axis import AxisIdentification, AxisRecord
from ballbot.identification.axis.identify import Estimate
from ballbot.identification.axis.model import parameter_named, unit_for
from ballbot.identification.axis.motion import default_bandwidth, smoothed_motion, speed_at_start
from ballbot.report.blocks import Bullets, Paragraph, Report, Section, Sheet, section, table
from ballbot.report.palette import BLUE, GREEN, INK, MUTED, ORANGE
from ballbot.report.provenance import Provenance
from ballbot.report.series import Line, Look, Panel, TimeSeries
from ballbot.report.style import drawn_picture
from ballbot.report.words import with_error
from ballbot.rounding import digits, unit_heading

#: a point of the friction figure is drawn only where the axis moves faster than this share of its fastest
_SLOW = 0.02
#: points of the friction figure, about
_MOST_POINTS = 3000
#: findings that stand in the verdict; the others stand with the parameters
_IN_VERDICT = 2
#: how a row of the verdict is headed, by the finding's code
_VERDICT_WORDS = {
    "outliers": "Outliers",
    "force-delay": "Delay",
    "law": "Law",
    "axis-residuals": "Residual",
}
#: parameters of a law that are no friction
_OTHERS = ("mass", "offset")
#: what the forces over position and load are
_TERMS = {
    "spring": "proportional to position",
    "gravity": "gravity",
    "load": "dry friction that grows with the load",
}
#: the least gain that the figure of the laws shows [%]
_LEAST_GAIN = -100.0


def axis_friction_figure(found: AxisIdentification, record: AxisRecord) -> Figure:
    """Return the friction over speed: the force less all other forces, and the laws found."""
    motion = smoothed_motion(record, bandwidth=default_bandwidth(record))
    others = found.inverse.axis().other_forces(
        record.force, motion.position, motion.speed, motion.acceleration
    )
    friction = record.force - others
    fastest = float(np.abs(motion.speed).max())
    moving = np.flatnonzero(np.abs(motion.speed) > _SLOW * fastest)
    moving = moving[:: max(1, len(moving) // _MOST_POINTS)]
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    axes = figure.subplots()
    axes.plot(
        motion.speed[moving], friction[moving], ".", color=MUTED, markersize=1.6, alpha=0.5, label="record"
    )
    for estimate, color, dash, _ in _drawn_laws(found):
        _draw_law(estimate, fastest, color, dash, axes)
    middle = float(np.quantile(np.abs(friction[moving]), 0.99))
    axes.set_ylim(-1.3 * middle, 1.3 * middle)
    axes.set_xlabel(unit_heading("speed", f"{found.unit}/s"))
    axes.set_ylabel(unit_heading("friction", record.force_unit))
    axes.legend(loc="upper left", markerscale=5.0)
    return figure


def _drawn_laws(found: AxisIdentification) -> list[tuple[Estimate, str, str, Look]]:
    """Return the estimates that are drawn, each with its color and dash, and with the same look in time series."""
    drawn: list[tuple[Estimate, str, str, Look]] = [
        (found.inverse, ORANGE, "--", "second"),
        (found.best, BLUE, "-", "first"),
    ]
    if found.chosen.symmetric:
        drawn.append((found.by_law["asymmetric"], GREEN, "-.", "third"))
    return drawn


def _draw_law(estimate: Estimate, fastest: float, color: str, dash: str, axes: Axes) -> None:
    speed = np.linspace(1e-4, 1.0, 200) * fastest
    axis = estimate.axis()
    plus, minus = axis.law.laws(axis.values)
    label = f"{estimate.law.name}, {estimate.method}"
    for side, law in ((1.0, plus), (-1.0, minus)):
        axes.plot(
            side * speed,
            law.steady_friction(side * speed),
            color=color,
            linestyle=dash,
            linewidth=1.4,
            label=label if side > 0.0 else None,
        )


def open_loop_series(found: AxisIdentification, record: AxisRecord, of_record: str) -> TimeSeries:
    """Return the position, and the errors of its simulation from the recorded force alone."""
    errors = []
    for estimate, _, _, look in _drawn_laws(found):
        moved = estimate.axis().windows(
            record,
            np.array([0]),
            np.array([len(record) - 1]),
            np.array([[record.position[0], speed_at_start(record)]]),
            interpolated=estimate.model.interpolated,
        )
        error = 1e3 * np.append(0.0, moved - record.position[1:])
        name, rmse = f"{estimate.law.name}, {estimate.method}", estimate.errors[0].open_loop_rmse
        errors.append(Line(name=f"{name}: {1e3 * rmse:.3g} m{found.unit} RMS", values=error, look=look))
    position = (Line(name="recorded", values=record.position, look="measured"),)
    return TimeSeries(
        t=record.t,
        panels=(
            Panel(label=unit_heading("recorded position", found.unit), lines=position),
            Panel(label=unit_heading("error of the position", f"m{found.unit}"), lines=errors),
        ),
        caption=f"Open loop over the whole record{of_record}: the recorded force moves the axis from its first state.",
    )


def laws_figure(found: AxisIdentification) -> Figure:
    """Return each law's gain on held-out blocks over the simpler law within it, with its 95 % interval."""
    compared = [(one, one.gain) for one in found.laws.candidates if one.gain]
    figure = Figure(figsize=(7.4, 0.6 + 0.42 * len(compared)), layout="constrained")
    axes = figure.subplots()
    ends = np.array([(100.0 * gain.lower, 100.0 * gain.upper) for _, gain in compared] or [(0.0, 0.0)])
    left = max(_LEAST_GAIN, min(-5.0, 1.1 * float(ends.min())))
    for place, (one, gain) in enumerate(reversed(compared)):
        color = BLUE if one.accepted else MUTED
        low, middle, high = (100.0 * share for share in (gain.lower, gain.share, gain.upper))
        axes.plot([low, high], [place, place], color=color, linewidth=2.0)
        mark, face = "o" if middle >= left else "<", color if one.accepted else "white"
        axes.plot(max(middle, left), place, mark, color=color, mfc=face, markersize=5, clip_on=False)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(compared)), [f"{one.name} over {one.within}" for one, _ in reversed(compared)])
    axes.set_xlim(left, max(5.0, 1.1 * float(ends.max())))
    axes.set_xlabel("less error on held-out blocks [%]")
    return figure


def axis_report(
    found: AxisIdentification, record: AxisRecord, made: Provenance, findings: Sequence[Finding] = ()
) -> Report:
    """Return the page."""
    shown = found.findings[:_IN_VERDICT]
    return Report(
        title=f"{', '.join(found.records)}: mass and friction",
        lead=f"{_records_words(found)}{record.duration:.1f} s at {1.0 / record.sample_time:.0f} Hz; the law "
        f"{found.chosen.name}, fitted over windows of {found.window:.3g} s.",
        verdict=[
            ("Mass and friction", _values_sentence(found)),
            ("Prediction", expected_sentence(found)),
            *((_VERDICT_WORDS.get(one.code, ""), one.text) for one in shown),
        ],
        sections=list(_sections(found, record)),
        undecided=_undecided(found),
        made=made,
        findings=findings,
    )


def _values_sentence(found: AxisIdentification) -> str:
    """Return the mass and the friction of the result, with their standard errors."""
    best = found.best
    words = {}
    for name, value in best.values.items():
        kind = parameter_named(name)
        number = (
            f"{kind.symbol} = {with_error(value, best.standard_errors[name])} {unit_for(kind, found.unit)}"
        )
        words[name] = f"{kind.meaning} {number}".rstrip()
    friction = [
        words[name] for name in (*found.chosen.names, "load") if name in words and name not in _OTHERS
    ]
    mass = words["mass"]
    return f"{mass[0].upper()}{mass[1:]}; friction by the law {found.chosen.name}: {', '.join(friction)}."


def _sections(found: AxisIdentification, record: AxisRecord) -> Iterator[Section]:
    of_record = f" ({record.name})" if len(found.records) > 1 else ""
    methods = (
        "The inverse model is a regression of the force on the filtered motion; output error simulates the axis over "
        "windows, each from its best start, and is the result. Its standard errors treat residuals that are close in "
        "time as dependent, and include how far parts of the records and the inverse model differ beyond chance."
    )
    headings = ("symbol", "meaning", "unit", *(f"{one.method} ({one.law.name})" for one in found.estimates))
    others = "other forces and the friction under load" if found.best.model.load else "other forces"
    friction = f"Friction over speed{of_record}: force less inertia, offset, {others}, and the laws found."
    terms = term_rows(found)
    yield section(
        "Parameters",
        Bullets(items=texts(found.findings)[_IN_VERDICT:]) if len(found.findings) > _IN_VERDICT else None,
        Sheet(headings=headings, rows=parameter_rows(found)),
        Paragraph(text=methods),
        Sheet(
            headings=("force", "less error of the force", "95 % interval"),
            rows=terms,
            caption="Forces over position or load, selected by the error of the force on held-out blocks.",
        )
        if terms
        else None,
        drawn_picture("friction", partial(axis_friction_figure, found, record), friction),
    )
    by_method, columns = error_table(found.estimates, found.unit)
    errors = (
        "Each method's parameters on each record, RMS. Windows: each from its best start; whole: the record from its "
        "first row."
    )
    yield section(
        "Prediction errors",
        Sheet(headings=by_method, rows=columns, caption=errors),
        open_loop_series(found, record, of_record) if len(record.segments) == 1 else None,
    )
    yield _law_section(found)


def _law_section(found: AxisIdentification) -> Section:
    caption = (
        "Each law compared with the simpler law within it, on blocks that neither was fitted to; bars are 95 % "
        "intervals, with a filled dot if the law is accepted: if it predicts better than that law and than the "
        "largest accepted one within it. An arrow points to a value beyond the axis."
    )
    headings, rows = error_table(tuple(found.by_law.values()), found.unit)
    compared = any(one.gain for one in found.laws.candidates)
    return section(
        "The friction laws",
        drawn_picture("laws", partial(laws_figure, found), caption) if compared else None,
        Sheet(headings=headings, rows=rows, caption="Every law, by output error."),
    )


def _undecided(found: AxisIdentification) -> list[str]:
    """Return what the records leave open."""
    sentences = [
        f"Whether the friction follows the law {one.name} rather than {one.within}: the interval of the gain "
        "contains zero."
        for one in found.laws.candidates
        if one.gain and one.decision == "undecided"
    ]
    if len(found.records) == 1:
        sentences.append(
            "How much parameters differ from record to record: there is one (--also adds records)."
        )
    return [*sentences, "The friction at speeds, loads and temperatures that the records do not have."]


def _records_words(found: AxisIdentification) -> str:
    count = len(found.records)
    return "" if count == 1 else f"{count} records fitted together, the first of "


def parameter_rows(found: AxisIdentification) -> list[tuple[str, ...]]:
    """Return the parameters by every method: symbol, meaning, unit and values with their standard errors."""
    rows = []
    for name in found.best.values:
        kind = parameter_named(name)
        values = [
            with_error(one.values[name], one.standard_errors[name]) if name in one.values else "–"
            for one in found.estimates
        ]
        rows.append((kind.symbol, kind.meaning, unit_for(kind, found.unit), *values))
    return rows


def term_rows(found: AxisIdentification) -> list[tuple[str, ...]]:
    """Return the forces over position and load that were selected, and their gain on held-out blocks."""
    return [
        (
            _TERMS[name],
            f"{digits(100.0 * gain.share)} %",
            f"{digits(100.0 * gain.lower)} to {digits(100.0 * gain.upper)} %",
        )
        for name, gain in found.terms
    ]


def expected_sentence(found: AxisIdentification) -> str:
    """Return the error that another record should show."""
    error, low, high = (digits(1e3 * one) for one in found.expected)
    unit = f"m{found.unit}"
    return (
        f"On another record under these conditions the position error over windows of {found.window:.3g} s should be "
        f"{error} {unit} RMS, with a 95 % interval of {low} to {high} {unit}, from held-out blocks."
    )


def error_table(estimates: Sequence[Estimate], unit: str) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of the errors of estimates, without a column that is empty or the only method's."""
    rows = [row for one in estimates for row in error_rows(one, unit)]
    kept = [
        place
        for place, heading in enumerate(ERROR_HEADINGS)
        if {row[place] for row in rows} != {"–"}
        and (heading != "method" or len({row[place] for row in rows}) > 1)
    ]
    return tuple(ERROR_HEADINGS[i] for i in kept), [tuple(row[i] for i in kept) for row in rows]


def error_rows(estimate: Estimate, unit: str) -> list[tuple[str, ...]]:
    """Return an estimate's prediction errors: method, law, record, and the errors."""
    return [
        (
            estimate.method,
            estimate.law.name,
            errors.record,
            f"{digits(1e3 * errors.window_rmse)} m{unit}",
            f"{digits(1e3 * errors.open_loop_rmse)} m{unit}" if np.isfinite(errors.open_loop_rmse) else "–",
        )
        for errors in estimate.errors
    ]


ERROR_HEADINGS = (
    "method",
    "law",
    "record",
    "position, windows",
    "position, whole",
)


def axis_parts(found: AxisIdentification) -> Iterator[RenderableType]:
    """Yield the parameters by each method, their errors, and the findings."""
    headings = ("symbol", "meaning", "unit", *(one.method for one in found.estimates))
    yield table(f"Friction law: {found.chosen.name}", headings, parameter_rows(found))
    yield table("Errors", *error_table(found.estimates, found.unit))
    yield Text(expected_sentence(found))
    for finding in found.findings:
        yield Text(finding.text)
