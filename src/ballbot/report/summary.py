"""The report's first words: what a study found, in sentences."""

from __future__ import annotations

import numpy as np

from ballbot.experiments.study import Study
from ballbot.report.tables import digits
from ballbot.robot import Robot
from ballbot.validation.findings import better_in, weak_states


def summary(study: Study) -> list[tuple[str, str]]:
    """Return what was found as (heading, sentence or two) pairs, the most important first."""
    return [
        ("Friction", friction_sentence(study.found.robot)),
        ("Model", model_sentence(study)),
        ("Compensation", compensation_sentence(study)),
        ("Doubts", doubts_sentence(study)),
    ]


def friction_sentence(robot: Robot) -> str:
    """Return the friction in words: what a wheel takes to start and to turn, and what rolling takes."""
    friction = robot.friction
    dry = np.array(friction.coulomb)
    start = dry + np.array(friction.stribeck)
    rolling = (robot.ball.mass + robot.body.mass) * robot.gravity * friction.rolling
    return (
        f"A wheel breaks away at {_range(start)} N m; faster than about {digits(friction.stribeck_speed, 2)} rad/s it "
        f"turns against {_range(dry)} N m and another {_range(np.array(friction.viscous))} N m for each rad/s. Rolling "
        f"on the floor takes {digits(rolling, 2)} N "
        f"(C_rr = {digits(friction.rolling, 2)})."
    )


def model_sentence(study: Study) -> str:
    """Return how much better the model with friction foretells what was held out."""
    validation = study.validation
    horizon = validation.horizon
    at_end = np.median(horizon.ratio[-1])
    sentence = (
        f"On {validation.duration:.0f} s of the logs that it was not fitted to, {horizon.horizons[-1]:.2g} s ahead, "
        f"the error of the model with this friction is {_compared(float(at_end))} of the one without (median of "
        "the states)"
    )
    if validation.open_loop is None:
        return f"{sentence}. No open-loop verdict: {validation.no_open_loop}"
    over_runs = better_in(validation.open_loop.errors, validation.models)
    return " ".join([f"{sentence}. Over open-loop runs until a fall, {over_runs}.", *weak_states(validation)])


def compensation_sentence(study: Study) -> str:
    """Return what compensating the friction gains, on what, and where it fell."""
    none = study.comparison.summary("none")
    chosen = study.chosen.compensation
    best = study.comparison.summary(chosen)
    where = "the model with this friction" if study.plant == "model" else "the physics-engine twin"
    falls = sum(study.comparison.summary(name).falls for name in study.comparison.scores)
    runs = sum(study.comparison.summary(name).runs for name in study.comparison.scores)
    fell = "No run fell." if falls == 0 else f"{falls} of {runs} runs fell."
    if chosen == "none":
        return f"On {where}, no compensation does better than none; {fell[0].lower()}{fell[1:]}"
    gain = none.peak_position_error / best.peak_position_error
    return (
        f"Around a 0.5 m square on {where}, {chosen} compensation lowers the largest distance from the reference after "
        f"settling from {digits(none.peak_position_error, 2)} m to {digits(best.peak_position_error, 2)} m, "
        f"{gain:.1f} times. {fell} controller.toml holds this controller."
    )


def doubts_sentence(study: Study) -> str:
    """Return the first of the identification's remarks and how many there are, or what it was nearest to remark."""
    warnings = study.found.warnings
    if warnings:
        more = len(warnings) - 1
        return warnings[0] + (
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
