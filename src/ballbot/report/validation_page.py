"""What the pages say of a validation: its tables, figures and words, as the templates take them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from markupsafe import Markup
from matplotlib.figure import Figure

from ballbot.log import STATE_NAMES
from ballbot.report.page import figure_markup, render
from ballbot.report.provenance import Provenance
from ballbot.report.residual_figures import spectrum_figure, wheels_figure
from ballbot.report.style import STATE_UNITS, drawn
from ballbot.report.tables import error_rows, state_mark, with_symbols
from ballbot.report.validation_figures import (
    correlation_figure,
    horizon_figure,
    ratio_figure,
    symbols,
    trajectories_figure,
)
from ballbot.validation import Validation, findings
from ballbot.validation.residuals.whiteness import Whiteness
from ballbot.validation.residuals.words import residual_findings
from ballbot.validation.state_errors import LEAST_RUNS


def validation_report(
    validation: Validation, *, title: str, lead: str, example_of: str, made: Provenance
) -> str:
    """Return a validation's own page as HTML; `example_of` names the log that its examples are of."""
    verdict, *others = (with_symbols(finding) for finding in findings(validation))
    values = {
        "title": title,
        "lead": lead,
        "verdict": verdict,
        "v": validation_values(validation, example_of=example_of)
        | {"findings": _of_models(validation, others)},
        "made": made,
        "log_findings": validation.log_findings,
    }
    return render("validation", values)


def validation_values(validation: Validation, *, example_of: str) -> dict[str, object]:
    """Return what the template's sections on a validation take; `example_of` names the log of the examples."""
    found = [with_symbols(finding) for finding in findings(validation)]
    return {
        "first": validation.models.first.name,
        "second": validation.models.second.name,
        "findings": _of_models(validation, found),
        "example_of": example_of,
        "least_runs": LEAST_RUNS,
        "no_open_loop": validation.no_open_loop,
        "no_closed_loop": validation.no_closed_loop,
        **_open_loop_values(validation),
        **_closed_loop_values(validation),
        **_residual_values(validation),
        "horizon_figure": _svg(
            "horizon", partial(horizon_figure, validation.horizon, validation.models.names)
        ),
    }


def _open_loop_values(validation: Validation) -> dict[str, object]:
    loop, closed, names = validation.open_loop, validation.closed_loop, validation.models.names
    compared = loop is not None or closed is not None
    values: dict[str, object] = {
        "ratio_figure": _svg("ratios", partial(ratio_figure, loop, closed, names)) if compared else None,
        "open_loop_rows": None,
    }
    if loop is not None:
        values |= {
            "open_loop_rows": error_rows(loop.errors, dict(STATE_UNITS)),
            "open_loop_runs": loop.errors.runs,
            "open_loop_figure": _svg("open-loop", partial(trajectories_figure, loop.example, names)),
        }
    return values


def _closed_loop_values(validation: Validation) -> dict[str, object]:
    closed, units = validation.closed_loop, dict(STATE_UNITS)
    if closed is None:
        return {"closed_loop_rows": None}
    return {
        "closed_loop_rows": error_rows(closed.restarted, units),
        "closed_loop_runs": closed.restarted.runs,
        "whole_rows": error_rows(closed.whole, units),
        "restart_every": f"{closed.restart_every:.2g}",
        "controller_words": _controller_words(validation),
        "closed_loop_figure": _svg(
            "closed-loop", partial(trajectories_figure, closed.example, validation.models.names)
        ),
    }


def _residual_values(validation: Validation) -> dict[str, object]:
    found = validation.residuals
    matrix = found.correlations
    return {
        "residual_findings": [with_symbols(finding) for finding in residual_findings(found)],
        "correlation_figure": _svg(
            "residuals",
            partial(correlation_figure, symbols(matrix.labels), matrix.matrix, marked=matrix.significant),
        ),
        "whiteness_rows": _whiteness_rows(found.whiteness) if found.whiteness else None,
        "spectrum_figure": _svg("spectrum", partial(spectrum_figure, found)) if found.spectrum else None,
        "wheels_figure": _svg("wheels", partial(wheels_figure, found)) if found.by_speed else None,
    }


def _of_models(validation: Validation, found: list[str]) -> list[str]:
    """Return the findings without those on residuals, which have a place of their own."""
    return found[: len(found) - len(residual_findings(validation.residuals))]


def _whiteness_rows(found: Whiteness) -> list[tuple[str, ...]]:
    """Return state, verdict, p, correlation with the sample before, and share foretold."""
    return [
        (
            f"ε({state_mark(name)})",
            found.colours[place],
            "< 0.001" if found.p_value[place] < 1e-3 else f"{found.p_value[place]:.3f}",
            f"{found.autocorrelation[1, place]:+.2f}",
            f"{100 * found.foretold[place]:.0f} %",
        )
        for place, name in enumerate(STATE_NAMES)
    ]


def _controller_words(validation: Validation) -> str:
    recovered = validation.recovered
    if recovered is None:
        return ""
    worst = float(recovered.r_squared.min())
    late = "" if recovered.delay == 0 else f", {recovered.delay} samples late"
    return f" (its gain recovered from the log, R² = {worst:.4f}{late})"


def _svg(name: str, draw: Callable[[], Figure]) -> Markup:
    return figure_markup(drawn(draw, name=name))
