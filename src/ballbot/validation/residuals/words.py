"""What the residuals show, in words; each sentence only where its test says so."""

from __future__ import annotations

import numpy as np

from ballbot.log import STATE_NAMES
from ballbot.validation.residuals.analysis import ResidualAnalysis
from ballbot.validation.residuals.correlation import Correlations
from ballbot.validation.residuals.play_effect import EDGES
from ballbot.validation.residuals.whiteness import LEAST_STEPS, Colour, Whiteness

#: chance of a false finding of one test on the wheels
LEVEL = 0.01
#: significant pairs are named where they correlate this strongly
_STRONG, _WEAK = 0.5, 0.15
#: no gearbox has more play than this [rad]
_PLAY = 0.05

#: pairs of residuals that are to be expected, and why
_ROLLING = (
    "the wheels carry the ball along with the leaning body, "
    "and its speed is computed from their speeds and the gyro's"
)
_INTEGRAL = "the on-board position is the integral of the speed, so it contains the error of the speed"
_EXPECTED = {
    frozenset({"e_x_dot", "e_phi_dot"}): _ROLLING,
    frozenset({"e_y_dot", "e_theta_dot"}): _ROLLING,
    frozenset({"e_x", "e_phi_dot"}): _ROLLING,
    frozenset({"e_y", "e_theta_dot"}): _ROLLING,
    frozenset({"e_x", "e_x_dot"}): _INTEGRAL,
    frozenset({"e_y", "e_y_dot"}): _INTEGRAL,
}
#: what the thesis's section 4.2 names besides what kinematics couples (design section 10, item 13)
_THESIS_ONLY = ("e_y_dot", "e_phi_dot")
_KINEMATIC = (("e_x_dot", "e_phi_dot"), ("e_y_dot", "e_theta_dot"))

_COLOURS: dict[Colour, str] = {
    "white": "white",
    "nearly white": "not white by the test, but their past foretells less than 2 % of them",
    "noise of the start": "remember one sample and no more: the noise of the measured state, which two residuals share "
    "with opposite signs, not the model",
    "coloured": "are correlated with their past: a lasting effect is not modelled, or a sensor is filtered",
}


def residual_findings(analysis: ResidualAnalysis) -> list[str]:
    """Return what a model's one-step residuals show, a sentence or two for each question."""
    return [
        *_pairs(analysis.correlations),
        named_pairs(analysis.correlations),
        _whiteness(analysis.whiteness),
        _peaks(analysis),
        *_wheels(analysis),
    ]


def named_pairs(found: Correlations) -> str:
    """Return the pairs that the thesis names beside those that kinematics couples."""

    def described(pair: tuple[str, str]) -> str:
        r, significant = found.between(*pair)
        return f"{pair[0]} with {pair[1]} {r:+.2f}{'' if significant else ' (not significant)'}"

    kinematic = " and ".join(described(pair) for pair in _KINEMATIC)
    return (
        f"The pairs that rolling couples, with opposite signs: {kinematic}. The thesis "
        f"names the first, but in place of the second {described(_THESIS_ONLY)}."
    )


def _pairs(found: Correlations) -> list[str]:
    """Return a sentence on each reason for strong pairs, and one on those without."""
    labels, matrix = found.labels, found.matrix
    expected: dict[str, list[str]] = {}
    unexpected, marked = [], 0
    for i in range(len(STATE_NAMES)):
        for j in range(i + 1, len(labels)):
            marked += int(found.significant[i, j])
            reason = _EXPECTED.get(frozenset({labels[i], labels[j]}))
            pair = f"{labels[i]} with {labels[j]} ({matrix[i, j]:+.2f})"
            if not found.significant[i, j]:
                continue
            if reason and abs(matrix[i, j]) >= _STRONG:
                expected.setdefault(reason, []).append(pair)
            elif not reason and abs(matrix[i, j]) >= _WEAK:
                unexpected.append(pair)
    sentences = [
        f"Residuals that are coupled: {', '.join(pairs)}; {reason}." for reason, pairs in expected.items()
    ]
    tested = len(labels) * len(STATE_NAMES) - len(STATE_NAMES) * (len(STATE_NAMES) + 1) // 2
    marks = f"{marked} of the {tested} pairs of a residual with another or a torque are significant"
    if unexpected:
        return [
            *sentences,
            f"{marks}; unexpected are {', '.join(unexpected)}: something is not modelled.",
        ]
    return [
        *sentences,
        f"{marks}; except for the expected ones none reaches {_WEAK}: nothing unmodelled stands out.",
    ]


def _whiteness(found: Whiteness | None) -> str:
    if found is None:
        return (
            f"There are fewer than {LEAST_STEPS} steps: the log is "
            "too short to test whether the residuals are white."
        )
    parts = []
    for colour, words in _COLOURS.items():
        places = [place for place, one in enumerate(found.colours) if one == colour]
        if not places:
            continue
        names = ", ".join(f"e_{STATE_NAMES[place]}" for place in places)
        foretold = ""
        if colour == "coloured":
            shares = found.foretold[places]
            foretold = f" ({100 * shares.min():.0f} to {100 * shares.max():.0f} % of the variance)"
        parts.append(f"{names}: {words}{foretold}")
    return f"Whiteness. {'; '.join(parts)}."


def _peaks(analysis: ResidualAnalysis) -> str:
    if analysis.spectrum is None:
        return "The log is too short for a spectrum of the residuals."
    if not analysis.peaks:
        return "The spectrum of the residuals has no distinct peak."
    peaks = "; ".join(
        f"{peak.frequency:.1f} Hz in {', '.join(f'e_{name}' for name in peak.states)}: {peak.cause}"
        for peak in analysis.peaks
    )
    return (
        "Peaks of the residuals' spectrum, with a resolution "
        f"of {analysis.spectrum.resolution:.2g} Hz: {peaks}."
    )


def _wheels(analysis: ResidualAnalysis) -> list[str]:
    if analysis.no_wheels is not None:
        return [f"The residuals are not compared with the motion of the wheels: {analysis.no_wheels}."]
    return [_by_speed(analysis), _by_travel(analysis), _by_position(analysis)]


def _by_speed(analysis: ResidualAnalysis) -> str:
    assert analysis.by_speed is not None
    found = []
    for wheel, effect in enumerate(analysis.by_speed, start=1):
        if effect.p_value < LEVEL / len(analysis.by_speed):
            place = effect.largest
            found.append(
                f"wheel {wheel} ({effect.torques[place]:+.3f} ± {effect.half_widths[place]:.3f} N m at "
                f"{effect.speeds[place]:+.2f} rad/s)"
            )
    if any(np.isnan(effect.p_value) for effect in analysis.by_speed):
        return (
            "The wheels returned to the same speeds too seldom "
            "to show how the residual torque depends on them."
        )
    if not found:
        return "The residual torque does not depend on the wheel speeds: the friction law fits at all speeds."
    return (
        f"The residual torque depends on the speed of {', '.join(found)}: the friction law is wrong "
        "there by as much. Torque along the motion means that there is less friction than in the model."
    )


def _by_travel(analysis: ResidualAnalysis) -> str:
    effect = analysis.by_travel
    if effect is None or np.isnan(effect.p_value):
        return "The wheels reversed too seldom to detect play."
    if not effect.p_value < LEVEL:
        return (
            "After a reversal of a wheel, its speed explains the "
            "whole residual torque: there is no sign of play."
        )
    place = effect.clearest
    torque = (
        f"After a reversal a torque of {effect.torques[place]:+.3f} ± {effect.half_widths[place]:.3f} N m along the "
        "motion is not modelled, clearest"
    )
    turned = np.degrees((0.0, *EDGES)[place : place + 2])
    where = f"{torque} {turned[0]:.1f} to {turned[1]:.1f} degrees of the wheel after it"
    if EDGES[place] > _PLAY:
        return f"{where}: too far for play."
    return f"{where}: play of the gearbox, or friction that gives way before it slips."


def _by_position(analysis: ResidualAnalysis) -> str:
    effect = analysis.by_position
    if effect is None:
        return f"Torque ripple over the turn of the wheels is not examined: {analysis.no_position}."
    places = np.argwhere(effect.significant)
    if len(places) == 0:
        return "The wheels show no torque ripple: no residual torque recurs with a turn or a fraction of one."
    by_order: dict[int, list[str]] = {}
    for place, wheel in places:
        by_order.setdefault(int(effect.orders[place]), []).append(
            f"wheel {wheel + 1} {effect.amplitudes[place, wheel]:.3f} N m"
        )
    words = "; ".join(
        f"{order} times a turn{_of_rollers(order, effect.per_row)} ({', '.join(wheels)})"
        for order, wheels in by_order.items()
    )
    passing = ""
    if analysis.roller_passing is not None and any(order % effect.per_row == 0 for order in by_order):
        slow, _, fast = analysis.roller_passing
        passing = f" At these speeds the rollers of a ring pass {slow:.1f} to {fast:.1f} times per second."
    return f"A residual torque recurs with the angles of the wheels: {words}.{passing}"


def _of_rollers(order: int, per_row: int) -> str:
    if order == 1:
        return ", an eccentric wheel"
    return f", the rollers' passing ({per_row} in a ring)" if order % per_row == 0 else ", torque ripple"
