"""A validation's results.json, and its tables, figures and findings as the templates take them.

In results.json a model's numbers stand under its name, with_friction and without_friction where these are compared.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ballbot.findings import finding_results
from ballbot.fitting.comparison import LEAST_RUNS, verdicts
from ballbot.log import STATE_NAMES
from ballbot.report.console import table
from ballbot.report.page import Provenance, by_state, figure_markup, render
from ballbot.report.style import STATE_UNITS, drawn
from ballbot.report.tables import digits, error_rows, state_mark, with_symbols
from ballbot.report.validation_figures import (
    correlation_figure,
    horizon_figure,
    ratio_figure,
    spectrum_figure,
    symbols,
    trajectories_figure,
    wheels_figure,
)
from ballbot.validation import ErrorPair, ModelPair, Validation, findings
from ballbot.validation.prediction import HorizonComparison, Prediction
from ballbot.validation.residuals import ResidualAnalysis, residual_findings
from ballbot.validation.statistics import Whiteness


def validation_results(validation: Validation) -> dict[str, object]:
    """Return what results.json holds of one validation."""
    loop, closed, models = validation.open_loop, validation.closed_loop, validation.models
    return {
        "models": [
            {"name": one.name, "robot": one.model.robot.name, "formulation": one.model.formulation}
            for one in (models.first, models.second)
        ],
        "findings": finding_results(findings(validation)),
        "duration": validation.duration,
        "open_loop": None
        if loop is None
        else {
            **_error_results(loop.errors, models),
            "noise_floor_rmse": by_state(loop.noise_floor),
            "past_recovery": loop.past_recovery,
            "recoverable_lean": loop.recoverable_lean,
        },
        "no_open_loop": validation.no_open_loop,
        "closed_loop": None
        if closed is None
        else {
            **_error_results(closed.restarted, models),
            "restart_every": closed.restart_every,
            "whole_log": _error_results(closed.whole, models),
        },
        "no_closed_loop": validation.no_closed_loop,
        "prediction": _prediction_results(validation.prediction, validation.residuals, models),
        "horizon": _horizon_results(validation.horizon, models),
        "recovered_gain": None
        if validation.recovered is None
        else {
            "gain": validation.recovered.gain,
            "delay_samples": validation.recovered.delay,
            "r_squared": validation.recovered.r_squared,
        },
    }


def key_of(name: str) -> str:
    """Return a model's name as a key of results.json: with_friction, of_soft_toml."""
    return re.sub(r"\W+", "_", name).strip("_")


def _error_results(pair: ErrorPair, models: ModelPair) -> dict[str, object]:
    first, second = (key_of(name) for name in models.names)
    lower, upper = pair.ratio_interval()
    normalised = pair.normalised_rmse
    return {
        first: by_state(pair.first.error),
        second: by_state(pair.second.error),
        f"rmse_{first}": by_state(pair.first.rmse),
        f"rmse_{second}": by_state(pair.second.rmse),
        f"normalised_rmse_{first}": by_state(normalised[0]),
        f"normalised_rmse_{second}": by_state(normalised[1]),
        "ratio": by_state(pair.ratio),
        "ratio_interval": {name: [lower[i], upper[i]] for i, name in enumerate(STATE_NAMES)},
        "verdict": dict(zip(STATE_NAMES, pair.verdicts(), strict=True)),
        "runs": pair.runs,
        "samples": int(pair.first.samples.sum()),
    }


def _horizon_results(horizon: HorizonComparison, models: ModelPair) -> dict[str, object]:
    first, second = (key_of(name) for name in models.names)
    errors, spread = horizon.errors, horizon.spread
    first_rmse, second_rmse = errors.rmse
    intervals = errors.ratio_interval()
    return {
        "seconds": errors.horizons,
        f"rmse_{first}": _columns(first_rmse),
        f"rmse_{second}": _columns(second_rmse),
        f"normalised_rmse_{first}": _columns(first_rmse / spread),
        f"normalised_rmse_{second}": _columns(second_rmse / spread),
        "ratio": _columns(errors.ratio),
        "ratio_interval": {name: intervals[:, :, i].T for i, name in enumerate(STATE_NAMES)},
        "verdict": [verdicts(interval) for interval in intervals.swapaxes(0, 1)],
        "noise_floor_rmse": _columns(horizon.noise_floor),
    }


def _prediction_results(
    prediction: Prediction, found: ResidualAnalysis, models: ModelPair
) -> dict[str, object]:
    return {
        "labels": prediction.labels,
        "correlation": found.correlations.matrix,
        "significant": found.correlations.significant,
        "effective_samples": found.correlations.counts,
        **_error_results(prediction.errors, models),
        "whiteness": None
        if found.whiteness is None
        else {
            "verdict": dict(zip(STATE_NAMES, found.whiteness.colours, strict=True)),
            "p_value": by_state(found.whiteness.p_value),
            "predicted_share": by_state(found.whiteness.predicted_share),
            "autocorrelation": _columns(found.whiteness.autocorrelation),
        },
        "spectrum": None
        if found.spectrum is None
        else {
            "resolution": found.spectrum.resolution,
            "peaks": [
                {"frequency": peak.frequency, "states": peak.states, "cause": peak.cause}
                for peak in found.peaks
            ],
        },
        "renewed_at": {"torques": found.updates.torques, "states": found.updates.states},
        "roller_passing": found.roller_passing,
        "wheels": _wheel_results(found),
    }


def _wheel_results(found: ResidualAnalysis) -> dict[str, object]:
    """Return the residual torques against the wheels' speed, travel and position."""
    travel, position = found.by_travel, found.by_position
    return {
        "refused": found.no_wheels,
        "by_speed": [
            {
                "speed": effect.speeds,
                "torque": effect.torques,
                "half_width": effect.half_widths,
                "p_value": effect.p_value,
            }
            for effect in found.by_speed or ()
        ],
        "by_travel": None
        if travel is None
        else {
            "travel": travel.travels,
            "torque": travel.torques,
            "half_width": travel.half_widths,
            "p_value": travel.p_value,
            "reversals": travel.reversals,
        },
        "by_position": None
        if position is None
        else {
            "order": position.orders,
            "amplitude": position.amplitudes,
            "half_width": position.half_widths,
            "significant": position.significant,
            "turns": position.turns,
        },
        "position_refused": found.no_position,
    }


def _columns(values: NDArray[np.float64]) -> dict[str, list[float]]:
    return {name: values[:, index].tolist() for index, name in enumerate(STATE_NAMES)}


def validation_report(
    validation: Validation, *, title: str, lead: str, example_of: str, made: Provenance
) -> str:
    """Return a validation's own page as HTML; `example_of` names the log that its examples are of."""
    verdict, *others = (with_symbols(finding.text) for finding in findings(validation))
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
    found = [with_symbols(finding.text) for finding in findings(validation)]
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
        "residual_findings": [with_symbols(finding.text) for finding in residual_findings(found)],
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
    """Return state, verdict, p, correlation with the sample before, and predicted share of the variance."""
    return [
        (
            f"ε({state_mark(name)})",
            found.colours[place],
            "< 0.001" if found.p_value[place] < 1e-3 else f"{found.p_value[place]:.3f}",
            f"{found.autocorrelation[1, place]:+.2f}",
            f"{100 * found.predicted_share[place]:.0f} %",
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


def validation_parts(validation: Validation, *, framed: bool) -> Iterator[RenderableType]:
    """Yield the errors in open and in closed loop, and the findings."""
    loops = {
        "open loop": validation.open_loop and validation.open_loop.errors,
        "closed loop": validation.closed_loop and validation.closed_loop.restarted,
    }
    for what, errors in loops.items():
        if errors is not None:
            yield _error_table(what, errors, validation.models, framed=framed)
    for finding in findings(validation):
        yield Text(finding.text)


def _error_table(what: str, pair: ErrorPair, models: ModelPair, *, framed: bool) -> Table:
    lower, upper = pair.ratio_interval()
    verdicts = pair.verdicts()
    rows = [
        (
            name,
            digits(pair.first.error[i]),
            digits(pair.second.error[i]),
            digits(pair.ratio[i]),
            f"{digits(lower[i])} to {digits(upper[i])}" if np.isfinite(lower[i]) else "too few runs",
            verdicts[i] if np.isfinite(lower[i]) else "",
            digits(pair.first.rmse[i]),
            digits(pair.second.rmse[i]),
        )
        for i, name in enumerate(STATE_NAMES)
    ]
    headings = ("state", "(4.1) A", "B", "B/A", "95 %", "A is", "RMSE A", "B")
    title = f"{what}, {pair.runs} runs; A {models.first.name}, B {models.second.name}"
    return table(title, headings, rows, framed=framed)
