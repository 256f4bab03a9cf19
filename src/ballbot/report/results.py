"""results.json: what other programs read. The keys named in the project's README stay."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.experiments.study import Study
from ballbot.log import STATE_NAMES
from ballbot.report.provenance import Provenance
from ballbot.validation import ErrorPair, Validation, findings


def study_results(study: Study, made: Provenance) -> dict[str, object]:
    """Return what a study's results.json holds."""
    identification = study.found.to_dict()
    validation = validation_results(study.validation)
    validation["by_log"] = {
        one.name: validation_results(part) for one, part in zip(study.logs, study.by_log, strict=True)
    }
    validation["held_out"] = {one.name: one.held_out for one in study.logs}
    return {
        "robot": study.robot.name,
        "parameters": identification.pop("parameters"),
        "standard_errors": identification.pop("standard_errors"),
        "warnings": identification.pop("warnings"),
        "identification": identification,
        "validation": validation,
        "controller": _controller(study),
        "comparison": _comparison(study),
        "provenance": made.to_dict(),
    }


def validation_results(validation: Validation) -> dict[str, object]:
    """Return what results.json holds of one validation."""
    loop, closed, prediction = validation.open_loop, validation.closed_loop, validation.prediction
    return {
        "findings": findings(validation),
        "duration": validation.duration,
        "open_loop": {
            **_errors(loop.errors),
            "noise_floor_rmse": by_state(loop.noise_floor),
            "past_recovery": loop.past_recovery,
            "recoverable_lean": loop.recoverable_lean,
        },
        "closed_loop": None
        if closed is None
        else {
            **_errors(closed.restarted),
            "restart_every": closed.restart_every,
            "whole_log": _errors(closed.whole),
        },
        "no_closed_loop": validation.no_closed_loop,
        "prediction": {
            "labels": prediction.labels,
            "correlation": prediction.correlation,
            **_errors(prediction.errors),
        },
        "horizon": {
            "seconds": validation.horizon.horizons,
            "rmse_with_friction": _columns(validation.horizon.with_friction),
            "rmse_without_friction": _columns(validation.horizon.without_friction),
            "noise_floor_rmse": _columns(validation.horizon.noise_floor),
        },
        "recovered_gain": None
        if validation.recovered is None
        else {
            "gain": validation.recovered.gain,
            "delay_samples": validation.recovered.delay,
            "r_squared": validation.recovered.r_squared,
        },
    }


def as_json(results: Mapping[str, object]) -> str:
    """Return results as JSON text: arrays as lists, what is not finite as null."""
    return json.dumps(_plain(results), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def by_state(values: NDArray[np.float64]) -> dict[str, float]:
    """Return ten values by the states' names."""
    return dict(zip(STATE_NAMES, values.tolist(), strict=True))


def _errors(pair: ErrorPair) -> dict[str, object]:
    lower, upper = pair.ratio_interval()
    return {
        "with_friction": by_state(pair.with_friction.error),
        "without_friction": by_state(pair.without_friction.error),
        "rmse_with_friction": by_state(pair.with_friction.rmse),
        "rmse_without_friction": by_state(pair.without_friction.rmse),
        "ratio": by_state(pair.ratio),
        "ratio_interval": {name: [lower[i], upper[i]] for i, name in enumerate(STATE_NAMES)},
        "runs": pair.runs,
        "samples": int(pair.with_friction.samples.sum()),
    }


def _columns(values: NDArray[np.float64]) -> dict[str, list[float]]:
    return {name: values[:, index].tolist() for index, name in enumerate(STATE_NAMES)}


def _controller(study: Study) -> dict[str, object]:
    poles = study.design.poles
    return {
        "gain": study.design.gain,
        "poles": [[pole.real, pole.imag] for pole in poles.tolist()],
        "sample_time": study.design.sample_time,
        "compensation": study.chosen.compensation,
    }


def _comparison(study: Study) -> dict[str, object]:
    entries: dict[str, object] = {}
    for name in study.comparison.scores:
        summary = study.comparison.summary(name)
        entries[name] = {
            "peak_position_error": summary.peak_position_error,
            "worst_position_error": summary.worst_position_error,
            "rms_position_error": summary.rms_position_error,
            "rms_torque": summary.rms_torque,
            "rms_torque_change": summary.rms_torque_change,
            "falls": summary.falls,
            "runs": summary.runs,
        }
    entries["plant"] = study.plant
    return entries


def _plain(value: object) -> object:
    """Return what JSON can hold: plain containers, NaN and infinities as None."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(one) for one in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
