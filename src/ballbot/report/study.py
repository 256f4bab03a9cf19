"""A study's report.html: its summary in sentences, and one page that opens anywhere, needs no network, and prints."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.presets import design_integral_gain
from ballbot.errors import InputError
from ballbot.findings import texts
from ballbot.identification.coulomb import coulomb_sentence
from ballbot.identification.result import represents_sentence
from ballbot.log import STATE_NAMES
from ballbot.mechanics.model import Model
from ballbot.report.comparison import RUN_LABELS, paths_figure, poles_figure, position_error_figure
from ballbot.report.friction import friction_figure, logs_figure
from ballbot.report.page import Provenance, figure_markup, render
from ballbot.report.prediction import predicted_rows
from ballbot.report.style import drawn
from ballbot.report.tables import (
    CANDIDATE_NAMES,
    STATE_WORDS,
    ablation_rows,
    candidate_rows,
    digits,
    has_confidence,
    interval_words,
    millimetres,
    parameter_rows,
    state_mark,
    with_symbols,
)
from ballbot.report.validation import validation_values
from ballbot.report.validation_figures import correlation_figure
from ballbot.robot import Friction, Robot
from ballbot.robot.figure import robot_figure
from ballbot.validation.result import better_in, weak_states
from ballbot.viewer import replay_part
from ballbot.workflows.controller_choice import ControllerChoice
from ballbot.workflows.metrics import SETTLE
from ballbot.workflows.study import Study
from ballbot.workflows.twin_rolling import TwinRolling


def summary(study: Study) -> list[tuple[str, str]]:
    """Return the results as (heading, sentences) pairs, the most important first."""
    return [
        ("Friction", friction_sentence(study.found.robot)),
        ("Model", model_sentence(study)),
        ("Controller", controller_sentence(study)),
        ("Where the gain comes from", ablation_sentence(study)),
        ("Doubts", doubts_sentence(study)),
    ]


def friction_sentence(robot: Robot) -> str:
    """Return the friction in words: of a wheel at rest and in motion, by direction and load, and of rolling."""
    friction = robot.friction
    dry = np.array(friction.coulomb)
    start = dry + np.array(friction.stribeck)
    return (
        f"The break-away torque of a wheel is {_range(start)} N m. Above about {digits(friction.stribeck_speed, 2)} "
        f"rad/s its friction is {_range(dry)} N m plus {_range(np.array(friction.viscous))} N m per rad/s. "
        f"{_friction_terms_words(friction)}The rolling friction of the ball is {digits(robot.rolling_force, 2)} N "
        f"(C_rr = {digits(friction.rolling, 2)})."
    )


def _friction_terms_words(friction: Friction) -> str:
    """Return the terms by direction and load in words; empty without such terms."""
    words = []
    for name, values in (("Coulomb", friction.coulomb_asymmetry), ("Stribeck", friction.stribeck_asymmetry)):
        if any(values):
            words.append(
                f"Forward, the {name} torque differs by {_range(np.array(values))} N m from this mean of both "
                "directions. "
            )
    if any(friction.load):
        words.append(f"Each N m of motor torque adds {_range(np.array(friction.load))} N m of dry friction. ")
    return "".join(words)


def model_sentence(study: Study) -> str:
    """Return how much better the model with friction predicts the held-out data."""
    validation = study.validation
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
    choice, where = study.choice, plants_words(study)
    chosen, gain = choice.chosen, choice.gain
    if chosen is None or gain is None:
        falls = ", ".join(f"{name} in {trial.falls}" for name, trial in choice.trials.items())
        return (
            f"Every candidate falls on some of {where} ({falls} of {len(choice.plants)}), so that no controller.toml "
            "is written. Check the robot file's masses, torque limit and delay, or try ballbot design --robust."
        )
    best = choice.trials[chosen]
    others = [CANDIDATE_NAMES[name] for name in choice.equals if name != chosen]
    equal = f" It is the smoothest of those that count as equal ({', '.join(others)})." if others else ""
    if chosen == "none":
        return (
            f"The nominal gain without compensation: on {where}, no other candidate that never falls has a clearly "
            f"smaller peak error. {_falls_words(study)}{equal} {PREDICTION}"
        )
    none = choice.trials["none"]
    compared = (
        f" instead of {millimetres(none.peak.median)} mm (medians), {digits(gain.median)} times smaller "
        f"({interval_words(gain)})"
        if gain.runs
        else " (median)"
    )
    return (
        f"{CANDIDATE_NAMES[chosen][0].upper()}{CANDIDATE_NAMES[chosen][1:]}, "
        f"with {STATE_WORDS[best.controller.estimator]}: "
        f"around a 0.5 m square on {where}, the largest distance from the reference after settling is "
        f"{millimetres(best.peak.median)} mm{compared}. "
        f"{_falls_words(study)}{equal} {PREDICTION}"
    )


#: the status of a result that is not measured yet
PREDICTION = "This is a prediction until a log of the robot confirms it."


def plants_words(study: Study) -> str:
    """Return the plants on which the candidates were compared."""
    kind = "robots on the equations of motion" if study.plant == "model" else "physics-engine twins"
    return (
        f"{len(study.choice.plants)} {kind} drawn from the identified uncertainty, with the delay, play, noise and "
        f"floor of the scenario {study.scenario.name}"
    )


def _falls_words(study: Study) -> str:
    falls = {name: trial.falls for name, trial in study.choice.trials.items() if trial.falls}
    if not falls:
        return "No run fell."
    named = ", ".join(f"{CANDIDATE_NAMES[name]} in {count}" for name, count in falls.items())
    return f"Excluded because they fall: {named} of {len(study.choice.plants)} runs."


def ablation_sentence(study: Study) -> str:
    """Return how much each part of the precise controller gains by itself."""
    choice = study.choice
    if not choice.ablation:
        return "No ablation was made."
    whole_falls = choice.trials["precise"].falls
    if whole_falls:
        return f"The precise controller itself falls on {whole_falls} of {len(choice.plants)} plants."
    shares = {part: choice.share_of(part) for part in choice.ablation}
    falling = [part for part in shares if choice.ablation[part].falls]
    rest = sorted((part for part in shares if part not in falling), key=lambda part: -shares[part].median)
    words = [f"Without its {part} the precise controller falls." for part in falling]
    words += [
        f"Without {part} its peak error is {digits(shares[part].median, 2)} times as large."
        for part in rest
        if has_confidence(shares[part]) and shares[part].low > 1.0
    ]
    words += [
        f"Without {part} it is smaller on this course ({digits(shares[part].median, 2)} times), and the torques are "
        f"{_rougher(choice, part)}."
        for part in rest
        if has_confidence(shares[part]) and shares[part].high < 1.0
    ]
    unclear = [
        part
        for part in rest
        if not has_confidence(shares[part]) or shares[part].low <= 1.0 <= shares[part].high
    ]
    if unclear:
        words.append(f"No clear difference on this course: {', '.join(unclear)}.")
    return " ".join(words)


def _rougher(choice: ControllerChoice, part: str) -> str:
    """Return how rough the torques are without a part, compared with the whole controller on the same plants."""
    without = choice.ablation[part]
    whole = np.median(
        [one.rms_torque_change for one in choice.trials["precise"].scores[: len(without.scores)]]
    )
    ratio = without.roughness.median / float(whole)
    if 0.95 < ratio < 1.05:  # 1.0 in two digits
        return "as rough"
    return f"{digits(1.0 / ratio, 2)} times smoother" if ratio < 1.0 else f"{digits(ratio, 2)} times rougher"


def doubts_sentence(study: Study) -> str:
    """Return the first of the identification's findings and their number, or the largest correlation without any."""
    warnings = study.found.warnings
    if warnings:
        more = len(warnings) - 1
        return warnings[0].text + (
            f" {more} more are listed under what the data do not determine." if more else ""
        )
    correlation = np.nan_to_num(np.triu(study.found.correlation, 1))
    first, second = np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape)
    labels = study.found.labels
    return (
        "No parameter is at a bound or undetermined. The two that the logs separate least are "
        f"{labels[first]} and {labels[second]} (correlation {correlation[first, second]:+.2f})."
    )


def _range(values: np.ndarray) -> str:
    lower, upper = digits(float(values.min()), 2), digits(float(values.max()), 2)
    return lower if lower == upper else f"{lower} to {upper}"


def _compared(ratio: float) -> str:
    """Return an error by the ratio of the other's to it: 2.0 times smaller than that, the same as that, ..."""
    if f"{ratio:.1f}" == "1.0":
        return "about the same as that"
    return (
        f"{ratio:.1f} times smaller than that" if ratio > 1.0 else f"{1.0 / ratio:.1f} times larger than that"
    )


_CONTENTS = (
    ("robot", "Robot"),
    ("logs", "Logs"),
    ("friction", "Friction"),
    ("doubts", "What the data do not determine"),
    ("validation", "Validation"),
    ("controller", "Controller"),
    ("comparison", "Comparison"),
    ("prediction", "Prediction"),
    ("log-checks", "Checks of the logs"),
    ("provenance", "Provenance"),
)


def study_report(study: Study, made: Provenance) -> str:
    """Return the report of a study as HTML."""
    values: dict[str, object] = {
        "title": f"{study.robot.name}: friction, model and controller",
        "lead": _lead(study),
        "summary": [(heading, with_symbols(words)) for heading, words in summary(study)],
        "contents": [entry for entry in _CONTENTS if study.prediction or entry[0] != "prediction"],
        "made": made,
        "log_findings": study.log_findings,
        "wheel_count": study.robot.wheel_count,
        "robot_words": robot_words(study.robot),
        "log_words": _log_words(study),
        "parameters": parameter_rows(study.found),
        "represents": f"{represents_sentence(study.found.layout)} {coulomb_sentence(study.found.coulomb)}",
        "warnings": [with_symbols(warning.text) for warning in study.found.warnings],
        "doubts": with_symbols(doubts_sentence(study)),
        "validation_words": _validation_words(study),
        "v": validation_values(study.validation, example_of=study.logs[0].name),
        "controller_words": _controller_words(study),
        "states": [state_mark(name) for name in STATE_NAMES],
        "gain": [[f"{value + 0.0:.3f}" for value in row] for row in np.round(_shown(study).gain, 3)],
        "poles_words": _poles_words(study),
        "comparison_words": _comparison_words(study),
        "candidates": candidate_rows(study.choice),
        "ablation": ablation_rows(study.choice),
        "ablation_plants": min(study.options.ablation_draws, len(study.choice.plants)),
        "ablation_words": ablation_sentence(study),
        "choice_words": controller_sentence(study),
        "prediction_rows": predicted_rows(study.prediction) if study.prediction else [],
        "prediction_words": _prediction_words(study),
    }
    return render("study", values | _figures(study) | _replay(study))


def _replay(study: Study) -> dict[str, object]:
    """Return the runs without compensation and with the chosen controller as a replay, if they can be shown."""
    choice = study.choice
    shown = {RUN_LABELS[name]: choice.runs[name] for name in dict.fromkeys(("none", choice.chosen or "none"))}
    try:
        part = replay_part(shown, study.found.robot)
    except InputError:  # a run that fell at once, or a course that is too long for a page
        return {"replay": "", "replay_style": "", "replay_script": ""}
    return {
        "replay": figure_markup(part.element),
        "replay_style": figure_markup(part.style),
        "replay_script": figure_markup(part.script),
    }


def _prediction_words(study: Study) -> str:
    course = study.choice.course
    return (
        f"Record {course.duration:g} s of the {course.name} with this controller and run `ballbot validate "
        "--prediction results.json LOG`: it reports whether each quantity lies in its interval, ranks likely causes "
        "if not, and recommends to keep the controller, to weaken it, or to go back to previous_controller.toml."
    )


def robot_words(robot: Robot) -> str:
    """Return the robot in a sentence or two."""
    body, ball, wheels = robot.body, robot.ball, robot.wheels
    pole = float(Model(robot).linearize().poles()[0].real)
    return (
        f"{robot.name} has {robot.wheel_count} omni-wheels of {1e3 * wheels.radius:.0f} mm radius on a ball of "
        f"{1e3 * ball.radius:.0f} mm radius and {digits(ball.mass)} kg; its body weighs {digits(body.mass)} kg with "
        f"the centre of mass {1e3 * body.center_of_mass:.0f} mm above the ball's centre. Left alone it falls at "
        f"{pole:.2f} rad/s, twice as far every {1e3 * np.log(2.0) / pole:.0f} ms."
    )


def _figures(study: Study) -> dict[str, object]:
    found, runs = study.found, study.choice.runs
    frictionless = study.robot.replace(friction=Friction.none(study.robot.wheel_count))
    open_loop_poles = Model(frictionless).linearize().poles()
    draw = {
        "robot_figure": partial(robot_figure, study.robot),
        "logs_figure": partial(logs_figure, study.logs),
        "friction_figure": partial(friction_figure, found, study.logs),
        "parameter_correlation_figure": partial(
            correlation_figure, _parameter_symbols(found.labels), found.correlation
        ),
        "poles_figure": partial(poles_figure, open_loop_poles, _closed_loop_poles(study)),
        "paths_figure": partial(paths_figure, runs),
        "position_error_figure": partial(position_error_figure, runs),
    }
    return {name: figure_markup(drawn(make, name=name.replace("_", "-"))) for name, make in draw.items()}


def _parameter_symbols(labels: tuple[str, ...]) -> list[str]:
    special = {"v_s": "$v_s$", "delta": r"$\delta$", "C_rr": "$C_{rr}$"}
    return [special.get(label, f"${label[0]}_{{{label[1:]}}}$") for label in labels]


def _lead(study: Study) -> str:
    names = ", ".join(one.name for one in study.logs)
    seconds = sum(float(one.log.t[-1] - one.log.t[0]) for one in study.logs)
    return f"A study of {seconds:.0f} s of balancing in {_count(len(study.logs), 'log')}: {names}."


def _log_words(study: Study) -> str:
    rate = 1.0 / study.logs[0].log.sample_time
    held = sum(end - start for one in study.logs for start, end in one.held_out)
    seconds = sum(float(one.log.t[-1] - one.log.t[0]) for one in study.logs)
    return (
        f"{_count(len(study.logs), 'log').capitalize()} of {seconds:.0f} s in "
        f"all at {rate:.0f} Hz. The friction was fitted to {seconds - held:.0f} "
        f"s of them; the shaded {held:.0f} s were held out and validate it below."
    )


def _validation_words(study: Study) -> str:
    return (
        f"The model is compared with the {study.validation.duration:.0f} s that it was not fitted "
        "to, with the identified friction and without any, so every difference between the two "
        "is due to friction. In closed loop without restarts the whole logs are compared."
    )


def _shown(study: Study) -> Controller:
    """Return the chosen controller; without one, the nominal one."""
    return study.choice.controller or study.choice.trials["none"].controller


def _closed_loop_poles(study: Study) -> NDArray[np.complex128]:
    if study.choice.chosen != "precise":
        return study.design.poles
    chosen = _shown(study)
    return design_integral_gain(chosen.robot, sample_time=chosen.sample_time).poles


def _controller_words(study: Study) -> str:
    chosen = _shown(study)
    words = (
        "The gain is the linear-quadratic regulator of the exact model without friction, sampled at "
        f"{1e3 * chosen.sample_time:g} ms, "
    )
    if study.choice.chosen == "precise":
        words += (
            "with the stiff weights and the integral action of the precise controller; shaped references with "
            "feed-forward, friction compensation, a disturbance observer and a lean limit are added."
        )
    else:
        words += "with the weights of the nominal scenario: Q = diag(20, 20, 500, 500, 5, 30, 30, 20, 20, 2), R = 30."
    if chosen.compensation != "none":
        words += (
            " It compensates the friction that is present with 95 % confidence: more would inject energy if the robot "
            "has less."
        )
    words += f" It feeds back {STATE_WORDS[chosen.estimator]}, as its file states."
    recovered = study.validation.recovered
    if recovered is not None:
        scale = np.abs(study.design.gain).max()
        far = float(np.abs(recovered.gain - study.design.gain).max() / scale)
        same = (
            "the nominal one"
            if far < 0.01
            else f"not the nominal one: entries differ by up to {100 * far:.0f} % of the nominal gain's largest entry"
        )
        words += f" The gain that {study.logs[0].name} was recorded with is {same}."
    return words


def _poles_words(study: Study) -> str:
    slowest = float(-_closed_loop_poles(study)[0].real)
    return (
        f"Poles of the model without friction, by itself and with this gain. The slowest pole, "
        f"{slowest:.2f} rad/s, makes the robot settle in about {4.0 / slowest:.0f} s."
    )


def _comparison_words(study: Study) -> str:
    where = plants_words(study)
    return (
        f"Each candidate drives {where}, once around a square of 0.5 m by steps in "
        f"{study.choice.course.duration:.0f} s, all with the same seeds. Full compensation adds each wheel's whole "
        "friction; partial adds it only while it works against the intended motion. A candidate that falls on any "
        "plant is excluded; of those whose intervals overlap the best one's, the smoothest is chosen. Errors are those "
        f"of the true position from {SETTLE:.0f} s after a step on.{_rolling_words(study.rolling)}"
    )


def _rolling_words(rolling: TwinRolling | None) -> str:
    if rolling is None or rolling.added == 0.0:
        return ""
    if np.isnan(rolling.added):
        return (
            f" The floor of the twins has the identified C_rr {rolling.identified:.3g}. It contains losses of the "
            "rollers, which the twins have as well, so the errors may be too large: the twin's own losses could not "
            "be identified from its log."
        )
    return (
        f" The identified C_rr {rolling.identified:.3g} contains losses of the rollers, play and noise. The twins have "
        f"these as well, and they add {rolling.added:.2g} to the C_rr of a twin's log. The floor of the twins "
        "therefore has the rest."
    )


def _count(number: int, what: str) -> str:
    words = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}
    return f"{words.get(number, str(number))} {what}{'' if number == 1 else 's'}"
