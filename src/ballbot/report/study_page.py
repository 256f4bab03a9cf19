"""A study's report.html: one page that opens anywhere, needs no network and no script, and prints."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.presets import design_integral_gain
from ballbot.experiments.metrics import SETTLE
from ballbot.experiments.study import Study
from ballbot.log import STATE_NAMES
from ballbot.mechanics.model import Model
from ballbot.report.comparison_figures import paths_figure, poles_figure, position_error_figure
from ballbot.report.friction_figures import friction_figure, logs_figure
from ballbot.report.page import figure_markup, render
from ballbot.report.prediction_page import predicted_rows
from ballbot.report.provenance import Provenance
from ballbot.report.style import drawn
from ballbot.report.summary import (
    ablation_sentence,
    controller_sentence,
    doubts_sentence,
    plants_words,
    summary,
)
from ballbot.report.tables import (
    STATE_WORDS,
    ablation_rows,
    candidate_rows,
    digits,
    parameter_rows,
    state_mark,
    with_symbols,
)
from ballbot.report.validation_figures import correlation_figure
from ballbot.report.validation_page import validation_values
from ballbot.robot import Friction, Robot
from ballbot.robot.figure import robot_figure

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
        "warnings": [with_symbols(warning) for warning in study.found.warnings],
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
        "ablation_plants": min(study.effort.ablation_draws, len(study.choice.plants)),
        "ablation_words": ablation_sentence(study),
        "choice_words": controller_sentence(study),
        "prediction_rows": predicted_rows(study.prediction) if study.prediction else [],
        "prediction_words": _prediction_words(study),
    }
    return render("study", values | _figures(study))


def _prediction_words(study: Study) -> str:
    course = study.choice.course
    return (
        f"Record {course.duration:g} s of the {course.name} with this controller and run `ballbot validate "
        "--prediction results.json LOG`: it says of each quantity whether it lies in its interval, ranks likely causes "
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
    words += f" It feeds back {STATE_WORDS[chosen.estimator]}, and its file says so."
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
        f"of the true position from {SETTLE:.0f} s after a step on."
    )


def _count(number: int, what: str) -> str:
    words = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}
    return f"{words.get(number, str(number))} {what}{'' if number == 1 else 's'}"
