"""A study in sentences, and its page: robot, friction, model, controller and prediction, the sentences first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from ballbot.control.controller import torque_limit_words
from ballbot.errors import InputError, every
from ballbot.findings import texts
from ballbot.log import STATE_NAMES
from ballbot.mechanics.model import Model
from ballbot.report.blocks import Bullets, Film, Paragraph, Report, Section, Sheet, section
from ballbot.report.comparison import RUN_LABELS, paths_figure, position_error_series
from ballbot.report.identification import friction_sentence, log_blocks, open_labels, parameter_blocks
from ballbot.report.prediction import predicted_rows
from ballbot.report.provenance import Provenance
from ballbot.report.stiffness import interval_words, stiffness_section, stiffness_sentences, too_few
from ballbot.report.style import drawn_picture
from ballbot.report.validation import undecided_by, validation_sections
from ballbot.report.words import logs_words, millimetres, state_mark, with_symbols
from ballbot.robot import Robot
from ballbot.rounding import digits
from ballbot.summary import counted
from ballbot.twin.imperfections import left_out
from ballbot.validation.result import better_in, model_findings, weak_states
from ballbot.viewer import replay_part
from ballbot.workflows.controller_choice import CANDIDATES, ControllerChoice, Step, Trial
from ballbot.workflows.controller_prediction import MIN_RUNS
from ballbot.workflows.metrics import SETTLE
from ballbot.workflows.study import Study
from ballbot.workflows.twin_confirmation import Confirmation

#: candidates and on-board states in words
_CANDIDATE_NAMES = {
    "none": "nominal, no compensation",
    "full": "nominal, full compensation",
    "partial": "nominal, partial compensation",
    "precise": "precise",
    "precise_without_compensation": "precise without compensation",
}
_STATE_WORDS = {"onboard": "the on-board state by integration", "kalman": "the Kalman filter's state"}
#: the status of a result that is not measured yet
_PREDICTION = "This is a prediction until a log of the robot confirms it."


def summary(study: Study) -> list[tuple[str, str]]:
    """Return the results as (heading, sentences) pairs, the most important first."""
    contradiction = study.confirmation.contradiction if study.confirmation else None
    return [
        *([("Contradiction", contradiction)] if contradiction else []),
        ("Friction", friction_sentence(study.found)),
        ("Model", model_sentence(study)),
        ("Controller", controller_sentence(study)),
        ("Second opinion", confirmation_sentence(study.confirmation)),
        *([("Where friction matters", stiffness_sentences(study.stiffness))] if study.stiffness else []),
        ("Doubts", doubts_sentence(study)),
    ]


def confirmation_sentence(confirmation: Confirmation | None) -> str:
    """Return what the candidates did on the twin, beside the loop."""
    if confirmation is None:
        return "The choice was not confirmed on the physics-engine twin."
    course = confirmation.course
    words = []
    for name, twin in confirmation.on_twin.items():
        loop = confirmation.on_loop[name]
        words.append(f"{_CANDIDATE_NAMES[name]} {_reached(twin)} ({_reached(loop)} on the compiled loop)")
    runs = counted(len(next(iter(confirmation.on_twin.values())).scores), "run")
    return (
        f"On the physics-engine twin, {course.duration:g} s of the {course.name}, median peak error over {runs} each: "
        f"{every(words)}."
    )


def model_sentence(study: Study) -> str:
    """Return how much better the model with friction predicts the held-out data."""
    validation = study.validation
    if validation.no_evidence is not None:
        return validation.no_evidence
    horizon = validation.horizon.errors
    at_end = np.median(horizon.ratio[-1])
    sentence = (
        f"On {validation.duration:.0f} s of held-out logs, predicted {horizon.horizons[-1]:.2g} s ahead, "
        f"the error of the model with this friction is {_compared(float(at_end))} of the one without (median of "
        "the states)"
    )
    if validation.open_loop is None:
        return f"{sentence}. No open-loop verdict: {validation.no_open_loop}"
    over_runs = better_in(validation.open_loop.errors, validation.models)
    return " ".join(
        [f"{sentence}. Over open-loop runs until a fall, {over_runs}.", *texts(weak_states(validation))]
    )


def controller_sentence(study: Study) -> str:
    """Return the chosen controller, its gain, its plants, and that this is a prediction."""
    choice, where = study.choice, _plants_words(study)
    chosen, gain = choice.chosen, choice.gain
    if chosen is None or gain is None:
        falls = ", ".join(f"{name} in {trial.falls}" for name, trial in choice.trials.items())
        return (
            f"Every candidate falls on some of {where} ({falls} of {len(choice.plants)}), so that no controller.toml "
            "is written. Check the robot file's masses, torque limit and delay, or try ballbot design --robust."
        )
    best = choice.trials[chosen]
    others = [_CANDIDATE_NAMES[name] for name in choice.equals if name != chosen]
    equal = f" It is the smoothest of those that count as equal ({', '.join(others)})." if others else ""
    few = (
        f" {too_few(len(choice.plants))} how certain this choice is." if len(choice.plants) < MIN_RUNS else ""
    )
    more = f"{_falls_words(study)}{equal}{few}{_compensated_words(choice)} {_PREDICTION}"
    if chosen == "none":
        return (
            f"The nominal gain without compensation: on {where}, no other candidate that never falls has a clearly "
            f"smaller peak error. {more}"
        )
    none = choice.trials["none"]
    compared = (
        f" instead of {millimetres(none.peak.median)} mm with the soft gain alone (medians), "
        f"{digits(gain.median)} times smaller ({interval_words(gain)})"
        if gain.runs
        else " (median)"
    )
    return (
        f"{_CANDIDATE_NAMES[chosen][0].upper()}{_CANDIDATE_NAMES[chosen][1:]}, "
        f"with {_STATE_WORDS[best.controller.estimator]}: "
        f"around a 0.5 m square on {where}, the largest distance from the reference after settling is "
        f"{millimetres(best.peak.median)} mm{compared}.{_soft_words(choice)} {more}"
    )


def _soft_words(choice: ControllerChoice) -> str:
    """Return what compensation alone makes of the soft gain's error, beside a precise controller; empty if it falls."""
    if CANDIDATES[choice.chosen or "none"][0] == "nominal":
        return ""
    reached = [
        f"{millimetres(choice.trials[name].peak.median)} mm with {name} compensation"
        for name in ("full", "partial")
        if choice.trials[name].falls == 0
    ]
    if not reached:
        return ""
    return f" The soft gain reaches {' and '.join(reached)}; the rest is the precise controller's."


def _compensated_words(choice: ControllerChoice) -> str:
    """Return the best candidate that compensates beside a chosen one that does not; empty if there is no such."""
    chosen, other = choice.chosen, choice.compensated
    if chosen is None or other is None or choice.trials[chosen].controller.compensation != "none":
        return ""
    own, with_it = choice.trials[chosen], choice.trials[other]
    return (
        f" The best that compensates friction, {_CANDIDATE_NAMES[other]}, is compensated_controller.toml: "
        f"{millimetres(with_it.peak.median)} mm, its torques {_rougher(own, with_it)}."
    )


def _plants_words(study: Study) -> str:
    """Return the robots on which the candidates were compared."""
    return (
        f"{len(study.choice.plants)} simulated robots drawn from the identified uncertainty, with the delay, play, "
        f"noise and floor of the scenario {study.scenario.name}"
    )


def _falls_words(study: Study) -> str:
    falls = {name: trial.falls for name, trial in study.choice.trials.items() if trial.falls}
    if not falls:
        return "No run fell."
    named = ", ".join(f"{_CANDIDATE_NAMES[name]} in {count}" for name, count in falls.items())
    return f"Excluded because they fall: {named} of {len(study.choice.plants)} runs."


def _reached(trial: Trial) -> str:
    """Return the peak error, and the falls if there are any."""
    peak = f"{millimetres(trial.peak.median)} mm" if trial.peak.runs else "none"
    return f"{peak} with {counted(trial.falls, 'fall')}" if trial.falls else peak


def _rougher(one: Trial, other: Trial) -> str:
    """Return how rough the other's torques are, compared with one's."""
    ratio = other.roughness.median / one.roughness.median
    if 0.95 < ratio < 1.05:  # 1.0 in two digits
        return "as rough"
    return f"{digits(1.0 / ratio, 2)} times smoother" if ratio < 1.0 else f"{digits(ratio, 2)} times rougher"


def doubts_sentence(study: Study) -> str:
    """Return the first of the identification's findings and their number, or what is least certain without any."""
    warnings = study.found.findings
    if warnings:
        more = len(warnings) - 1
        return warnings[0].text + (
            f" {more} more are listed under what the data do not determine." if more else ""
        )
    correlation = np.nan_to_num(np.triu(study.found.correlation, 1))
    first, second = np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape)
    labels = study.found.labels
    unlimited = ", ".join(open_labels(study.found.another_log))
    other_log = f" From another log, any value of {unlimited} must be expected." if unlimited else ""
    return (
        f"No parameter is at a bound.{other_log} The two that the logs separate least are "
        f"{labels[first]} and {labels[second]} (correlation {correlation[first, second]:+.2f})."
    )


def _compared(ratio: float) -> str:
    """Return an error by the ratio of the other's to it: 2.0 times smaller than that, the same as that, ..."""
    if f"{ratio:.1f}" == "1.0":
        return "about the same as that"
    return (
        f"{ratio:.1f} times smaller than that" if ratio > 1.0 else f"{1.0 / ratio:.1f} times larger than that"
    )


def study_report(study: Study, made: Provenance) -> Report:
    """Return the page of a study."""
    warnings = texts(study.found.findings)
    found = [with_symbols(text) for text in texts(model_findings(study.validation))]
    return Report(
        title=f"{study.robot.name}: friction, model and controller",
        lead=f"A study of {logs_words({one.name: one.log for one in study.logs})}.",
        verdict=summary(study),
        sections=[
            section(
                "The robot and its logs",
                Paragraph(text=f"{_robot_words(study.robot)} {_log_words(study)}"),
                *log_blocks(study.logs),
            ),
            section("Friction found", *parameter_blocks(study.found, study.logs)),
            section("How good the model is", Bullets(items=found)),
            *validation_sections(study.validation),
            *_controller_sections(study),
        ],
        undecided=[*(warnings or [doubts_sentence(study)]), *undecided_by(study.validation), _PREDICTION],
        made=made,
        findings=study.log_findings,
    )


def _robot_words(robot: Robot) -> str:
    """Return the robot in a sentence or two."""
    body, ball, wheels = robot.body, robot.ball, robot.wheels
    pole = float(Model(robot).linearize().poles()[0].real)
    return (
        f"{robot.name} has {robot.wheel_count} omni-wheels of {1e3 * wheels.radius:.0f} mm radius on a ball of "
        f"{1e3 * ball.radius:.0f} mm radius and {digits(ball.mass)} kg; its body weighs {digits(body.mass)} kg with "
        f"the centre of mass {1e3 * body.center_of_mass:.0f} mm above the ball's centre. Without control its "
        f"lean doubles every {1e3 * np.log(2.0) / pole:.0f} ms (unstable pole {pole:.2f} rad/s)."
    )


def _log_words(study: Study) -> str:
    held = sum(end - start for one in study.logs for start, end in one.held_out)
    seconds = sum(float(one.log.t[-1] - one.log.t[0]) for one in study.logs)
    return (
        f"The friction was fitted to {seconds - held:.0f} s of the logs, at "
        f"{1.0 / study.logs[0].log.sample_time:.0f} Hz; the shaded {held:.0f} s were held out, and the model with and "
        "without the friction is validated on them. In closed loop without restarts the whole logs are compared."
    )


def _controller_sections(study: Study) -> Iterator[Section]:
    """Yield the controller, why it was chosen, and what its next log should show."""
    choice = study.choice
    controller = choice.controller or choice.trials["none"].controller
    gain = (np.round(controller.gain, 3) + 0.0).tolist()
    yield section(
        "The controller",
        Sheet(
            headings=("wheel", *(state_mark(name) for name in STATE_NAMES)),
            rows=[
                (str(wheel), *(f"{value:.3f}" for value in row)) for wheel, row in enumerate(gain, start=1)
            ],
            caption=(
                "Gain K of u = K S(ψ) (r − x) [N m per m, rad, m/s, rad/s]. Torque limit of each wheel: "
                f"{torque_limit_words(controller)}."
            ),
        ),
        _recovered_paragraph(study),
    )
    yield section(
        "Why this controller",
        Paragraph(text=_comparison_words(study)),
        _candidate_sheet(choice),
        _replay(study),
        drawn_picture(
            "paths",
            partial(paths_figure, choice.runs),
            "Path over the floor on the first robot. Dot: start. Broad: the reference.",
        ),
        position_error_series(choice.runs, "Distance from the reference over time on the first robot."),
    )
    if study.confirmation:
        yield section(
            "A second opinion: the physics-engine twin",
            _confirmation_sheet(study.confirmation),
        )
    if study.steps:
        yield section("Where the gain comes from", _step_sheet(study.steps, choice.course.name))
    if study.stiffness:
        yield stiffness_section(study.stiffness)
    if study.prediction is not None:
        yield section(
            "What the next log should show",
            Paragraph(text=_prediction_words(study)),
            Sheet(
                headings=("quantity", "predicted", "95 % interval", "soft gain, no compensation"),
                rows=predicted_rows(study.prediction),
                caption="Each interval holds the value of one new run with 95 % probability.",
            ),
        )
    elif choice.chosen is not None:
        need = f"A prediction needs {MIN_RUNS} simulated robots or more; these were {len(choice.plants)}."
        yield section("What the next log should show", Paragraph(text=need))


def _recovered_paragraph(study: Study) -> Paragraph | None:
    """Return how the gain that the first log was recorded with differs from the nominal one, if it is known."""
    recovered = study.validation.recovered
    if recovered is None:
        return None
    far = float(np.abs(recovered.gain - study.design.gain).max() / np.abs(study.design.gain).max())
    same = (
        "is the nominal one"
        if far < 0.01
        else f"differs from the nominal one by up to {100 * far:.0f} % of its largest entry"
    )
    return Paragraph(text=f"The gain that “{study.logs[0].name}” was recorded with {same}.")


def _comparison_words(study: Study) -> str:
    return (
        f"Each candidate drives {_plants_words(study)}, once around a square of 0.5 m by steps in "
        f"{study.choice.course.duration:.0f} s, all with the same seeds. A candidate that falls on any robot is "
        "excluded; of those whose intervals overlap the best one's, the smoothest is chosen. The loop leaves "
        f"out: {every(left_out(study.scenario, identified=True))}."
    )


def _candidate_sheet(choice: ControllerChoice) -> Sheet:
    """Return the candidates' errors, roughness and falls."""
    first, rows = choice.trials["none"], []
    for name, trial in choice.trials.items():
        worst = float(np.nan_to_num(trial.peaks, nan=-np.inf).max())
        rows.append(
            (
                _CANDIDATE_NAMES[name],
                {"onboard": "integration", "kalman": "Kalman filter"}[trial.controller.estimator],
                millimetres(trial.peak.median),
                f"{millimetres(trial.peak.low)} – {millimetres(trial.peak.high)}",
                *(millimetres(worst), millimetres(trial.rms.median)),
                "–" if name == "none" else f"{digits(first.ratio_to(trial).median)} ×",
                *(digits(trial.roughness.median), f"{trial.falls} of {len(trial.scores)}"),
            )
        )
    caption = (
        f"Distance from the reference from {SETTLE:.0f} s after the start and each corner on: medians over the robots, "
        "with 95 % intervals of the median. Roughness: the RMS change of the torques from sample to sample."
    )
    headings = (
        *("controller", "on-board state", "peak [mm]", "95 % interval", "worst [mm]", "rms [mm]"),
        *("peak smaller by", "roughness [N m]", "falls"),
    )
    return Sheet(headings=headings, rows=rows, caption=caption)


def _confirmation_sheet(confirmation: Confirmation) -> Sheet:
    rows = []
    for name, twin in confirmation.on_twin.items():
        for on, trial in (("twin", twin), ("loop", confirmation.on_loop[name])):
            peaks = trial.peaks[np.isfinite(trial.peaks)]
            spread = f" ({millimetres(peaks.min())} – {millimetres(peaks.max())})" if len(peaks) else ""
            rows.append(
                (
                    *(_CANDIDATE_NAMES[name], on, str(len(trial.scores))),
                    f"{millimetres(trial.peak.median)}{spread}",
                    millimetres(trial.rms.median),
                    *(digits(trial.roughness.median), str(trial.falls)),
                )
            )
    headings = ("controller", "on the", "runs", "peak [mm]", "rms [mm]", "roughness [N m]", "falls")
    caption = (
        "The twin has rollers, contacts and slip, which the loop lacks. The identified rolling friction contains what "
        "rollers take, so that its errors are rather too large. Medians, in brackets the smallest and the largest."
    )
    return Sheet(headings=headings, rows=rows, caption=caption)


def _step_sheet(steps: Mapping[Step, tuple[Trial, Trial]], course: str) -> Sheet:
    """Return what each step from the soft gain to the precise controller does; the candidates ran on `course`."""
    rows = []
    for step, (before, after) in steps.items():
        ratio = before.ratio_to(after)
        rows.append(
            (
                *(step.adds, step.to, step.course.name if step.course else course),
                *(millimetres(one.peak.median) if one.peak.runs else "–" for one in (before, after)),
                f"{digits(ratio.median)} ({digits(ratio.low)} – {digits(ratio.high)})" if ratio.runs else "–",
                f"{digits(before.roughness.median)} and {digits(after.roughness.median)}",
                f"{before.falls} and {after.falls} of {len(before.scores)}",
                effect_of(before, after),
            )
        )
    headings = (
        *("added", "to", "course", "before [mm]", "after [mm]", "before / after", "roughness [N m]", "falls"),
        "reading",
    )
    caption = (
        "Each row compares two controllers that differ in one thing; what it gains depends on what else the controller "
        "has. Medians over the simulated robots, and of the ratio of the peak errors with its 95 % interval."
    )
    return Sheet(headings=headings, rows=rows, caption=caption)


def effect_of(before: Trial, after: Trial) -> str:
    """Return what a change does on the same plants, by its falls and the 95 % interval of the ratio of peak errors."""
    ratio = before.ratio_to(after)
    if before.falls != after.falls:
        return "needed: falls without" if before.falls > after.falls else "falls with it"
    if ratio.runs < MIN_RUNS:
        return "too few robots to tell"
    if ratio.low > 1.0:
        return "lowers the error"
    return "raises the error" if ratio.high < 1.0 else "no clear difference"


def _replay(study: Study) -> Film | None:
    """Return the runs without compensation and with the chosen controller as a replay, if they can be shown."""
    choice = study.choice
    shown = {RUN_LABELS[name]: choice.runs[name] for name in dict.fromkeys(("none", choice.chosen or "none"))}
    try:
        part = replay_part(shown, study.found.robot, colors=("orange", "blue"))
    except InputError:  # a run that fell at once, or a course that is too long for a page
        return None
    which = " and with the chosen controller" if len(shown) > 1 else ""
    caption = (
        f"The first robot's run without compensation{which}, with the friction found. Drag to orbit; the plots' time "
        "cursor can be dragged, too."
    )
    return Film(part=part, caption=caption)


def _prediction_words(study: Study) -> str:
    course = study.choice.course
    return (
        f"Record {course.duration:g} s of the {course.name} with this controller and run `ballbot validate "
        "--prediction results.json LOG`: it says whether the prediction is confirmed, by how much not and what "
        "else differs from the logs, and recommends to keep the controller, to weaken it, or to go back to "
        "previous_controller.toml."
    )
