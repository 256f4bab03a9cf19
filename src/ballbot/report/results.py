"""results.json: what other programs read. The keys named in the project's README stay."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from ballbot.experiments.controller_choice import Trial
from ballbot.experiments.study import Study
from ballbot.report.provenance import Provenance
from ballbot.report.validation_results import validation_results


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
        "findings": identification.pop("findings"),
        "identification": identification,
        "validation": validation,
        "controller": _controller(study),
        "comparison": _comparison(study),
        "prediction": study.prediction.to_dict() if study.prediction else None,
        "provenance": made.to_dict(),
    }


def _controller(study: Study) -> dict[str, object]:
    """Return the chosen controller; its kind is None if every candidate falls on some plant."""
    poles = study.design.poles
    chosen = study.choice.controller
    return {
        "kind": study.choice.chosen,
        "compensation": None if chosen is None else chosen.compensation,
        "estimator": None if chosen is None else chosen.estimator,
        "gain": None if chosen is None else chosen.gain,
        "sample_time": study.design.sample_time,
        "nominal_gain": study.design.gain,
        "nominal_poles": [[pole.real, pole.imag] for pole in poles.tolist()],
    }


def _comparison(study: Study) -> dict[str, object]:
    choice = study.choice
    entries: dict[str, object] = {name: _trial(trial) for name, trial in choice.trials.items()}
    gain = choice.gain
    return entries | {
        "plant": study.plant,
        "scenario": study.scenario.name,
        "draws": len(choice.plants),
        "course": {"name": choice.course.name, "duration": choice.course.duration},
        "chosen": choice.chosen,
        "counted_as_equal": list(choice.equals),
        "gain": None if gain is None else asdict(gain),
        "ablation": {
            part: _trial(trial) | {"ratio": asdict(choice.share_of(part))}
            for part, trial in choice.ablation.items()
        },
    }


def _trial(trial: Trial) -> dict[str, object]:
    """Return a controller's errors [m] and roughness [N m]: medians over the plants with 95 % intervals."""
    peaks = trial.peaks[np.isfinite(trial.peaks)]
    return {
        "estimator": trial.controller.estimator,
        "peak_position_error": trial.peak.median,
        "peak_position_error_interval": [trial.peak.low, trial.peak.high],
        "worst_position_error": float(peaks.max()) if len(peaks) else np.nan,
        "rms_position_error": trial.rms.median,
        "rms_torque_change": trial.roughness.median,
        "falls": trial.falls,
        "runs": len(trial.scores),
    }
