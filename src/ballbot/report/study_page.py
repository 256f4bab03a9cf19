"""The page of a study: robot, friction, model, controller and prediction, the sentences of its summary first."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller, torque_limit_words
from ballbot.control.lqr import frictionless_model
from ballbot.control.presets import design_integral_gain
from ballbot.errors import InputError, every
from ballbot.findings import texts
from ballbot.identification.coulomb import coulomb_sentence
from ballbot.identification.result import represents_sentence
from ballbot.log import STATE_NAMES
from ballbot.mechanics.model import Model
from ballbot.report.blocks import Bullets, Film, Paragraph, Report, Section, Sheet, Subheading, section
from ballbot.report.comparison import RUN_LABELS, paths_figure, position_error_series
from ballbot.report.friction import log_blocks, parameter_blocks, search_blocks
from ballbot.report.loop import poles_figure
from ballbot.report.prediction import predicted_rows
from ballbot.report.provenance import Provenance
from ballbot.report.stiffness import stiffness_section
from ballbot.report.study import (
    PREDICTION,
    confirmation_sentence,
    controller_sentence,
    doubts_sentence,
    plants_words,
    steps_sentence,
    summary,
)
from ballbot.report.style import drawn_picture
from ballbot.report.tables import (
    CANDIDATE_NAMES,
    STATE_WORDS,
    STEP_HEADINGS,
    candidate_rows,
    parameter_sheet,
    step_rows,
)
from ballbot.report.validation_page import undecided_by, validation_sections
from ballbot.report.words import logs_words, millimetres, state_mark, with_symbols
from ballbot.robot import Robot
from ballbot.robot.figure import robot_figure
from ballbot.rounding import digits
from ballbot.twin.imperfections import left_out
from ballbot.validation.result import model_findings
from ballbot.viewer import replay_part
from ballbot.workflows.controller_prediction import MIN_RUNS
from ballbot.workflows.metrics import SETTLE
from ballbot.workflows.study import Study
from ballbot.workflows.twin_confirmation import Confirmation, TwinRolling


def study_report(study: Study, made: Provenance) -> Report:
    """Return the page of a study."""
    warnings = texts(study.found.findings)
    return Report(
        title=f"{study.robot.name}: friction, model and controller",
        lead=_lead(study),
        verdict=summary(study),
        sections=[
            _robot_section(study),
            _friction_section(study),
            section(
                "How good the model is",
                Paragraph(text=_validation_words(study)),
                Bullets(items=_found_of(study)),
            ),
            *validation_sections(study.validation, example_of=_example_words(study)),
            _controller_section(study),
            *_comparison_sections(study),
            *_prediction_sections(study),
        ],
        undecided=[*(warnings or [doubts_sentence(study)]), *undecided_by(study.validation), PREDICTION],
        made=made,
        findings=study.log_findings,
    )


def _found_of(study: Study) -> list[str]:
    return [with_symbols(text) for text in texts(model_findings(study.validation))]


def _example_words(study: Study) -> str:
    return study.logs[0].name if len(study.logs) == 1 else "the first log that allows it"


def _robot_section(study: Study) -> Section:
    drawing = "The robot to scale. The body appears as the two discs that have its mass and inertia."
    return section(
        "The robot and its logs",
        Paragraph(text=robot_words(study.robot)),
        drawn_picture("robot", partial(robot_figure, study.robot), drawing),
        Paragraph(text=_log_words(study)),
        *log_blocks(study.logs),
    )


def _friction_section(study: Study) -> Section:
    found = study.found
    words = (
        "A wheel at speed ω resists with b ω + (c + s exp(−|ω/v_s|^δ)) sgn ω, the ball on the floor with C_rr times "
        "the weight. Standard errors and the first 95 % interval contain the variation between logs; the second "
        "interval is for the estimate from another log of this robot; open: no limit within the bounds."
    )
    return section(
        "Friction found",
        Paragraph(text=words),
        Paragraph(text=represents_sentence(found.names)),
        Paragraph(text=coulomb_sentence(found.coulomb, found.names)),
        parameter_sheet(found),
        *parameter_blocks(found, study.logs),
        Subheading(text="How the search went"),
        *search_blocks(found),
    )


def _controller_section(study: Study) -> Section:
    open_loop_poles = frictionless_model(study.robot).linearize().poles()
    draw = partial(poles_figure, open_loop=open_loop_poles, closed_loop=_closed_loop_poles(study))
    gain = [[f"{value + 0.0:.3f}" for value in row] for row in np.round(_shown(study).gain, 3)]
    return section(
        "The controller",
        Paragraph(text=_controller_words(study)),
        Sheet(
            headings=("wheel", *(state_mark(name) for name in STATE_NAMES)),
            rows=[(str(wheel), *row) for wheel, row in enumerate(gain, start=1)],
            caption="Gain K of u = K S(ψ) (r − x) [N m per m, rad, m/s, rad/s].",
        ),
        drawn_picture("poles", draw, _poles_words(study)),
    )


def _comparison_sections(study: Study) -> Iterator[Section]:
    runs = study.choice.runs
    caption = (
        f"Distance from the reference once settled: {SETTLE:.0f} s after the start and after each corner. Medians "
        "over the simulated robots, with 95 % intervals of the median; roughness is the RMS change of the torques from "
        "sample to sample."
    )
    headings = (
        *("controller", "on-board state", "peak [mm]", "95 % interval", "worst [mm]", "rms [mm]"),
        *("peak smaller by", "roughness [N m]", "falls"),
    )
    rows = [
        (
            one.name,
            one.estimator,
            one.peak,
            one.interval,
            one.worst,
            one.rms,
            one.gain,
            one.roughness,
            one.falls,
        )
        for one in candidate_rows(study.choice)
    ]
    over_time = "Distance from the reference over time on the first robot."
    yield section(
        "Why this controller",
        Paragraph(text=controller_sentence(study)),
        Paragraph(text=_comparison_words(study)),
        Sheet(headings=headings, rows=rows, caption=caption),
        _replay(study),
        drawn_picture(
            "paths",
            partial(paths_figure, runs),
            "Path over the floor on the first robot. Dot: start. Broad: the reference.",
        ),
        position_error_series(runs, over_time),
    )
    if study.confirmation:
        yield _confirmation_section(study.confirmation)
    if study.steps:
        course = study.choice.course.name
        yield section(
            "Where the gain comes from",
            Paragraph(text=steps_sentence(study.steps, course)),
            Sheet(headings=STEP_HEADINGS, rows=step_rows(study.steps, course), caption=_STEPS_CAPTION),
        )
    if study.stiffness:
        yield stiffness_section(study.stiffness)


def _confirmation_section(confirmation: Confirmation) -> Section:
    headings = ("controller", "on the", "runs", "peak [mm]", "rms [mm]", "roughness [N m]", "falls")
    caption = (
        "The twin has rollers, contacts and slip, which the loop lacks. Medians, in brackets the smallest and the "
        "largest."
    )
    return section(
        "A second opinion: the physics-engine twin",
        Paragraph(text=confirmation_sentence(confirmation)),
        Sheet(headings=headings, rows=list(_confirmation_rows(confirmation)), caption=caption),
        Paragraph(text=_rolling_words(confirmation.rolling)),
    )


def _confirmation_rows(confirmation: Confirmation) -> Iterator[tuple[str, ...]]:
    for name, twin in confirmation.on_twin.items():
        for on, trial in (("twin", twin), ("loop", confirmation.on_loop[name])):
            peaks = trial.peaks[np.isfinite(trial.peaks)]
            spread = f" ({millimetres(peaks.min())} – {millimetres(peaks.max())})" if len(peaks) else ""
            yield (
                *(CANDIDATE_NAMES[name], on, str(len(trial.scores))),
                f"{millimetres(trial.peak.median)}{spread}" if len(peaks) else "–",
                millimetres(trial.rms.median) if len(peaks) else "–",
                *(digits(trial.roughness.median), str(trial.falls)),
            )


_STEPS_CAPTION = (
    "Each row compares two controllers that differ in one thing; what it gains depends on what else the controller "
    "has. Medians over the simulated robots, and of the ratio of the peak errors with its 95 % interval."
)


def _prediction_sections(study: Study) -> Iterator[Section]:
    if study.prediction is None:
        if study.choice.chosen is not None:
            need = f"A prediction needs {MIN_RUNS} simulated robots or more; these were {len(study.choice.plants)}."
            yield section("What the next log should show", Paragraph(text=need))
        return
    caption = (
        "Each interval holds the value of one new run with 95 % probability, on a robot with faults like those that "
        "the intervals were calibrated on."
    )
    yield section(
        "What the next log should show",
        Paragraph(text=_prediction_words(study)),
        Sheet(
            headings=("quantity", "predicted", "95 % interval", "soft gain, no compensation"),
            rows=predicted_rows(study.prediction),
            caption=caption,
        ),
    )


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


def robot_words(robot: Robot) -> str:
    """Return the robot in a sentence or two."""
    body, ball, wheels = robot.body, robot.ball, robot.wheels
    pole = float(Model(robot).linearize().poles()[0].real)
    return (
        f"{robot.name} has {robot.wheel_count} omni-wheels of {1e3 * wheels.radius:.0f} mm radius on a ball of "
        f"{1e3 * ball.radius:.0f} mm radius and {digits(ball.mass)} kg; its body weighs {digits(body.mass)} kg with "
        f"the centre of mass {1e3 * body.center_of_mass:.0f} mm above the ball's centre. Without control its "
        f"lean doubles every {1e3 * np.log(2.0) / pole:.0f} ms (unstable pole {pole:.2f} rad/s)."
    )


def _lead(study: Study) -> str:
    return f"A study of {logs_words({one.name: one.log for one in study.logs})}."


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
    chosen = _shown(study)
    if chosen.parts.integral is None:
        return study.design.poles
    return design_integral_gain(chosen.robot, sample_time=chosen.sample_time).poles


def _controller_words(study: Study) -> str:
    chosen = _shown(study)
    words = (
        "The gain is the linear-quadratic regulator of the exact model without friction, sampled at "
        f"{1e3 * chosen.sample_time:g} ms, "
    )
    if chosen.parts.integral is not None:
        words += (
            "with the stiff weights and the integral action of the precise controller; shaped references with "
            "feed-forward, a disturbance observer and a lean limit are added."
        )
    else:
        words += "with the weights of the nominal scenario: Q = diag(20, 20, 500, 500, 5, 30, 30, 20, 20, 2), R = 30."
    if chosen.compensation == "none":
        words += " It compensates no friction."
    else:
        words += (
            " It compensates the friction that is present with 95 % confidence: more would inject energy if the "
            "robot has less."
        )
    words += f" It feeds back {STATE_WORDS[chosen.estimator]}, as its file states."
    words += f" Torque limit of each wheel: {torque_limit_words(chosen)}."
    recovered = study.validation.recovered
    if recovered is not None:
        scale = np.abs(study.design.gain).max()
        far = float(np.abs(recovered.gain - study.design.gain).max() / scale)
        same = (
            "the nominal one"
            if far < 0.01
            else f"not the nominal one: entries differ by up to {100 * far:.0f} % of the nominal gain's largest entry"
        )
        words += f" The gain that “{study.logs[0].name}” was recorded with is {same}."
    return words


def _poles_words(study: Study) -> str:
    slowest = float(-_closed_loop_poles(study)[0].real)
    return (
        f"Poles of the model without friction, by itself and with this gain. The slowest pole, whose real part is "
        f"−{slowest:.2f} rad/s, makes the robot settle in about {4.0 / slowest:.0f} s."
    )


def _comparison_words(study: Study) -> str:
    where = plants_words(study)
    return (
        f"Each candidate drives {where}, once around a square of 0.5 m by steps in "
        f"{study.choice.course.duration:.0f} s, all with the same seeds. Full compensation adds each wheel's whole "
        "friction; partial adds it only while it works against the intended motion. A candidate that falls on any "
        "robot is excluded; of those whose intervals overlap the best one's, the smoothest is chosen. Errors are "
        f"those of the true position from {SETTLE:.0f} s after a step on. The loop leaves "
        f"out: {every(left_out(study.scenario, identified=True))}."
    )


def _rolling_words(rolling: TwinRolling) -> str:
    if rolling.added == 0.0:
        return "The floor of the twins has the identified rolling friction."
    if np.isnan(rolling.added):
        return (
            f"The floor of the twins has the identified C_rr {rolling.identified:.3g}. It contains losses of the "
            "rollers, which the twins have as well, so the errors may be too large: the twin's own losses could not "
            "be identified from its log."
        )
    return (
        f"The identified C_rr {rolling.identified:.3g} contains losses of the rollers, play and noise. The twins "
        f"have these as well, and they add {rolling.added:.2g} to the C_rr of a twin's log. The floor of the twins "
        "therefore has the remainder."
    )


def _count(number: int, what: str) -> str:
    words = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}
    return f"{words.get(number, str(number))} {what}{'' if number == 1 else 's'}"
