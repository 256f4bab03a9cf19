"""What the pages say of a validation: its tables, figures and words, as the templates take them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from markupsafe import Markup
from matplotlib.figure import Figure

from ballbot.report.page import figure_markup, render
from ballbot.report.provenance import Provenance
from ballbot.report.style import STATE_UNITS, drawn
from ballbot.report.tables import error_rows, with_symbols
from ballbot.report.validation_figures import (
    correlation_figure,
    horizon_figure,
    ratio_figure,
    symbols,
    trajectories_figure,
)
from ballbot.validation import Validation, findings


def validation_report(
    validation: Validation, *, title: str, lead: str, example_of: str, made: Provenance
) -> str:
    """Return a validation's own page as HTML; `example_of` names the log that its examples are of."""
    verdict, *others = (with_symbols(finding) for finding in findings(validation))
    values = {
        "title": title,
        "lead": lead,
        "verdict": verdict,
        "v": validation_values(validation, example_of=example_of) | {"findings": others},
        "made": made,
    }
    return render("validation", values)


def validation_values(validation: Validation, *, example_of: str) -> dict[str, object]:
    """Return what the template's sections on a validation take; `example_of` names the log of the examples."""
    loop, closed, units = validation.open_loop, validation.closed_loop, dict(STATE_UNITS)
    prediction = validation.prediction
    values: dict[str, object] = {
        "findings": [with_symbols(finding) for finding in findings(validation)],
        "example_of": example_of,
        "ratio_figure": _svg("ratios", partial(ratio_figure, loop, closed)),
        "open_loop_rows": error_rows(loop.errors, units),
        "open_loop_runs": loop.errors.runs,
        "open_loop_figure": _svg("open-loop", partial(trajectories_figure, loop.example)),
        "closed_loop_rows": None,
        "no_closed_loop": validation.no_closed_loop,
        "correlation_figure": _svg(
            "residuals", partial(correlation_figure, symbols(prediction.labels), prediction.correlation)
        ),
        "horizon_figure": _svg("horizon", partial(horizon_figure, validation.horizon)),
    }
    if closed is not None:
        values |= {
            "closed_loop_rows": error_rows(closed.restarted, units),
            "closed_loop_runs": closed.restarted.runs,
            "whole_rows": error_rows(closed.whole, units),
            "restart_every": f"{closed.restart_every:.2g}",
            "controller_words": _controller_words(validation),
            "closed_loop_figure": _svg("closed-loop", partial(trajectories_figure, closed.example)),
        }
    return values


def _controller_words(validation: Validation) -> str:
    recovered = validation.recovered
    if recovered is None:
        return ""
    worst = float(recovered.r_squared.min())
    late = "" if recovered.delay == 0 else f", {recovered.delay} samples late"
    return f" (its gain recovered from the log, R² = {worst:.4f}{late})"


def _svg(name: str, draw: Callable[[], Figure]) -> Markup:
    return figure_markup(drawn(draw, name=name))
