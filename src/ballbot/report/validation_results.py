"""What results.json holds of a validation.

A model's numbers stand under its name, with_friction and without_friction where these are compared.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ballbot.log import STATE_NAMES
from ballbot.report.json_text import by_state
from ballbot.validation import ErrorPair, ModelPair, Validation, findings
from ballbot.validation.horizon import HorizonErrors
from ballbot.validation.prediction import Prediction
from ballbot.validation.residuals import ResidualAnalysis
from ballbot.validation.state_errors import verdicts


def validation_results(validation: Validation) -> dict[str, object]:
    """Return what results.json holds of one validation."""
    loop, closed, models = validation.open_loop, validation.closed_loop, validation.models
    return {
        "models": [
            {"name": one.name, "robot": one.model.robot.name, "formulation": one.model.formulation}
            for one in (models.first, models.second)
        ],
        "findings": findings(validation),
        "duration": validation.duration,
        "open_loop": None
        if loop is None
        else {
            **_errors(loop.errors, models),
            "noise_floor_rmse": by_state(loop.noise_floor),
            "past_recovery": loop.past_recovery,
            "recoverable_lean": loop.recoverable_lean,
        },
        "no_open_loop": validation.no_open_loop,
        "closed_loop": None
        if closed is None
        else {
            **_errors(closed.restarted, models),
            "restart_every": closed.restart_every,
            "whole_log": _errors(closed.whole, models),
        },
        "no_closed_loop": validation.no_closed_loop,
        "prediction": _prediction(validation.prediction, validation.residuals, models),
        "horizon": _horizon(validation.horizon, models),
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


def _errors(pair: ErrorPair, models: ModelPair) -> dict[str, object]:
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


def _horizon(errors: HorizonErrors, models: ModelPair) -> dict[str, object]:
    first, second = (key_of(name) for name in models.names)
    intervals = errors.ratio_interval()
    return {
        "seconds": errors.horizons,
        f"rmse_{first}": _columns(errors.first),
        f"rmse_{second}": _columns(errors.second),
        f"normalised_rmse_{first}": _columns(errors.first / errors.spread),
        f"normalised_rmse_{second}": _columns(errors.second / errors.spread),
        "ratio": _columns(errors.ratio),
        "ratio_interval": {name: intervals[:, :, i].T for i, name in enumerate(STATE_NAMES)},
        "verdict": [verdicts(interval) for interval in intervals.swapaxes(0, 1)],
        "noise_floor_rmse": _columns(errors.noise_floor),
    }


def _prediction(prediction: Prediction, found: ResidualAnalysis, models: ModelPair) -> dict[str, object]:
    return {
        "labels": prediction.labels,
        "correlation": found.correlations.matrix,
        "significant": found.correlations.significant,
        "effective_samples": found.correlations.counts,
        **_errors(prediction.errors, models),
        "whiteness": None
        if found.whiteness is None
        else {
            "verdict": dict(zip(STATE_NAMES, found.whiteness.colours, strict=True)),
            "p_value": by_state(found.whiteness.p_value),
            "foretold": by_state(found.whiteness.foretold),
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
        "wheels": _wheels(found),
    }


def _wheels(found: ResidualAnalysis) -> dict[str, object]:
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
