"""The page of an axis's identification, as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ballbot.findings import Finding
from ballbot.identification.axis import AxisIdentification, AxisRecord
from ballbot.identification.axis.identify import Estimate
from ballbot.identification.axis.model import PARAMETERS
from ballbot.report.axis_figures import (
    axis_friction_figure,
    closed_loop_figure,
    ladder_figure,
    open_loop_figure,
)
from ballbot.report.page import figure_markup, render
from ballbot.report.provenance import Provenance
from ballbot.report.style import drawn
from ballbot.report.tables import digits, with_error


def axis_report(
    found: AxisIdentification, record: AxisRecord, made: Provenance, findings: Sequence[Finding] = ()
) -> str:
    """Return the page."""
    seconds = len(record) * record.sample_time
    figures = {
        "friction_figure": partial(axis_friction_figure, found, record),
        "open_loop_figure": partial(open_loop_figure, found, record),
        "ladder_figure": partial(ladder_figure, found),
    }
    if record.loop is not None:
        figures["closed_loop_figure"] = partial(closed_loop_figure, found, record)
    values: dict[str, object] = {
        "title": f"{found.record}: mass and friction",
        "lead": f"{seconds:.1f} s at {1.0 / record.sample_time:.0f} Hz; the law {found.chosen.name}.",
        "remarks": found.remarks,
        "parameters": parameter_rows(found),
        "methods": [f"{one.method} ({one.rung.name})" for one in found.estimates],
        "errors": [row for one in found.estimates for row in error_rows(one, found.unit)],
        "laws": [row for one in found.rungs.values() for row in error_rows(one, found.unit)],
        "inverse": _inverse_rows(found),
        "closed_loop_figure": None,
        "made": made,
        "log_findings": findings,
    }
    svgs = {name: figure_markup(drawn(draw, name=name.replace("_", "-"))) for name, draw in figures.items()}
    return render("axis", values | svgs)


def parameter_rows(found: AxisIdentification) -> list[tuple[str, ...]]:
    """Return the parameters by every method: symbol, meaning, unit and values with their standard errors."""
    names = dict.fromkeys(name for one in found.estimates for name in one.values)
    rows = []
    for name in names:
        kind = PARAMETERS[name]
        values = [
            with_error(one.values[name], one.standard_errors[name]) if name in one.values else "–"
            for one in found.estimates
        ]
        rows.append((kind.symbol, kind.meaning, kind.unit_for(found.unit), *values))
    return rows


def error_rows(estimate: Estimate, unit: str) -> list[tuple[str, str, str, str, str, str]]:
    """Return what an estimate predicts: method, law, record, open loop, force and position in closed loop."""
    return [
        (
            estimate.method,
            estimate.rung.name,
            errors.record,
            f"{digits(1e3 * errors.open_loop_rmse)} m{unit}",
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
            if value == 0.0:
                rows.append((form, PARAMETERS[name].symbol, "0", "fixed at zero", "", ""))
                continue
            share = f"{digits(100.0 * abs(deviation / value))} %"
            rows.append(
                (form, PARAMETERS[name].symbol, f"{value:.4f}", f"{deviation:.4f}", share, f"{clustered:.4f}")
            )
        rows.append((form, "force error", f"{100.0 * fit.relative_force_error:.4f} %", "", "", ""))
    return rows
