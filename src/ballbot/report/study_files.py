"""The files that a study leaves besides its page: results.json, robot.toml, and controller.toml if one is recommended.

If that compensates no friction, compensated_controller.toml is the best one that does.

results.json is what other programs read; the keys named in the project's README stay. The controller that was there
before stays beside the new one, as previous_controller.toml.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.file import controller_text
from ballbot.errors import InputError
from ballbot.file_formats import without_format
from ballbot.files import LARGEST_SETTINGS, read_text
from ballbot.report.blocks import Column, entries_of
from ballbot.report.validation import validation_results
from ballbot.report.words import millimetres
from ballbot.robot.file import robot_text
from ballbot.workflows.controller_choice import Trial
from ballbot.workflows.stiffness import VARIANTS, FrictionByStiffness
from ballbot.workflows.study import Study
from ballbot.workflows.twin_confirmation import Confirmation

#: candidates in words
CANDIDATE_NAMES = {
    "none": "soft gain",
    "full": "soft gain, full compensation",
    "partial": "soft gain, partial compensation",
    "precise": "precise",
    "precise_without_compensation": "precise without compensation",
}


def study_results(study: Study) -> dict[str, object]:
    """Return what a study's results.json holds; the controller's kind is None if every candidate falls."""
    identification = study.found.to_dict()
    by_log = {one.name: part for one, part in zip(study.logs, study.by_log, strict=True)}
    validation = validation_results(study.validation, by_log)
    validation["held_out"] = {one.name: one.held_out for one in study.logs}
    chosen = study.choice.controller
    return {
        "robot": study.robot.name,
        "parameters": identification.pop("parameters"),
        "standard_errors": identification.pop("standard_errors"),
        "findings": identification.pop("findings"),
        "identification": identification,
        "validation": validation,
        "controller": {
            "kind": study.choice.chosen,
            "compensation": chosen and chosen.compensation,
            "estimator": chosen and chosen.estimator,
            "gain": chosen and chosen.gain,
            "sample_time": study.design.sample_time,
            "nominal_gain": study.design.gain,
            "nominal_poles": study.design.poles,
        },
        "comparison": _comparison(study),
        "prediction": study.prediction,
    }


#: what a study says of each controller's runs: the columns of its table, and the entries of results.json [m, N m]
TRIAL_COLUMNS: tuple[Column[tuple[str, Trial]], ...] = (
    Column("controller", lambda row: CANDIDATE_NAMES[row[0]]),
    Column("peak [mm]", lambda row: row[1].peak.median, millimetres, key="peak_position_error"),
    Column(
        "95 % interval",
        lambda row: [row[1].peak.low, row[1].peak.high],
        lambda ends: " – ".join(map(millimetres, ends)),
        key="peak_position_error_interval",
    ),
    Column(None, lambda row: float(np.fmax.reduce(row[1].peaks)), key="worst_position_error"),
    Column(None, lambda row: row[1].rms.median, key="rms_position_error"),
    Column("roughness [N m]", lambda row: row[1].roughness.median, key="rms_torque_change"),
    Column("falls", lambda row: row[1].falls, key="falls"),
    Column("runs", lambda row: len(row[1].scores), key="runs"),
    Column(None, lambda row: row[1].controller.estimator, key="estimator"),
)


def _trial(trial: Trial) -> dict[str, object]:
    return entries_of(("", trial), TRIAL_COLUMNS)


def _comparison(study: Study) -> dict[str, object]:
    choice = study.choice
    return {
        **{name: _trial(trial) for name, trial in choice.trials.items()},
        "scenario": study.scenario.name,
        "confirmation": study.confirmation and _confirmation(study.confirmation),
        "draws": len(choice.plants),
        "course": choice.course,
        "chosen": choice.chosen,
        "counted_as_equal": choice.equals,
        "gain": choice.gain,
        "compensated": choice.compensated,
        "stiffness": study.stiffness and _stiffness(study.stiffness),
    }


def _confirmation(made: Confirmation) -> dict[str, object]:
    return {
        "course": made.course,
        "contradiction": made.contradiction,
        **{
            name: {"twin": _trial(twin), "loop": _trial(made.on_loop[name])}
            for name, twin in made.on_twin.items()
        },
    }


def _stiffness(found: FrictionByStiffness) -> dict[str, object]:
    """Return the errors of every gain and variant, and the two verdicts as position gains [N m/m]."""
    gains = [
        {
            "position_gain": one.position_gain,
            "compensation": variant.compensation,
            "observer": variant.observer,
            "sensitivity": one.sensitivity,
            **_trial(trial),
        }
        for one in found.gains
        for variant, trial in one.trials.items()
    ]
    verdicts = [
        {
            "observer": plain.observer,
            "stiffest": None if (one := found.stiffest(plain)) is None else one.position_gain,
            "compensation_pays_over": [one.position_gain for one in found.pays_over(observer=plain.observer)],
        }
        for plain in VARIANTS
        if not plain.compensation
    ]
    return {"course": found.course, "gains": gains, "verdicts": verdicts}


#: the files of a study besides results.json and its page
STUDY_FILES = (
    "robot.toml",
    *("controller.toml", "compensated_controller.toml", "previous_controller.toml"),
)

_BASELINE = """\
# The controller without friction compensation: to go back to if the new one does not do what was predicted. This
# folder held no other controller before.
"""


def study_texts(study: Study, before: Path) -> dict[str, str]:
    """Return the texts of a study's files by name; `before` is the folder of an earlier study's."""
    choice, chosen = study.choice, study.choice.controller
    baseline = choice.trials["none"].controller
    texts = {
        "robot.toml": robot_text(study.found.robot),
        "previous_controller.toml": previous_controller_text(before, new=chosen, baseline=baseline),
    }
    if chosen is not None:
        texts["controller.toml"] = controller_text(chosen)
        if choice.compensated is not None and chosen.compensation == "none":
            compensated = choice.trials[choice.compensated].controller
            texts["compensated_controller.toml"] = controller_text(compensated)
    return texts


def previous_controller_text(folder: Path, *, new: Controller | None, baseline: Controller) -> str:
    """Return the text of the previous_controller.toml that a study writes.

    It is the controller.toml that an earlier study left in the folder. If the folder has no such file, or its file is
    the new controller itself (None if the study recommends none), the folder's previous_controller.toml is kept;
    without either it is the baseline, which compensates nothing.
    """
    held = _text(folder / "controller.toml")
    if held is not None and (new is None or without_format(held) != without_format(controller_text(new))):
        return held
    before = _text(folder / "previous_controller.toml")
    return _BASELINE + controller_text(baseline) if before is None else before


def _text(path: Path) -> str | None:
    try:
        return read_text(path, largest=LARGEST_SETTINGS)
    except InputError:  # not there, or no file of ours
        return None
