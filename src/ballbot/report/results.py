"""results.json: what other programs read. The keys named in the project's README stay."""

from __future__ import annotations

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
        "provenance": made.to_dict(),
    }


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
