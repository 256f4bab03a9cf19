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
from ballbot.identification.axis.model import unit_for
from ballbot.identification.axis.motion import default_bandwidth, smoothed_motion, speed_at_start
from ballbot.identification.axis.result import Estimate
from ballbot.identification.axis.structure import base_name
from ballbot.report.console import table
from ballbot.report.page import Provenance, figure_markup, render
from ballbot.report.style import BLUE, GREEN, INK, MEASURED, MUTED, ORANGE, drawn, thinned
from ballbot.report.tables import digits, with_error

#: a point of the friction figure is drawn only where the axis moves faster than this share of its fastest
_SLOW = 0.02
#: points of the friction figure, about
_MOST_POINTS = 3000
#: the least gain that the figure of the laws shows [%]
_LEAST_GAIN = -100.0


def axis_friction_figure(found: AxisIdentification, record: AxisRecord) -> Figure:
    """Return the friction over speed: the force less all other forces, and the laws found."""
    motion = smoothed_motion(record, bandwidth=default_bandwidth(record))
    axis = found.estimate("inverse").axis()
    needed = axis.needed_force(record, motion.position, np.zeros(len(record)), motion.acceleration)
    friction = record.force - needed
    fastest = float(np.abs(motion.speed).max())
    moving = np.flatnonzero(np.abs(motion.speed) > _SLOW * fastest)
    moving = moving[:: max(1, len(moving) // _MOST_POINTS)]
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    axes = figure.subplots()
    axes.plot(
        motion.speed[moving], friction[moving], ".", color=MUTED, markersize=1.6, alpha=0.5, label="record"
    )
    for estimate, color, dash in _drawn_laws(found):
        _draw_law(estimate, fastest, color, dash, axes)
    middle = float(np.quantile(np.abs(friction[moving]), 0.99))
    axes.set_ylim(-1.3 * middle, 1.3 * middle)
    axes.set_xlabel(f"speed [{found.unit}/s]")
    axes.set_ylabel(f"friction [{record.force_unit}]")
    axes.legend(loc="upper left", markerscale=5.0)
    return figure


def panels_over_time(*, height: float, ratios: tuple[int, int]) -> tuple[Figure, Axes, Axes]:
    """Return a figure so high [in] of two panels over one time, with these heights relative to one another."""
    figure = Figure(figsize=(7.4, height), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=ratios)
    lower.set_xlabel("time [s]")
    return figure, upper, lower


def _drawn_laws(found: AxisIdentification) -> list[tuple[Estimate, str, str]]:
    drawn = [(found.estimate("inverse"), ORANGE, "--"), (found.best, BLUE, "-")]
    if found.chosen.symmetric:
        drawn.append((found.by_law["asymmetric"], GREEN, ":"))
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


def closed_loop_figure(found: AxisIdentification, record: AxisRecord) -> Figure:
    """Return the force in closed loop, recorded and simulated, and the difference."""
    axis = found.estimate("closed loop").axis()
    moved = axis.closed_loop(record, speed=speed_at_start(record))
    figure, upper, lower = panels_over_time(height=3.8, ratios=(2, 1))
    t, measured, simulated = thinned(record.t, record.force, moved.forces)
    upper.plot(t, measured, label="recorded", **MEASURED)
    upper.plot(t, simulated, color=BLUE, linewidth=0.9, label="simulated in closed loop")
    upper.set_ylabel(f"force [{record.force_unit}]")
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    lower.plot(t, simulated - measured, color=INK, linewidth=0.7)
    lower.set_ylabel("difference")
    return figure


def open_loop_figure(found: AxisIdentification, record: AxisRecord) -> Figure:
    """Return the position, and the errors of its simulation from the recorded force alone."""
    figure, upper, lower = panels_over_time(height=3.8, ratios=(1, 2))
    t, position = thinned(record.t, record.position)
    upper.plot(t, position, label="recorded", **MEASURED)
    upper.set_ylabel(f"position [{found.unit}]")
    for estimate, color, dash in _drawn_laws(found):
        moved = estimate.axis().windows(
            record,
            np.array([0]),
            np.array([len(record) - 1]),
            np.array([[record.position[0], speed_at_start(record)]]),
            interpolated=estimate.model.interpolated,
        )
        t, error = thinned(record.t[1:], 1e3 * (moved - record.position[1:]))
        label = f"{estimate.law.name}, {estimate.method}: {1e3 * estimate.errors[0].open_loop_rmse:.3g} RMS"
        lower.plot(t, error, color=color, linestyle=dash, linewidth=1.2, label=label)
    lower.axhline(0.0, color=MUTED, linewidth=0.6)
    lower.set_ylabel(f"error [m{found.unit}]")
    lower.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    return figure


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
        mark = "o" if middle >= left else "<"
        axes.plot(max(middle, left), place, mark, color=color, markersize=5, clip_on=False)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(compared)), [f"{one.name} over {one.within}" for one, _ in reversed(compared)])
    axes.set_xlim(left, max(5.0, 1.1 * float(ends.max())))
    axes.set_xlabel("less error on held-out blocks [%]")
    return figure


def axis_report(
    found: AxisIdentification, record: AxisRecord, made: Provenance, findings: Sequence[Finding] = ()
) -> str:
    """Return the page."""
    figures = {
        "friction_figure": partial(axis_friction_figure, found, record),
        "laws_figure": partial(laws_figure, found),
    }
    if len(record.segments) == 1:
        figures["open_loop_figure"] = partial(open_loop_figure, found, record)
    if any(one.method == "closed loop" for one in found.estimates):
        figures["closed_loop_figure"] = partial(closed_loop_figure, found, record)
    values: dict[str, object] = {
        "title": f"{', '.join(found.records)}: mass and friction",
        "lead": f"{_records_words(found)}{record.duration:.1f} s at {1.0 / record.sample_time:.0f} Hz; "
        f"the law {found.chosen.name}, "
        f"fitted over windows of {found.horizon.chosen:g} s.",
        "terms": term_rows(found, record.force_unit),
        "expected": expected_sentence(found),
        "residuals": residual_rows(found, record.force_unit),
        "remarks": texts(found.remarks),
        "parameters": parameter_rows(found),
        "methods": [f"{one.method} ({one.law.name})" for one in found.estimates],
        "of_record": f" ({record.name})" if len(found.records) > 1 else "",
        "errors": error_table(found.estimates, found.unit),
        "laws": error_table(tuple(found.by_law.values()), found.unit),
        "inverse": _inverse_rows(found),
        "closed_loop_figure": None,
        "open_loop_figure": None,
        "made": made,
        "log_findings": findings,
    }
    svgs = {name: figure_markup(drawn(draw, name=name.replace("_", "-"))) for name, draw in figures.items()}
    return render("axis", values | svgs)


def _records_words(found: AxisIdentification) -> str:
    count = len(found.records)
    return "" if count == 1 else f"{count} records fitted together, the first of "


def parameter_rows(found: AxisIdentification) -> list[tuple[str, ...]]:
    """Return the parameters by every method: symbol, meaning, unit and values with their standard errors."""
    given = [label for one in found.estimates for label in one.values if not label.startswith("drift_")]
    labels = dict.fromkeys([*(label for label in found.model.labels if label in given), *given])
    rows = []
    for label in labels:
        kind = found.model.parameter(label)
        values = [
            with_error(one.values[label], one.standard_errors[label]) if label in one.values else "–"
            for one in found.estimates
        ]
        rows.append((kind.symbol, kind.meaning, unit_for(kind, found.unit), *values))
    return rows


def term_rows(found: AxisIdentification, force_unit: str) -> list[tuple[str, ...]]:
    """Return the forces over position and the drift that were selected, and their gain on held-out blocks."""
    return [
        (
            {
                "spring": "proportional to position",
                "drift": f"drift of the constant force, by {digits(found.drift)} {force_unit} in all",
            }.get(name, name),
            f"{digits(100.0 * gain.share)} %",
            f"{digits(100.0 * gain.lower)} to {digits(100.0 * gain.upper)} %",
        )
        for name, gain in found.terms
    ]


def expected_sentence(found: AxisIdentification) -> str:
    """Return the error that another record should show."""
    one = found.expected
    unit = f"m{found.unit}"
    source = (
        "the variation between the records"
        if one.records > 1
        else "an assumed variation between records, as there is one record"
    )
    return (
        f"On another record under these conditions the position error over windows of {one.horizon:g} s should be "
        f"{digits(1e3 * one.error)} {unit} RMS, with a 95 % interval of {digits(1e3 * one.lower)} to "
        f"{digits(1e3 * one.upper)} {unit}, from held-out blocks and {source}."
    )


def residual_rows(found: AxisIdentification, force_unit: str) -> list[tuple[str, ...]]:
    """Return the tests of the residual force."""
    return [
        (
            one.quantity,
            f"{one.p_value:.1g}" if np.isfinite(one.p_value) else "too few blocks",
            f"{digits(one.size)} {force_unit}",
            f"{digits(100.0 * one.share)} %",
            "yes" if one.dependent else "no",
        )
        for one in found.residuals
    ]


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
            _percent(errors.inverse_force),
            _percent(errors.closed_loop_force),
            _percent(errors.closed_loop_position),
        )
        for errors in estimate.errors
    ]


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{digits(100.0 * share)} %"


def _inverse_rows(found: AxisIdentification) -> list[tuple[str, ...]]:
    rows = []
    for form, fit in found.inverse.items():
        for name, value, deviation, clustered in zip(
            fit.names, fit.values, fit.standard_deviations, fit.clustered_errors, strict=True
        ):
            symbol = found.model.parameter(name).symbol
            if base_name(name).startswith("drift_"):
                continue
            if value == 0.0:
                rows.append((form, symbol, "0", "fixed at zero", "", ""))
                continue
            share = f"{digits(100.0 * abs(deviation / value))} %"
            numbers = [_decimals(number) for number in (value, deviation, clustered)]
            rows.append((form, symbol, numbers[0], numbers[1], share, numbers[2]))
        rows.append((form, "force error", f"{100.0 * fit.relative_force_error:.4f} %", "", "", ""))
    return rows


def _decimals(value: float) -> str:
    """Return four decimals, as published, or four digits of a small number."""
    return f"{value:.4f}" if abs(value) >= 0.01 else f"{value:.4g}"


ERROR_HEADINGS = (
    "method",
    "law",
    "record",
    "position, windows",
    "position, whole",
    "force, inverse",
    "force, closed loop",
    "position, closed loop",
)


def axis_parts(found: AxisIdentification, *, framed: bool) -> Iterator[RenderableType]:
    """Yield the parameters by each method, their errors, and the findings."""
    headings = ("symbol", "meaning", "unit", *(one.method for one in found.estimates))
    yield table(f"Friction law: {found.chosen.name}", headings, parameter_rows(found), framed=framed)
    yield table("Errors", *error_table(found.estimates, found.unit), framed=framed)
    yield Text(expected_sentence(found))
    for finding in found.remarks:
        yield Text(finding.text)
