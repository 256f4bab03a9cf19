"""Analysis of a model's one-step residuals, and the findings: each is stated only where its test is significant.

Correlation, whiteness and spectrum are in `ballbot.validation.statistics`, the
dependence on the wheels' motion in `ballbot.validation.wheel_effects`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, note
from ballbot.log import STATE_NAMES
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step
from ballbot.validation.prediction import Prediction
from ballbot.validation.statistics import (
    LEAST_STEPS,
    Clues,
    Colour,
    Correlations,
    NamedPeak,
    Spectrum,
    Updates,
    Whiteness,
    blocks_of,
    correlations,
    lagged,
    named_peaks,
    slices,
    spectrum,
    whiteness,
)
from ballbot.validation.wheel_effects import (
    TRAVEL_EDGES,
    PlayEffect,
    PositionEffect,
    SpeedEffect,
    play_effect,
    position_effect,
    speed_effect,
    wheel_torque_residuals,
)

#: errors are clustered over this [s]
_BLOCK = 0.25
#: fewer blocks give no result for the wheels
LEAST_BLOCKS = 80
#: a speed so many rows earlier shares no noise with the residual
_EARLIER = 3
#: a turn back by less than so many encoder steps, and by less than this [rad], is noise
_STEPS, _LEAST_TURN = 3.0, 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualAnalysis:
    """Analyses of a model's residuals; None if the log is too short or lacks a column."""

    correlations: Correlations
    whiteness: Whiteness | None
    spectrum: Spectrum | None
    peaks: tuple[NamedPeak, ...]  #: of the spectrum
    updates: Updates
    by_speed: tuple[SpeedEffect, ...] | None  #: by wheel
    by_travel: PlayEffect | None
    by_position: PositionEffect | None
    roller_passing: (
        NDArray[np.float64] | None
    )  #: (3,) [Hz] of a ring, at 10, 50 and 90 % of the wheels' speeds
    no_wheels: str | None  #: why the wheels' speed and travel are not analysed
    no_position: str | None  #: why their position is not analysed


def analyse_residuals(prediction: Prediction, model: Model, updates: Updates) -> ResidualAnalysis:
    """Ask the residuals of a prediction by `model` everything that its log allows."""
    columns = np.hstack([prediction.residuals, prediction.torques])
    no_wheels = _no_wheels(prediction)
    by_speed, by_travel, by_position, no_position = None, None, None, no_wheels
    if no_wheels is None:
        torques = wheel_torque_residuals(prediction, model)
        blocks = _blocks(prediction)
        by_speed, by_travel = _motion_effects(prediction, torques, blocks, model.robot)
        by_position, no_position = _position_effect_of_log(prediction, torques, blocks, model.robot)
    turning = _wheel_turning(prediction)
    orders = () if by_position is None else by_position.found
    clues = Clues(updates=updates, turning=turning, rollers=model.robot.wheels.rollers, orders=orders)
    of_all = spectrum(prediction.residuals, prediction.segments, sample_time=prediction.sample_time)
    return ResidualAnalysis(
        correlations=correlations(columns, prediction.labels, prediction.segments),
        whiteness=whiteness(prediction.residuals, prediction.segments),
        spectrum=of_all,
        peaks=named_peaks(of_all, clues) if of_all else (),
        updates=updates,
        by_speed=by_speed,
        by_travel=by_travel,
        by_position=by_position,
        roller_passing=None if turning is None else model.robot.wheels.rollers.per_row * turning,
        no_wheels=no_wheels,
        no_position=no_position,
    )


def _blocks(prediction: Prediction) -> NDArray[np.int64]:
    return blocks_of(prediction.segments, length=max(1, round(_BLOCK / prediction.sample_time)))


def _no_wheels(prediction: Prediction) -> str | None:
    if prediction.wheel_angles is None or prediction.wheel_speeds is None:
        return "the log lacks the encoder angles or speeds"
    # a log of N rows has N - 1 steps, and lasts as long as it has rows
    seconds = (len(prediction.residuals) + len(prediction.segments)) * prediction.sample_time
    least = LEAST_BLOCKS * _BLOCK
    if seconds < least - 0.5 * prediction.sample_time:
        return f"{seconds:.4g} s are too short; at least {least:.0f} s are needed"
    return None


def _motion_effects(
    prediction: Prediction, torques: NDArray[np.float64], blocks: NDArray[np.int64], robot: Robot
) -> tuple[tuple[SpeedEffect, ...], PlayEffect | None]:
    assert prediction.wheel_angles is not None
    assert prediction.wheel_speeds is not None
    earlier = lagged(prediction.wheel_speeds, prediction.segments, lag=_EARLIER)
    sensors, drive = robot.sensors, robot.drive
    step = encoder_step(encoder_counts=sensors.encoder_counts, gear_ratio=drive.gear_ratio)
    by_speed = tuple(
        speed_effect(torque, speed, blocks) for torque, speed in zip(torques.T, earlier.T, strict=True)
    )
    by_travel = play_effect(
        torques,
        earlier,
        prediction.wheel_angles,
        blocks,
        prediction.segments,
        least_turn=max(_STEPS * step, _LEAST_TURN),
    )
    return by_speed, by_travel


def _position_effect_of_log(
    prediction: Prediction, torques: NDArray[np.float64], blocks: NDArray[np.int64], robot: Robot
) -> tuple[PositionEffect | None, str | None]:
    """Return the effect in the log whose wheels turned furthest, as each log has its own zero, or why it is unknown."""
    angles = prediction.wheel_angles
    assert angles is not None
    where = max(slices(prediction.logs), key=lambda rows: float(np.ptp(angles[rows], axis=0).min()))
    found = position_effect(torques[where], angles[where], blocks[where], rollers=robot.wheels.rollers)
    turned = float(np.ptp(angles[where], axis=0).min()) / (2.0 * np.pi)
    return found, None if found else (
        f"the wheels covered {turned:.2f} of a turn; at least a whole turn is needed"
    )


def _wheel_turning(prediction: Prediction) -> NDArray[np.float64] | None:
    """Return 10 %, 50 % and 90 % of the wheels' speeds (3,) [turns/s]."""
    if prediction.wheel_speeds is None:
        return None
    return np.quantile(np.abs(prediction.wheel_speeds), (0.1, 0.5, 0.9)) / (2.0 * np.pi)


#: chance of a false finding of one test on the wheels
WHEEL_LEVEL = 0.01
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
#: what the thesis's section 4.2 names besides what kinematics couples (its mistake 13)
_THESIS_ONLY = ("e_y_dot", "e_phi_dot")
_KINEMATIC = (("e_x_dot", "e_phi_dot"), ("e_y_dot", "e_theta_dot"))

_COLOURS: dict[Colour, str] = {
    "white": "white",
    "nearly white": "not white by the test, but their past predicts less than 2 % of them",
    "noise of the start": "are correlated with the previous sample only: two successive residuals share the noise of "
    "one measured state, with opposite signs, so this is no error of the model",
    "coloured": "are correlated with their past: a lasting effect is not modelled, or a sensor is filtered",
}


def residual_findings(analysis: ResidualAnalysis) -> list[Finding]:
    """Return the findings from a model's one-step residuals, a sentence or two for each question."""
    sentences = [
        *_pair_findings(analysis.correlations),
        named_pairs(analysis.correlations),
        _whiteness_finding(analysis.whiteness),
        _peak_finding(analysis),
        *_wheel_findings(analysis),
    ]
    return [note("residuals", sentence) for sentence in sentences]


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


def _pair_findings(found: Correlations) -> list[str]:
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
    verb = "is" if marked == 1 else "are"
    marks = f"{marked} of the {tested} pairs of a residual with another or a torque {verb} significant"
    if unexpected:
        return [
            *sentences,
            f"{marks}; unexpected are {', '.join(unexpected)}: something is not modelled.",
        ]
    return [
        *sentences,
        f"{marks}; except for the expected ones none reaches {_WEAK}: nothing unmodelled stands out.",
    ]


def _whiteness_finding(found: Whiteness | None) -> str:
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
        share = ""
        if colour == "coloured":
            shares = found.predicted_share[places]
            ends = dict.fromkeys(f"{100 * end:.0f}" for end in (shares.min(), shares.max()))
            share = f" ({' to '.join(ends)} % of the variance)"
        parts.append(f"{names}: {words}{share}")
    return f"Whiteness. {'; '.join(parts)}."


def _peak_finding(analysis: ResidualAnalysis) -> str:
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


def _wheel_findings(analysis: ResidualAnalysis) -> list[str]:
    if analysis.no_wheels is not None:
        return [f"The residuals are not compared with the motion of the wheels: {analysis.no_wheels}."]
    return [_speed_finding(analysis), _travel_finding(analysis), _position_finding(analysis)]


def _speed_finding(analysis: ResidualAnalysis) -> str:
    assert analysis.by_speed is not None
    found = []
    for wheel, effect in enumerate(analysis.by_speed, start=1):
        if effect.p_value < WHEEL_LEVEL / len(analysis.by_speed):
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


def _travel_finding(analysis: ResidualAnalysis) -> str:
    effect = analysis.by_travel
    if effect is None or np.isnan(effect.p_value):
        return "The wheels reversed too seldom to detect play."
    if not effect.p_value < WHEEL_LEVEL:
        return (
            "After a reversal of a wheel, its speed explains the "
            "whole residual torque: there is no sign of play."
        )
    place = effect.clearest
    torque = (
        f"After a reversal a torque of {effect.torques[place]:+.3f} ± {effect.half_widths[place]:.3f} N m along the "
        "motion is not modelled, clearest"
    )
    turned = np.degrees((0.0, *TRAVEL_EDGES)[place : place + 2])
    where = f"{torque} {turned[0]:.1f} to {turned[1]:.1f} degrees of the wheel after it"
    if TRAVEL_EDGES[place] > _PLAY:
        return f"{where}: too far for play."
    return f"{where}: play of the gearbox, or friction that gives way before it slips."


def _position_finding(analysis: ResidualAnalysis) -> str:
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
