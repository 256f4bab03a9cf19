"""The body's inertia from a free swing: its value with uncertainty, checks of the recording, findings and results.

The inertia follows from the swing's frequency:

    I_pivot = m g r / omega_n^2        I_com = I_pivot - m r^2        J_0 = I_com + m l^2

m the hanging mass, r from the pivot to its centre of mass, l from the ball's centre to it (thesis, Appendix III, which
hung the body at the ball's centre, r = l). The causes (frequency, m, r, l) count as independent; with the derivative
d_i of a result by each, its variance is the sum of (d_i s_i)^2.

The checks find a wrong unit of the angle or of time, a clipped or frozen sensor, and another body.

A pendulum's period grows with its amplitude, so that the shape of large swings distinguishes radians from degrees; its
frequency and the lever to its pivot give a radius of gyration, which a wrong unit of time or length makes impossible.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity, error, finding, note, warning
from ballbot.identification.swing import Swing, SwingFit, fits_better_in_degrees
from ballbot.log.signals import longest_repeat
from ballbot.robot import Robot
from ballbot.robot.derived import inertia_from_swing
from ballbot.rounding import plus_minus

#: standard deviations to either side of a 95 % interval
_NORMAL = 1.959964
_CHECK_UNITS = "Check the units of t [s] and of the distance to the pivot [m]."


@dataclass(frozen=True, kw_only=True)
class Pivot:
    """The pivot that the body hangs from."""

    distance: float  #: r, from the pivot to the centre of mass [m]
    deviation: float  #: its standard deviation [m]
    at_ball_center: bool  #: r is the robot's l itself

    @staticmethod
    def of(robot: Robot, *, distance: float | None = None, deviation: float | None = None) -> Pivot:
        """Return the pivot at a distance r [m] with its standard deviation, or where the ball's centre would be.

        There r is the robot's l, with the standard deviation that its file gives; elsewhere zero is the default.

        InputError if the distance is not above zero, or the deviation below it.
        """
        known = robot.standard_deviations.get("body.center_of_mass", 0.0) if distance is None else 0.0
        pivot = Pivot(
            distance=robot.body.center_of_mass if distance is None else distance,
            deviation=float(known) if deviation is None else deviation,  # pyright: ignore[reportArgumentType]
            at_ball_center=distance is None,
        )
        if not (math.isfinite(pivot.distance) and pivot.distance > 0.0):
            raise InputError(f"The distance to the pivot is {pivot.distance:g} m; it must be above zero.")
        if not (math.isfinite(pivot.deviation) and pivot.deviation >= 0.0):
            raise InputError(
                "The standard deviation of the distance to the pivot "
                f"is {pivot.deviation:g} m; it must be zero or more."
            )
        return pivot


@dataclass(frozen=True, kw_only=True)
class SwingEstimate:
    """A number with its standard deviation, and each cause's share of the variance."""

    value: float
    deviation: float
    shares: dict[str, float]

    @staticmethod
    def of(value: float, changes: Mapping[str, float]) -> SwingEstimate:
        """Return a number that one standard deviation of each cause changes by so much."""
        variance = sum(change**2 for change in changes.values())
        shares = {cause: change**2 / variance if variance else 0.0 for cause, change in changes.items()}
        return SwingEstimate(value=value, deviation=math.sqrt(variance), shares=shares)

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval."""
        return _NORMAL * self.deviation

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {**asdict(self), "half_width": self.half_width}


@dataclass(frozen=True, kw_only=True)
class SwingInertia:
    """The body's inertia about the axis of its swing [kg m^2]."""

    about_pivot: SwingEstimate
    about_center_of_mass: SwingEstimate
    about_ball_center: SwingEstimate


def inertia_of_swing(fit: SwingFit, robot: Robot, pivot: Pivot) -> SwingInertia:
    """Return the inertia of the body that swung, with its uncertainty.

    The robot gives the hanging mass, l and g, and their standard deviations. InputError if the pivot's distance leaves
    nothing for the body about its own centre of mass.
    """
    g, omega = robot.gravity, fit.frequency
    point = np.array([omega, robot.body.mass, pivot.distance, robot.body.center_of_mass])

    def inertias(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        frequency, m, r, height = numbers.tolist()
        about = inertia_from_swing(mass=m, gravity=g, distance=r, angular_frequency=frequency)
        own = about - m * r**2
        return np.array([about, own, own + m * (r if pivot.at_ball_center else height) ** 2])

    values = inertias(point)
    if values[1] <= 0.0:
        raise InputError(
            f"With {robot.body.mass:g} kg at {pivot.distance:g} m, the swing of {omega:.4g} rad/s gives an inertia "
            f"of {values[1]:.3g} kg m^2 about the centre of mass, which no body has; the distance "
            f"must be below {g / omega**2:.4g} m. {_CHECK_UNITS}"
        )
    # change of each result by one standard deviation of each cause; if r is l they are one cause
    deviations = {
        "frequency": fit.frequency_half_width / _NORMAL,
        "mass": _deviation(robot, "body.mass"),
        "pivot distance": pivot.deviation,
        "centre of mass": 0.0 if pivot.at_ball_center else _deviation(robot, "body.center_of_mass"),
    }
    changes = {
        cause: 0.5 * (inertias(point + step) - inertias(point - step))
        for cause, step in zip(deviations, np.diag(list(deviations.values())), strict=True)
    }
    about_pivot, own, about_ball = (
        SwingEstimate.of(value, {cause: float(change[i]) for cause, change in changes.items()})
        for i, value in enumerate(values.tolist())
    )
    return SwingInertia(about_pivot=about_pivot, about_center_of_mass=own, about_ball_center=about_ball)


def _deviation(robot: Robot, name: str) -> float:
    deviation = robot.standard_deviations.get(name, 0.0)
    assert not isinstance(deviation, tuple)  # neither of the two is a list, which `check_deviations` sees to
    return float(deviation)


#: the radius of gyration over the distance from pivot to centre of mass, of bodies hung at the ball's centre or nearby
_USUAL, _POSSIBLE = (0.15, 1.3), (0.03, 3.0)
#: the shape of smaller swings does not distinguish radians from degrees [rad]
_LARGE = 0.25
#: a finding reports a file's inertia that is off by more than this factor
_LIKE_FILE = 1.25
#: a pendulum that leaves more of the motion than this is not the whole story
_MUCH_LEFT = 0.05
#: rows at the very largest value that make a sensor clipped, as a share; a sine with fine steps has next to none
_CLIPPED = 0.04
#: least steps of the sensor's resolution in a swing for which rows at the top mean clipping, not coarse steps
_FINE = 40
#: of a swing's period: a longer stretch of one and the same value is a sensor that repeats itself
_FROZEN = 0.2


def recording_findings(swing: Swing) -> tuple[Finding, ...]:
    """Return the faults of a recording, before a pendulum is fitted to it: a sensor that is clipped or that froze."""
    values, name, t = swing.values, swing.source, swing.t
    share, side = max((float(np.mean(values == end)), side) for side, end in _ends(values))
    if len(np.unique(values)) >= _FINE and share >= _CLIPPED:
        text = (
            f"{name} is clipped: {100.0 * share:.0f} % of its rows have its {side} "
            "value. Choose a larger range of the sensor, or let the body swing less far."
        )
        return (error("swing-clipped", text, name),)
    first, last = longest_repeat(values)
    # at the end of the recording, the body rests
    if last - first < 5 or last == len(t) - 1 or t[last] - t[first] < _FROZEN * swing.period:
        return ()
    text = (
        f"{name} repeats one value for {t[last] - t[first]:.2g} s from t = {t[first]:.4g} s on, in the middle of the "
        "swing: the sensor froze, or the body was held. Cut the recording to where it swings freely."
    )
    return (error("stuck", text, name, time=float(t[first])),)


def _ends(values: NDArray[np.float64]) -> tuple[tuple[str, float], tuple[str, float]]:
    return ("least", float(values.min())), ("largest", float(values.max()))


def swing_findings(fit: SwingFit, found: SwingInertia, robot: Robot, pivot: Pivot) -> tuple[Finding, ...]:
    """Return the evidence against a swing's inertia, errors first."""
    return by_severity(_evidence(fit, found, robot, pivot))


def _evidence(fit: SwingFit, found: SwingInertia, robot: Robot, pivot: Pivot) -> Iterator[Finding]:
    name, (first, _) = fit.swing.source, fit.amplitudes
    if first > _LARGE and fits_better_in_degrees(fit):
        text = (
            f"{name} appears to be in degrees: read in radians, its swings of {math.degrees(first):.3g} degrees would "
            "slow down as they grow, and they do not. Multiply it by pi/180."
        )
        yield error("swing-unit", text, name)
    if fit.residual > _MUCH_LEFT:
        text = (
            f"A pendulum leaves {100.0 * fit.residual:.0f} % of {name} unexplained; "
            "look for a pivot that slides, a second mode or a hand that touched the body."
        )
        yield warning("swing-fit", text, name)
    gyration = math.sqrt(found.about_center_of_mass.value / robot.body.mass)
    share = gyration / pivot.distance
    if not _USUAL[0] <= share <= _USUAL[1]:
        text = (
            f"A period of {2.0 * math.pi / fit.frequency:.4g} s at {pivot.distance:.3g} m from the centre of "
            f"mass gives the body a radius of gyration of {gyration:.3g} m, {share:.2g} of that distance; "
            f"bodies have 0.3 to 0.9. {_CHECK_UNITS}"
        )
        severity = "warning" if _POSSIBLE[0] <= share <= _POSSIBLE[1] else "error"
        yield finding("swing-inertia", severity, text, "t")
    value = found.about_ball_center.value
    written = np.diag(robot.body.inertia_about_ball_center())[:2]
    nearest = float(written[int(np.argmin(np.abs(np.log(value / written))))])
    ratio = value / nearest
    if not 1.0 / _LIKE_FILE <= ratio <= _LIKE_FILE:
        text = (
            f"The swing's inertia about the ball's centre, {value:.4g} kg m^2, is {ratio:.3g} times the file's "
            f"{nearest:.4g}. The file's inertia is wrong, or body.mass ({robot.body.mass:.4g} kg), the distance to the "
            f"pivot, or the time of the recording; a clock {math.sqrt(ratio):.3g} times too slow would have the same "
            "effect."
        )
        yield warning("swing-inertia", text, name)


def inertia_findings(found: SwingInertia, robot: Robot) -> list[Finding]:
    """Return the results of a swing in sentences, the inertia first."""
    one, named = found.about_ball_center, []
    # rounding of the file's number is no deviation
    width = max(one.half_width, 1e-4 * one.value)
    for value, axis in zip(np.diag(robot.body.inertia_about_ball_center())[:2].tolist(), "xy", strict=True):
        place = "within" if abs(value - one.value) <= width else "outside"
        named.append(f"{value:.4g} about {axis} lies {place}")
    cause, share = max(found.about_center_of_mass.shares.items(), key=lambda item: item[1])
    variance = (
        "The file has no standard_deviation of body.mass and body.center_of_mass: the intervals cover the swing only."
        if cause == "frequency" and share == 1.0
        else f"About the centre of mass, {100.0 * share:.0f} % of the variance comes from the {cause}."
    )
    sentences = (
        f"The body's inertia about the ball's centre is {plus_minus(one.value, one.half_width)} kg m^2 (95 %); the "
        f"file's {' and '.join(named)}.",
        variance,
    )
    return [note("swing", sentence) for sentence in sentences]


def swing_results(fit: SwingFit, found: SwingInertia, pivot: Pivot) -> dict[str, object]:
    """Return the entries of results.json, SI units; half widths are of 95 %."""
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
        "inertia_about_pivot": found.about_pivot.to_dict(),
        "inertia_about_center_of_mass": found.about_center_of_mass.to_dict(),
        "inertia_about_ball_center": found.about_ball_center.to_dict(),
    }


def swing_rows(fit: SwingFit, found: SwingInertia) -> list[list[str]]:
    """Return the rows of the printed table: quantity, value with half width of 95 %, unit."""
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
    return [[name, plus_minus(value, width), unit] for name, value, width, unit in measured]
