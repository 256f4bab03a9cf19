"""A study in sentences, its page, and the texts of its files."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot.control.controller import Controller, torque_limit_words
from ballbot.control.file import controller_text
from ballbot.errors import InputError, every
from ballbot.file_formats import without_format
from ballbot.files import LARGEST_SETTINGS, read_text
from ballbot.findings import texts
from ballbot.report.blocks import (
    Animation,
    Block,
    Bullets,
    Column,
    Paragraph,
    Result,
    details,
    entries_of,
    section,
    sheet_of,
)
from ballbot.report.comparison import candidate_name, paths_figure, position_error_series, shown_runs
from ballbot.report.design import gain_sheet
from ballbot.report.identification import friction_sentence, parameter_blocks
from ballbot.report.prediction import predicted_sheet
from ballbot.report.style import drawn_picture
from ballbot.report.validation import model_findings, undecided_by, validation_sections
from ballbot.report.words import capital, logs_words, millimetres
from ballbot.robot.file import robot_text
from ballbot.rounding import digits, interval
from ballbot.summary import counted
from ballbot.twin.imperfections import left_out
from ballbot.viewer import replay_part
from ballbot.workflows.controller_choice import CANDIDATES, Confirmation, ControllerChoice, Trial
from ballbot.workflows.controller_prediction import MIN_RUNS
from ballbot.workflows.metrics import SETTLE
from ballbot.workflows.statistics import MedianEstimate
from ballbot.workflows.study import Study


def next_step(study: Study, path: Callable[[str], str]) -> str:
    """Return what to do with a study's files; `path` returns the path of a file."""
    robot = path("robot.toml")
    if study.choice.controller is None:
        return f"check masses, torque limit and delay of {robot} (`ballbot check {robot}`)."
    controller, results = path("controller.toml"), path("results.json")
    return (
        f"`ballbot run PORT --robot {robot} --controller {controller}`, confirm with `ballbot validate --prediction "
        f"{results} LOG`, `ballbot export` it."
    )


def model_sentence(study: Study) -> str:
    """Return how much better the model with friction predicts the held-out data, if they can show it."""
    validation = study.validation
    if validation.no_evidence is not None:
        return ""
    horizon = validation.horizon
    ratio = digits(float(np.median(horizon.ratio[-1])), 2)
    return (
        f"{horizon.horizons[-1]:.2g} s ahead on {validation.duration:.0f} s held out, the error without friction is "
        f"{ratio} times as large."
    )


def compensation_sentence(choice: ControllerChoice) -> str:
    """Return what compensation gives the soft gain, the thesis's kind."""
    soft = choice.trials["none"]
    standing = [name for name in ("full", "partial") if not choice.trials[name].falls]
    if not standing or not soft.peak.runs:
        return "With the soft gain, a candidate falls on some of the simulated robots, with compensation or without."
    best = min(standing, key=lambda name: choice.trials[name].peak.median)
    trial = choice.trials[best]
    return (
        f"With the soft gain, {best} compensation divides the peak error by {digits(soft.ratio_to(trial).median, 2)}: "
        f"{millimetres(trial.peak.median)} mm instead of {millimetres(soft.peak.median)}."
    )


def controller_sentence(choice: ControllerChoice) -> str:
    """Return the chosen controller, its improvement and the number of simulated robots."""
    chosen, gain = choice.chosen, choice.gain
    robots = f"{len(choice.plants)} simulated robots"
    if chosen is None or gain is None:
        return f"Every candidate falls on some of {robots} ({_falls_words(choice)}): no controller.toml."
    compared = ""
    if chosen != "none" and gain.runs:
        compared = f", {digits(gain.median)} times smaller ({interval_words(gain)})"
    peak = millimetres(choice.trials[chosen].peak.median)
    return f"{capital(candidate_name(chosen))}: {peak} mm{compared}, on {robots}."


def _falls_words(choice: ControllerChoice) -> str:
    runs = len(choice.plants)
    return every(
        [
            f"{candidate_name(name)} in {trial.falls} of {runs}"
            for name, trial in choice.trials.items()
            if trial.falls
        ]
    )


def _reasons(study: Study) -> list[str]:
    """Return why the controller was chosen, and what else was found about the choice."""
    choice, count = study.choice, len(study.choice.plants)
    course = f"once around a square of 0.5 m by steps in {choice.course.duration:.0f} s"
    sentences = [
        f"Each candidate drives {count} robots drawn from the identified uncertainty {course}, with the same seeds and "
        f"the delay, play, noise and floor of the scenario {study.scenario.name}. Left out: "
        f"{every(left_out(study.scenario, identified=not study.found.robot.friction.roller_softness))}.",
        "A candidate that falls on any robot is excluded; of those whose intervals overlap the best one's, the "
        "smoothest is chosen.",
    ]
    if any(trial.falls for trial in choice.trials.values()):
        sentences.append(f"Excluded because they fall: {_falls_words(choice)} runs.")
    if lacking := [candidate_name(name) for name in CANDIDATES if name not in choice.trials]:
        sentences.append(f"This robot cannot have {every(lacking)}; `ballbot design --kind` says why.")
    if others := [candidate_name(name) for name in choice.equals if name != choice.chosen]:
        sentences.append(f"These count as equal: {', '.join(others)}.")
    chosen = choice.controller
    if chosen is not None and choice.compensated is not None and chosen.compensation == "none":
        sentences.append(
            f"The best that compensates friction, {candidate_name(choice.compensated)}, is "
            "compensated_controller.toml."
        )
    return [*sentences, confirmation_sentence(study.confirmation)]


def confirmation_sentence(confirmation: Confirmation | None) -> str:
    """Return what the candidates did on the twin, beside the loop."""
    if confirmation is None:
        return "The choice was not confirmed on the physics-engine twin."
    words = [
        f"{candidate_name(name)} {_reached(twin)} ({_reached(confirmation.on_loop[name])} on the compiled loop)"
        for name, twin in confirmation.on_twin.items()
    ]
    runs = counted(len(next(iter(confirmation.on_twin.values())).scores), "run")
    return (
        f"On the physics-engine twin, {confirmation.course.duration:g} s of the {confirmation.course.name}, median "
        f"peak error over {runs} each: {every(words)}."
    )


def _reached(trial: Trial) -> str:
    """Return the peak error, and the falls if there are any."""
    peak = f"{millimetres(trial.peak.median)} mm" if trial.peak.runs else "none"
    return f"{peak} with {counted(trial.falls, 'fall')}" if trial.falls else peak


def interval_words(estimate: MedianEstimate) -> str:
    """Return a median's 95 % interval in words; with fewer than six values, their range."""
    bounds = interval(estimate.low, estimate.high)
    return f"95 % interval {bounds}" if estimate.runs >= MIN_RUNS else f"{bounds} in {estimate.runs} draws"


def study_report(study: Study) -> Result:
    """Return the page of a study."""
    fit, choice, validation = study.found, study.choice, study.validation
    controller = choice.controller or choice.trials["none"].controller
    limit = Paragraph(f"Torque limit of each wheel: {torque_limit_words(controller)}.")
    why = (Bullets(_reasons(study)), gain_sheet(controller.gain), limit)
    logs = [entry.log for entry in study.logs]
    predicted = ""
    if study.prediction:
        quantity, median, bounds, *_ = predicted_sheet(study.prediction).rows[0]
        predicted = capital(f"{quantity}: {median} ({bounds}).")
    findings = Bullets(model_findings(validation))
    first, *others = validation_sections(validation)
    return Result(
        title=f"{study.robot.name}: friction, model and controller",
        lead=f"{capital(logs_words({entry.name: entry.log for entry in study.logs}))}.",
        verdict=[
            ("Contradiction", (study.confirmation and study.confirmation.contradiction) or ""),
            ("Adequacy", validation.no_evidence or validation.adequacy.sentence),
            ("Friction", friction_sentence(fit)),
            ("Model", model_sentence(study)),
            ("Compensation", compensation_sentence(choice)),
            ("Controller", controller_sentence(choice)),
        ],
        sections=[
            section("The controllers", *_comparison_blocks(study)),
            details("Why this controller", *why, result=_choice_words(choice)),
            details("What the next log should show", *_prediction_blocks(study), result=predicted),
            details("Friction found", *parameter_blocks(fit, logs), result=friction_sentence(fit)),
            replace(first, blocks=(findings, *first.blocks), folded=True),
            *(replace(other, folded=True) for other in others),
        ],
        undecided=[
            *texts(fit.findings),
            *undecided_by(validation),
            "This is a prediction until a log of the robot confirms it.",
        ],
        findings=study.log_findings,
        data=study_results(study),
    )


def _choice_words(choice: ControllerChoice) -> str:
    standing = sum(not trial.falls for trial in choice.trials.values())
    never = f"{standing} of {len(choice.trials)} candidates never fall"
    return f"{never}; the smoothest of {len(choice.equals)} that count as equal." if standing else f"{never}."


def _comparison_blocks(study: Study) -> Iterator[Block | None]:
    """Yield the candidates' paths and errors, and the replay of the soft gain beside the chosen controller."""
    choice, runs = study.choice, shown_runs(study.choice)
    path = "Path over the floor on the first robot. Dot: start. Broad: the reference."
    yield drawn_picture("paths", path, paths_figure, runs)
    caption = (
        f"Largest distance from the reference from {SETTLE:.0f} s after the start and each corner on: medians over the "
        "simulated robots, with their 95 % intervals. Roughness: the RMS change of the torques from sample to sample."
    )
    yield sheet_of(
        choice.trials.items(), _trial_columns(choice.trials["none"]), caption=caption, brief=(0, 1, 2)
    )
    yield position_error_series(runs, "Distance from the reference over time on the first robot.")
    shown = [candidate_name(name) for name in dict.fromkeys(("none", choice.chosen or "none"))]
    try:
        part = replay_part({name: runs[name] for name in shown}, study.found.robot)
    except InputError:  # a run that fell at once, or a course too long for a page
        return
    yield Animation(part, "The first robot with the soft gain and with the chosen controller. Drag to orbit.")


def _prediction_blocks(study: Study) -> Iterator[Block]:
    course, prediction = study.choice.course, study.prediction
    if prediction is None:
        yield Paragraph("A prediction needs a controller.")
        return
    yield Paragraph(
        f"Record {course.duration:g} s of the {course.name} with this controller and run `ballbot validate "
        "--prediction results.json LOG`: it says whether the prediction is confirmed, what else differs from the "
        "logs, and whether to keep the controller, weaken it, or go back to previous_controller.toml."
    )
    yield predicted_sheet(prediction)


def study_results(study: Study) -> dict[str, object]:
    """Return what a study's results.json holds; the controller's kind is None if every candidate falls."""
    identification = study.found.to_dict()
    validation = study.validation.results() | {
        "by_log": {entry.name: part.results() for entry, part in zip(study.logs, study.by_log, strict=True)},
        "held_out": {entry.name: entry.held_out for entry in study.logs},
    }
    choice, chosen, confirmation = study.choice, study.choice.controller, study.confirmation
    return {
        "robot": study.robot.name,
        "parameters": identification.pop("parameters"),
        "standard_errors": identification.pop("standard_errors"),
        "findings": identification.pop("findings"),
        "identification": identification,
        "validation": validation,
        "controller": {
            "kind": choice.chosen,
            "compensation": chosen and chosen.compensation,
            "estimator": chosen and chosen.estimator,
            "gain": chosen and chosen.gain,
            "sample_time": study.design.sample_time,
            "nominal_gain": study.design.gain,
            "nominal_poles": study.design.poles,
        },
        "comparison": {
            **{name: _trial(trial) for name, trial in choice.trials.items()},
            "scenario": study.scenario.name,
            "confirmation": confirmation
            and {
                "course": confirmation.course,
                "contradiction": confirmation.contradiction,
                **{
                    name: {"twin": _trial(twin), "loop": _trial(confirmation.on_loop[name])}
                    for name, twin in confirmation.on_twin.items()
                },
            },
            "draws": len(choice.plants),
            "course": choice.course,
            "chosen": choice.chosen,
            "counted_as_equal": choice.equals,
            "gain": choice.gain,
            "compensated": choice.compensated,
        },
        "prediction": study.prediction,
    }


def _trial_columns(soft: Trial) -> Sequence[Column[tuple[str, Trial]]]:
    """Return the columns on a controller's runs: of the table, and of results.json [m, N m]."""
    return (
        Column("controller", lambda row: candidate_name(row[0])),
        Column("peak [mm]", lambda row: row[1].peak.median, millimetres, key="peak_position_error"),
        Column(
            "95 % interval",
            lambda row: [row[1].peak.low, row[1].peak.high],
            lambda ends: interval(ends[0], ends[1], millimetres),
            key="peak_position_error_interval",
        ),
        Column(
            "smaller by", lambda row: "–" if row[1] is soft else f"{digits(soft.ratio_to(row[1]).median)} ×"
        ),
        Column(None, lambda row: float(np.fmax.reduce(row[1].peaks)), key="worst_position_error"),
        Column(None, lambda row: row[1].rms.median, key="rms_position_error"),
        Column("roughness [N m]", lambda row: row[1].roughness.median, key="rms_torque_change"),
        Column("falls", lambda row: row[1].falls, key="falls"),
        Column("runs", lambda row: len(row[1].scores), key="runs"),
        Column(None, lambda row: row[1].controller.estimator, key="estimator"),
    )


def _trial(trial: Trial) -> dict[str, object]:
    return entries_of(("", trial), _trial_columns(trial))


#: the files of a study besides results.json and its page
STUDY_FILES = ("robot.toml", *("controller.toml", "compensated_controller.toml", "previous_controller.toml"))

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
    except InputError:  # missing or unreadable
        return None
