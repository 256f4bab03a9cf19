"""What a swing's recording gets wrong: units of the angle and of time, clipped or frozen sensors, another body.

A pendulum's period grows with its amplitude, so that the shape of large swings tells radians from degrees; its
frequency and the lever to its pivot give a radius of gyration, which tells seconds from milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place, by_severity
from ballbot.identification.swing.fit import SwingFit, fits_better_in_degrees
from ballbot.identification.swing.inertia import Pivot, SwingInertia, likely_cause, radius_of_gyration
from ballbot.identification.swing.record import Swing
from ballbot.robot import Robot

#: the radius of gyration over the distance from pivot to centre of mass, of bodies hung at the ball's centre or nearby
_USUAL, _POSSIBLE = (0.15, 1.3), (0.03, 3.0)
#: swings of less do not tell radians from degrees by their shape [rad]
_LARGE = 0.25
#: [rad]; smaller swings rub rather than swing, larger ones are rare
_SMALLEST_SWING, _LARGEST_SWING = math.radians(0.4), math.radians(75.0)
#: the file's inertia may be off by this factor before a finding says so
_LIKE_FILE = 1.25
#: a pendulum that leaves more of the motion than this is not the whole story
_MUCH_LEFT = 0.05
#: rows at the very largest value that make a sensor clipped, as a share; a sine with fine steps has next to none
_CLIPPED = 0.04
#: steps of the sensor's resolution in a swing, from which on rows at the top tell clipping from coarse steps
_FINE = 40
#: of a swing's period: a longer stretch of one and the same value is a sensor that repeats itself
_FROZEN = 0.2


def recording_findings(swing: Swing) -> tuple[Finding, ...]:
    """Return what is wrong with a swing before anything is fitted to it."""
    return tuple(_clipped(swing) or _frozen(swing))


def swing_findings(fit: SwingFit, found: SwingInertia, robot: Robot, pivot: Pivot) -> tuple[Finding, ...]:
    """Return what speaks against a swing's inertia, errors first."""
    return by_severity(
        [*_of_unit(fit), *_of_body(fit, robot, pivot), *_of_file(fit, found, robot), *_of_fit(fit)]
    )


def _clipped(swing: Swing) -> list[Finding]:
    values = swing.values
    levels = np.unique(values)
    if len(levels) < _FINE:
        return []
    shares = {"largest": np.mean(values == values.max()), "least": np.mean(values == values.min())}
    side, share = max(shares.items(), key=lambda one: one[1])
    if share < _CLIPPED:
        return []
    text = (
        f"{swing.source} is clipped: {100.0 * share:.0f} % of its rows have its {side} "
        "value. Choose a larger range of the sensor, or let the body swing less far."
    )
    return [Finding(code="swing-clipped", severity="error", text=text, where=Place(columns=(swing.source,)))]


def _frozen(swing: Swing) -> list[Finding]:
    first, last = _longest_run(swing.values)
    lasts = float(swing.t[last] - swing.t[first])
    # at the end of the recording, the body rests
    if last - first < 5 or last == len(swing.t) - 1 or lasts < _FROZEN * swing.period:
        return []
    text = (
        f"{swing.source} repeats one value for {lasts:.2g} s from t = "
        f"{swing.t[first]:.4g} s on, in the middle of the swing: the sensor froze, "
        "or the body was held. Cut the recording to where it swings freely."
    )
    where = Place(columns=(swing.source,), time=float(swing.t[first]))
    return [Finding(code="stuck", severity="error", text=text, where=where)]


def _longest_run(values: NDArray[np.float64]) -> tuple[int, int]:
    """Return the first and last row of the longest run of equal values."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1]) - 1


def _of_unit(fit: SwingFit) -> Iterator[Finding]:
    swing, (first, _) = fit.swing, fit.amplitudes
    where = Place(columns=(swing.source,))
    if first > _LARGE and fits_better_in_degrees(swing, fit):
        text = (
            f"{swing.source} appears to be in degrees: read in radians, "
            f"its swings of {math.degrees(first):.3g} degrees would slow "
            "down as they grow, and they do not. Multiply it by pi/180."
        )
        yield Finding(code="swing-unit", severity="error", text=text, where=where)
    elif first < _SMALLEST_SWING:
        text = (
            f"{swing.source} swings by only {math.degrees(first):.2g} degrees, "
            "where the friction of the pivot and the noise of the sensor matter "
            "most. Check its unit, or let the body swing by 5 to 20 degrees."
        )
        yield Finding(code="swing-unit", severity="warning", text=text, where=where)
    elif first > _LARGEST_SWING:
        text = (
            f"{swing.source} swings by {math.degrees(first):.3g} "
            "degrees; release the body at 5 to 20 degrees."
        )
        yield Finding(code="swing-unit", severity="warning", text=text, where=where)


def _of_body(fit: SwingFit, robot: Robot, pivot: Pivot) -> Iterator[Finding]:
    gyration = radius_of_gyration(fit.frequency, robot, pivot)
    share = gyration / pivot.distance
    if _USUAL[0] <= share <= _USUAL[1]:
        return
    cause = likely_cause(fit.frequency, robot, pivot)
    text = (
        f"A period of {2.0 * math.pi / fit.frequency:.4g} s at {pivot.distance:.3g} m from the centre of "
        f"mass gives the body a radius of gyration of {gyration:.3g} m, {share:.2g} of that distance; "
        f"bodies have 0.3 to 0.9. {cause or 'Look at the units of t and at the distance to the pivot.'}"
    )
    severity = "warning" if _POSSIBLE[0] <= share <= _POSSIBLE[1] else "error"
    yield Finding(code="swing-inertia", severity=severity, text=text, where=Place(columns=("t",)))


def _of_file(fit: SwingFit, found: SwingInertia, robot: Robot) -> Iterator[Finding]:
    written = np.diag(robot.body.inertia_about_ball_center())[:2]
    nearest = written[int(np.argmin(np.abs(np.log(found.about_ball_center.value / written))))]
    ratio = found.about_ball_center.value / float(nearest)
    if 1.0 / _LIKE_FILE <= ratio <= _LIKE_FILE:
        return
    text = (
        f"The swing's inertia about the ball's centre, {found.about_ball_center.value:.4g} kg "
        f"m^2, is {ratio:.3g} times the file's {float(nearest):.4g}. The file's inertia is wrong, "
        f"or body.mass ({robot.body.mass:.4g} kg), the distance to the pivot, or the time of the "
        f"recording; a clock {math.sqrt(ratio):.3g} times too slow would have the same effect."
    )
    yield Finding(
        code="swing-inertia", severity="warning", text=text, where=Place(columns=(fit.swing.source,))
    )


def _of_fit(fit: SwingFit) -> Iterator[Finding]:
    where = Place(columns=(fit.swing.source,))
    if fit.residual > _MUCH_LEFT:
        text = (
            f"A pendulum leaves {100.0 * fit.residual:.0f} % of {fit.swing.source} unexplained; "
            "look for a pivot that slides, a second mode or a hand that touched the body."
        )
        yield Finding(code="swing-fit", severity="warning", text=text, where=where)
    half = fit.half_widths
    energy = fit.values[1] * fit.frequency * fit.amplitudes[0] + fit.values[2]
    if fit.values[1] < -half[1] and energy < 0.0:
        text = "The swing grows: something drives the body, or the recording is reversed in time."
        yield Finding(code="swing-fit", severity="warning", text=text, where=where)
