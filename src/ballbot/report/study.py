"""A study in sentences: its friction, its model, its controller, and what is doubtful."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ballbot.errors import every
from ballbot.findings import texts
from ballbot.fitting.intervals import Interval
from ballbot.identification import Identification
from ballbot.identification.coulomb import SHARE
from ballbot.mechanics.friction import wheel_friction
from ballbot.report.stiffness import stiffness_sentences
from ballbot.report.tables import (
    CANDIDATE_NAMES,
    STATE_WORDS,
    effect_of,
    interval_words,
    too_few,
)
from ballbot.report.words import millimetres
from ballbot.robot import Friction
from ballbot.rounding import digits
from ballbot.summary import counted
from ballbot.validation.result import better_in, weak_states
from ballbot.workflows.controller_choice import CANDIDATES, ControllerChoice, Step, Trial
from ballbot.workflows.controller_prediction import MIN_RUNS
from ballbot.workflows.study import Study
from ballbot.workflows.twin_confirmation import Confirmation


def summary(study: Study) -> list[tuple[str, str]]:
    """Return the results as (heading, sentences) pairs, the most important first."""
    steps = steps_sentence(study.steps, study.choice.course.name)
    contradiction = study.confirmation.contradiction if study.confirmation else None
    return [
        *([("Contradiction", contradiction)] if contradiction else []),
        ("Friction", friction_sentence(study.found)),
        ("Model", model_sentence(study)),
        ("Controller", controller_sentence(study)),
        ("Second opinion", confirmation_sentence(study.confirmation)),
        *([("Where the gain comes from", steps)] if steps else []),
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
        words.append(f"{CANDIDATE_NAMES[name]} {_reached(twin)} ({_reached(loop)} on the compiled loop)")
    runs = counted(len(next(iter(confirmation.on_twin.values())).scores), "run")
    return (
        f"On the physics-engine twin, {course.duration:g} s of the {course.name}, median peak error over {runs} each: "
        f"{every(words)}."
    )


def friction_sentence(found: Identification) -> str:
    """Return the friction in words: of a wheel at rest and in motion, by direction and load, and of rolling."""
    robot = found.robot
    friction = robot.friction
    return (
        f"{_wheel_words(friction, float(found.coulomb.speeds.max()))} {_friction_terms_words(friction)}"
        f"The rolling friction of the ball is {digits(robot.rolling_force, 2)} N "
        f"(C_rr = {digits(friction.rolling, 2)}).{_without_limit(found)}"
    )


def _without_limit(found: Identification) -> str:
    """Return a sentence on the parameters of which any value fits; empty if there are none."""
    labels = _open(found.intervals)
    return f" The logs do not limit {', '.join(labels)}: any value fits." if labels else ""


def _open(intervals: Mapping[str, Interval]) -> list[str]:
    """Return the labels of intervals that leave any value open."""
    return [label for label, one in intervals.items() if np.isinf(one.upper) and not one.lower > 0.0]


def _wheel_words(friction: Friction, fastest: float) -> str:
    """Return a wheel's friction by its law, in the mean of both directions.

    Parameters
    ----------
    friction : Friction
    fastest : float
        Speed that `SHARE` of the logs' speeds stay below [rad/s].
    """
    coulomb, viscous = np.array(friction.coulomb), np.array(friction.viscous)
    if not any(friction.stribeck):
        if not coulomb.any():
            return f"The friction of a wheel is viscous only: {_range(viscous)} N m per rad/s."
        return f"The friction of a wheel is {_range(coulomb)} N m at any speed plus {_range(viscous)} N m per rad/s."
    wheels = len(coulomb)
    shown = {text: float(text) for one in (1.0, fastest) if one <= fastest and (text := digits(one, 2))}
    at_speeds = []
    for text, speed in shown.items():
        forward, backward = (wheel_friction(np.full(wheels, side * speed), friction) for side in (1.0, -1.0))
        at_speeds.append(f"{_range(0.5 * (forward - backward))} N m at {text} rad/s")
    return (
        f"The break-away torque of a wheel is {_range(coulomb + np.array(friction.stribeck))} N m. In motion its "
        f"friction is {' and '.join(at_speeds)}, which {100 * SHARE:.0f} % of the logs' speeds stay below."
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
    few = (
        f" {too_few(len(choice.plants))} how certain this choice is." if len(choice.plants) < MIN_RUNS else ""
    )
    more = f"{_falls_words(study)}{equal}{few}{_compensated_words(choice)} {PREDICTION}"
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
        f"{CANDIDATE_NAMES[chosen][0].upper()}{CANDIDATE_NAMES[chosen][1:]}, "
        f"with {STATE_WORDS[best.controller.estimator]}: "
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
        f" The best that compensates friction, {CANDIDATE_NAMES[other]}, is compensated_controller.toml: "
        f"{millimetres(with_it.peak.median)} mm, its torques {_rougher(own, with_it)}."
    )


#: the status of a result that is not measured yet
PREDICTION = "This is a prediction until a log of the robot confirms it."


def plants_words(study: Study) -> str:
    """Return the robots on which the candidates were compared."""
    return (
        f"{len(study.choice.plants)} simulated robots drawn from the identified uncertainty, with the delay, play, "
        f"noise and floor of the scenario {study.scenario.name}"
    )


def _falls_words(study: Study) -> str:
    falls = {name: trial.falls for name, trial in study.choice.trials.items() if trial.falls}
    if not falls:
        return "No run fell."
    named = ", ".join(f"{CANDIDATE_NAMES[name]} in {count}" for name, count in falls.items())
    return f"Excluded because they fall: {named} of {len(study.choice.plants)} runs."


def steps_sentence(steps: Mapping[Step, tuple[Trial, Trial]], course: str) -> str:
    """Return what each step from the soft gain to the precise controller does to the peak error.

    Parameters
    ----------
    steps : mapping of Step to two Trials
    course : str
        On which the candidates were compared.
    """
    by_change: dict[str, list[str]] = {}
    for step, (before, after) in steps.items():
        if effect_of(before, after) == "too few":
            return f"{too_few(before.ratio_to(after).runs)} where the gain comes from."
        on = step.course.name if step.course else course
        place = "in a hold" if on == "hold" else f"on the {on}"
        change = f"Adding {step.adds} to {step.to} makes the peak error"
        by_change.setdefault(change, []).append(f"{_effect_words(before, after)} {place}")
    words = [f"{change} {every(effects)}." for change, effects in by_change.items()]
    return " ".join([*words, "All this is on simulated robots."]) if words else ""


def _effect_words(before: Trial, after: Trial) -> str:
    """Return what a change makes of the peak error: 3.8 times smaller (377 to 99 mm), for example."""
    effect, ratio = effect_of(before, after), before.ratio_to(after)
    start, end = millimetres(before.peak.median), millimetres(after.peak.median)
    if effect in ("needed", "harmful"):
        return f"{_outcome(after)} instead of {_outcome(before)} in {len(before.scores)} runs"
    if effect == "unclear":
        return f"not clearly different ({start} and {end} mm) and the torques {_rougher(before, after)}"
    times = ratio.median if effect == "smaller" else 1.0 / ratio.median
    return f"{digits(times, 2)} times {effect} ({start} to {end} mm)"


def _reached(trial: Trial) -> str:
    """Return the peak error, and the falls if there are any."""
    return _outcome(trial) if trial.falls else f"{millimetres(trial.peak.median)} mm"


def _outcome(trial: Trial) -> str:
    peak = f"{millimetres(trial.peak.median)} mm" if trial.peak.runs else "none"
    return f"{peak} with {counted(trial.falls, 'fall')}"


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
    unlimited = ", ".join(_open(study.found.another_log))
    other_log = f" From another log, any value of {unlimited} must be expected." if unlimited else ""
    return (
        f"No parameter is at a bound.{other_log} The two that the logs separate least are "
        f"{labels[first]} and {labels[second]} (correlation {correlation[first, second]:+.2f})."
    )


def _range(values: np.ndarray) -> str:
    upper = digits(float(values.max()), 2)
    lower = digits(float(values.min()), 2, beside=float(values.max()))
    return lower if lower == upper else f"{lower} to {upper}"


def _compared(ratio: float) -> str:
    """Return an error by the ratio of the other's to it: 2.0 times smaller than that, the same as that, ..."""
    if f"{ratio:.1f}" == "1.0":
        return "about the same as that"
    return (
        f"{ratio:.1f} times smaller than that" if ratio > 1.0 else f"{1.0 / ratio:.1f} times larger than that"
    )
