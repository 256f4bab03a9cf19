"""A validation's results.json, and its tables as text.

In results.json a model's numbers stand under its name, with_friction and without_friction where these are compared.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.text import Text

from ballbot.findings import finding_results
from ballbot.fitting.comparison import verdicts
from ballbot.log import STATE_NAMES
from ballbot.report.blocks import Sheet, table
from ballbot.rounding import digits
from ballbot.validation import ErrorPair, ModelPair, Validation, findings
from ballbot.validation.prediction import HorizonComparison, Prediction
from ballbot.validation.residuals import ResidualAnalysis
from ballbot.validation.whole_log import QUANTITIES, RUNS, WholeLog


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
            "whole_logs": [_whole_log_results(one, models) for one in closed.whole],
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


def by_state(values: NDArray[np.float64]) -> dict[str, float]:
    """Return ten values by the states' names."""
    return dict(zip(STATE_NAMES, values.tolist(), strict=True))


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


def _whole_log_results(whole: WholeLog, models: ModelPair) -> dict[str, object]:
    """Return RMS, amplitude and period of the log, and least, median and largest of each model's runs."""
    return {
        "duration": whole.duration,
        "runs": RUNS,
        **{
            quantity: {
                "log": by_state(whole.measured[k]),
                **{
                    key_of(name): {
                        "range_95": dict(zip(STATE_NAMES, whole.ranges[::2, model, k].T, strict=True)),
                        "median": by_state(whole.ranges[1, model, k]),
                        "log_is": dict(zip(STATE_NAMES, whole_log_words(whole)[model][k], strict=True)),
                    }
                    for model, name in enumerate(models.names)
                },
            }
            for k, quantity in enumerate(QUANTITIES)
        },
        "ended_early": dict(zip(map(key_of, models.names), whole.fell, strict=True)),
        "errors": _error_results(whole.errors, models),
    }


def whole_log_words(whole: WholeLog) -> list[list[list[str]]]:
    """Return for each model, quantity and state whether the log is below, inside or above the range of its runs."""
    words = np.array(["below", "inside", "above"])
    return words[whole.places + 1].tolist()


def _horizon_results(horizon: HorizonComparison, models: ModelPair) -> dict[str, object]:
    first, second = (key_of(name) for name in models.names)
    errors = horizon.errors
    # a state that moved less than its rounding has no scale
    least = 0.0 if errors.floor is None else errors.floor[0]
    spread = np.where(horizon.spread > least, horizon.spread, np.nan)
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
                {"frequency": peak.frequency, "state": STATE_NAMES[peak.state], "ratio": peak.ratio}
                for peak in found.spectrum.peaks
            ],
        },
        "wheels": {
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
        },
    }


def _columns(values: NDArray[np.float64]) -> dict[str, list[float]]:
    return {name: values[:, index].tolist() for index, name in enumerate(STATE_NAMES)}


def validation_parts(validation: Validation) -> Iterator[RenderableType]:
    """Yield the errors in open and in closed loop, where whole logs lie among runs of the models, and the findings."""
    if validation.no_evidence is not None:
        yield Text(validation.no_evidence)
        return
    loops = {
        "open loop": validation.open_loop and validation.open_loop.errors,
        "closed loop": validation.closed_loop and validation.closed_loop.restarted,
    }
    for what, errors in loops.items():
        if errors is not None:
            yield _error_table(what, errors, validation.models)
    for whole in validation.closed_loop.whole if validation.closed_loop else ():
        yield _whole_log_table(whole, validation.models)
    for finding in findings(validation):
        yield Text(finding.text)


def _error_table(what: str, pair: ErrorPair, models: ModelPair) -> Sheet:
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
    headings = ("state", "|e|/n A", "B", "B/A", "95 %", "A is", "RMSE A", "B")
    title = f"{what}, {pair.runs} runs; A {models.first.name}, B {models.second.name}"
    return table(title, headings, rows)


def _whole_log_table(whole: WholeLog, models: ModelPair) -> Sheet:
    words = whole_log_words(whole)
    rows = [
        (
            name,
            *(
                cell
                for k in range(len(QUANTITIES))
                for cell in (swing_digits(whole.measured[k, i]), words[0][k][i], words[1][k][i])
            ),
        )
        for i, name in enumerate(STATE_NAMES)
    ]
    headings = ("state", "RMS", "A", "B", "amplitude", "A", "B", "period", "A", "B")
    title = (
        f"closed loop over {whole.duration:.3g} s: the log's deviation from the reference, and where it lies in the "
        f"95 % range of {RUNS} runs; A {models.first.name}, B {models.second.name}"
    )
    return table(title, headings, rows)


def swing_digits(value: float) -> str:
    """Return a number of a whole log; a dash for one that a run without swings, or one that fell, does not have."""
    return digits(value) if 0.0 < value < np.inf else "–"
