"""What a swing says, in sentences and as results."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np

from ballbot.identification.swing.fit import SwingFit
from ballbot.identification.swing.inertia import Estimate, Pivot, SwingInertia
from ballbot.identification.swing.pendulum import period_growth
from ballbot.robot import Robot

#: digits of a value beyond these are the integration's, not the swing's
_DIGITS = 6


def swing_remarks(fit: SwingFit, found: SwingInertia, robot: Robot) -> list[str]:
    """Return what the swing says, in words, the answer first."""
    one = found.about_ball_center
    sentences = [
        f"The body's inertia about the ball's centre is {_known(one.value, one.half_width)} kg m^2 (95 %); "
        f"{_beside_file(one, robot)}",
        _amplitude_sentence(fit),
        _damping_sentence(fit, found.about_pivot.value),
    ]
    if found.about_center_of_mass.shares["frequency"] == 1.0:
        sentences.append(
            "The file has no standard_deviation of body.mass and "
            "body.center_of_mass, so the intervals cover the swing only."
        )
    else:
        cause, share = max(found.about_center_of_mass.shares.items(), key=lambda item: item[1])
        sentences.append(
            f"About the centre of mass, {100.0 * share:.0f} % of the variance comes from the {cause}."
        )
    return sentences


def swing_results(fit: SwingFit, found: SwingInertia, pivot: Pivot) -> dict[str, object]:
    """Return what results.json holds, SI units; half widths are of 95 %."""
    half, inertia = fit.half_widths, found.about_pivot.value
    return {
        "source": fit.swing.source,
        "swings": fit.swing.swings,
        "amplitude_first": fit.amplitudes[0],
        "amplitude_last": fit.amplitudes[1],
        "frequency": fit.frequency,
        "frequency_half_width": fit.frequency_half_width,
        "viscous": float(fit.values[1]) * inertia,
        "viscous_half_width": float(half[1]) * inertia,
        "dry": float(fit.values[2]) * inertia,
        "dry_half_width": float(half[2]) * inertia,
        "residual_share": fit.residual,
        "pivot": asdict(pivot),
        "inertia_about_pivot": _estimate(found.about_pivot),
        "inertia_about_center_of_mass": _estimate(found.about_center_of_mass),
        "inertia_about_ball_center": _estimate(found.about_ball_center),
    }


def swing_rows(fit: SwingFit, found: SwingInertia) -> list[list[str]]:
    """Return the rows of what is printed: quantity, value with half width of 95 %, unit."""
    half, inertia = fit.half_widths, found.about_pivot.value
    period_half = 2.0 * np.pi * fit.frequency_half_width / fit.frequency**2
    measured = [
        ("small swings' frequency", fit.frequency, fit.frequency_half_width, "rad/s"),
        ("small swings' period", 2.0 * np.pi / fit.frequency, period_half, "s"),
        ("pivot's viscous friction", fit.values[1] * inertia, half[1] * inertia, "N m s/rad"),
        ("pivot's dry friction", fit.values[2] * inertia, half[2] * inertia, "N m"),
    ]
    for name, one in (
        ("inertia about the pivot", found.about_pivot),
        ("inertia about the centre of mass", found.about_center_of_mass),
        ("inertia about the ball's centre", found.about_ball_center),
    ):
        measured.append((name, one.value, one.half_width, "kg m^2"))
    return [[name, _known(float(value), float(width)), unit] for name, value, width, unit in measured]


def _known(value: float, half_width: float) -> str:
    """Return value and half width with two digits of the latter, and of the value no more than `_DIGITS`."""
    decimals = max(0, 1 - math.floor(math.log10(half_width))) if half_width > 0.0 else 4
    if value:
        decimals = max(0, min(decimals, _DIGITS - 1 - math.floor(math.log10(abs(value)))))
    return f"{value:.{decimals}f} ± {half_width:.{decimals}f}"


def _beside_file(one: Estimate, robot: Robot) -> str:
    written = np.diag(robot.body.inertia_about_ball_center())[:2].tolist()
    named = [f"{value:.4g} about {axis}" for value, axis in zip(written, "xy", strict=True)]
    # rounding of the file's number is no deviation
    inside = [abs(value - one.value) <= max(one.half_width, 1e-4 * one.value) for value in written]
    if all(inside):
        return f"the file's {' and '.join(named)} lie within it."
    if any(inside):
        within, outside = (named[inside.index(which)] for which in (True, False))
        return f"the file's {within} lies within, its {outside} outside."
    return f"the file's {' and '.join(named)} lie outside."


def _estimate(one: Estimate) -> dict[str, object]:
    return {**asdict(one), "half_width": one.half_width}


def _amplitude_sentence(fit: SwingFit) -> str:
    first, last = fit.amplitudes
    # half way in time, as a fit of one frequency would see it
    longer = period_growth(0.5 * (first + last)) - 1.0
    return (
        f"The swing falls from {np.degrees(first):.1f} to {np.degrees(last):.1f} degrees in {fit.swing.swings:.0f} "
        f"swings; at these amplitudes the period is {100.0 * longer:.2g} % longer than a small swing's, and the "
        f"inertia without that correction would be {100.0 * ((1.0 + longer) ** 2 - 1.0):.2g} % too large."
    )


def _damping_sentence(fit: SwingFit, inertia: float) -> str:
    """Say which friction slows it: each is there where its interval lies above zero."""
    half = fit.half_widths
    viscous, dry = (fit.values[i] > half[i] for i in (1, 2))
    b, c = f"{fit.values[1] * inertia:.2g} N m s/rad", f"{fit.values[2] * inertia:.2g} N m"
    if viscous and dry:
        return f"Both frictions slow it: viscous, {b}, and dry, {c}."
    if viscous:
        return f"Viscous friction slows it, {b}; the swing shows no dry friction."
    if dry:
        return f"Dry friction slows it, {c}; the swing shows no viscous friction."
    return "The swing is too short to show which friction slows it; let it swing longer."
