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
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, Place, Severity, by_severity, note
from ballbot.identification.swing import Swing, SwingFit, fits_better_in_degrees, period_growth
from ballbot.robot import Robot
from ballbot.robot.derived import inertia_from_swing

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
        """Return the pivot at a distance, or without one at where the ball's centre would be.

        Parameters
        ----------
        robot : Robot
            Gives l and its standard deviation.
        distance : float, optional
            r [m].
        deviation : float, optional
            Standard deviation of r [m]; the file's of l where r is l, else zero.

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

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval."""
        return _NORMAL * self.deviation


@dataclass(frozen=True, kw_only=True)
class SwingInertia:
    """The body's inertia about the axis of its swing [kg m^2]."""

    about_pivot: SwingEstimate
    about_center_of_mass: SwingEstimate
    about_ball_center: SwingEstimate


def inertia_of_swing(fit: SwingFit, robot: Robot, pivot: Pivot) -> SwingInertia:
    """Return the inertia of the body that swung, with its uncertainty.

    Parameters
    ----------
    fit : SwingFit
    robot : Robot
        Gives the hanging mass, l and g, and their standard deviations.
    pivot : Pivot

    InputError if the pivot's distance leaves nothing for the body about its own centre of mass.
    """
    m, g, r = robot.body.mass, robot.gravity, pivot.distance
    height = robot.body.center_of_mass
    about_pivot = inertia_from_swing(mass=m, gravity=g, distance=r, angular_frequency=fit.frequency)
    own = about_pivot - m * r**2
    if own <= 0.0:
        raise InputError(
            f"With {m:g} kg at {r:g} m, the swing of {fit.frequency:.4g} rad/s gives an inertia "
            f"of {own:.3g} kg m^2 about the centre of mass, which no body has; the distance "
            f"must be below {g / fit.frequency**2:.4g} m. {_CHECK_UNITS}"
        )
    # change of each result by one standard deviation of each cause; if r is l they are one cause
    omega = about_pivot / fit.frequency * -2.0 * fit.frequency_half_width / _NORMAL
    mass = _deviation(robot, "body.mass")
    lift = 0.0 if pivot.at_ball_center else _deviation(robot, "body.center_of_mass")
    back = r if pivot.at_ball_center else 0.0
    of_pivot = {
        "frequency": omega,
        "mass": about_pivot / m * mass,
        "pivot distance": about_pivot / r * pivot.deviation,
    }
    of_own = {
        "frequency": omega,
        "mass": own / m * mass,
        "pivot distance": (about_pivot / r - 2.0 * m * r) * pivot.deviation,
    }
    of_center = {
        "frequency": omega,
        "mass": (own / m + height**2) * mass,
        "pivot distance": (about_pivot / r - 2.0 * m * (r - back)) * pivot.deviation,
        "centre of mass": 2.0 * m * height * lift,
    }
    return SwingInertia(
        about_pivot=_estimate(about_pivot, of_pivot),
        about_center_of_mass=_estimate(own, of_own),
        about_ball_center=_estimate(own + m * height**2, of_center),
    )


def radius_of_gyration(frequency: float, robot: Robot, pivot: Pivot) -> float:
    """Return the radius of gyration [m] about the centre of mass of a body that swings so; NaN if no body does.

    k^2 = g r / omega_n^2 - r^2, whatever its mass.
    """
    square = robot.gravity * pivot.distance / frequency**2 - pivot.distance**2
    return math.sqrt(square) if square > 0.0 else math.nan


def _estimate(value: float, changes: dict[str, float]) -> SwingEstimate:
    variance = sum(change**2 for change in changes.values())
    shares = {cause: change**2 / variance if variance else 0.0 for cause, change in changes.items()}
    return SwingEstimate(value=value, deviation=math.sqrt(variance), shares=shares)


def _deviation(robot: Robot, name: str) -> float:
    deviation = robot.standard_deviations.get(name, 0.0)
    assert not isinstance(deviation, tuple)  # neither of the two is a list, which `check_deviations` sees to
    return float(deviation)


#: the radius of gyration over the distance from pivot to centre of mass, of bodies hung at the ball's centre or nearby
_USUAL, _POSSIBLE = (0.15, 1.3), (0.03, 3.0)
#: the shape of smaller swings does not distinguish radians from degrees [rad]
_LARGE = 0.25
#: [rad]; smaller swings rub rather than swing, larger ones are rare
_SMALLEST_SWING, _LARGEST_SWING = math.radians(0.4), math.radians(75.0)
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
    values, name = swing.values, swing.source
    share, side = max((float(np.mean(values == end)), side) for side, end in _ends(values))
    if len(np.unique(values)) >= _FINE and share >= _CLIPPED:
        text = (
            f"{name} is clipped: {100.0 * share:.0f} % of its rows have its {side} "
            "value. Choose a larger range of the sensor, or let the body swing less far."
        )
        return (_finding("swing-clipped", "error", text, name),)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    longest = int(np.argmax(np.diff(edges)))
    first, last = int(edges[longest]), int(edges[longest + 1]) - 1
    lasts = float(swing.t[last] - swing.t[first])
    # at the end of the recording, the body rests
    if last - first < 5 or last == len(swing.t) - 1 or lasts < _FROZEN * swing.period:
        return ()
    text = (
        f"{name} repeats one value for {lasts:.2g} s from t = {swing.t[first]:.4g} s on, in the middle of the swing: "
        "the sensor froze, or the body was held. Cut the recording to where it swings freely."
    )
    return (_finding("stuck", "error", text, name, time=float(swing.t[first])),)


def _ends(values: NDArray[np.float64]) -> tuple[tuple[str, float], tuple[str, float]]:
    return ("least", float(values.min())), ("largest", float(values.max()))


def _finding(code: str, severity: Severity, text: str, column: str, *, time: float | None = None) -> Finding:
    return Finding(code=code, severity=severity, text=text, where=Place(columns=(column,), time=time))


def swing_findings(fit: SwingFit, found: SwingInertia, robot: Robot, pivot: Pivot) -> tuple[Finding, ...]:
    """Return the evidence against a swing's inertia, errors first."""
    return by_severity([*_of_motion(fit), *_of_body(fit, found, robot, pivot)])


def _of_motion(fit: SwingFit) -> Iterator[Finding]:
    name, (first, _) = fit.swing.source, fit.amplitudes
    size = f"{name} swings by {math.degrees(first):.2g} degrees"
    if first > _LARGE and fits_better_in_degrees(fit):
        text = (
            f"{name} appears to be in degrees: read in radians, its swings of {math.degrees(first):.3g} degrees would "
            "slow down as they grow, and they do not. Multiply it by pi/180."
        )
        yield _finding("swing-unit", "error", text, name)
    elif first < _SMALLEST_SWING:
        text = (
            f"{size} only, where the friction of the pivot and the noise of the sensor matter most. Check its unit, or "
            "let the body swing by 5 to 20 degrees."
        )
        yield _finding("swing-unit", "warning", text, name)
    elif first > _LARGEST_SWING:
        yield _finding("swing-unit", "warning", f"{size}; release the body at 5 to 20 degrees.", name)
    if fit.residual > _MUCH_LEFT:
        text = (
            f"A pendulum leaves {100.0 * fit.residual:.0f} % of {name} unexplained; "
            "look for a pivot that slides, a second mode or a hand that touched the body."
        )
        yield _finding("swing-fit", "warning", text, name)
    energy = fit.values[1] * fit.frequency * first + fit.values[2]
    if fit.values[1] < -fit.half_widths[1] and energy < 0.0:
        text = "The swing grows: something drives the body, or the recording is reversed in time."
        yield _finding("swing-fit", "warning", text, name)


def _of_body(fit: SwingFit, found: SwingInertia, robot: Robot, pivot: Pivot) -> Iterator[Finding]:
    gyration = radius_of_gyration(fit.frequency, robot, pivot)
    share = gyration / pivot.distance
    if not _USUAL[0] <= share <= _USUAL[1]:
        text = (
            f"A period of {2.0 * math.pi / fit.frequency:.4g} s at {pivot.distance:.3g} m from the centre of "
            f"mass gives the body a radius of gyration of {gyration:.3g} m, {share:.2g} of that distance; "
            f"bodies have 0.3 to 0.9. {_CHECK_UNITS}"
        )
        yield _finding(
            "swing-inertia", "warning" if _POSSIBLE[0] <= share <= _POSSIBLE[1] else "error", text, "t"
        )
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
        yield _finding("swing-inertia", "warning", text, fit.swing.source)


#: digits of a value beyond these are the integration's, not the swing's
_DIGITS = 6


def inertia_findings(fit: SwingFit, found: SwingInertia, robot: Robot) -> list[Finding]:
    """Return the results of a swing in sentences, the inertia first."""
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
        "inertia_about_pivot": _estimate_results(found.about_pivot),
        "inertia_about_center_of_mass": _estimate_results(found.about_center_of_mass),
        "inertia_about_ball_center": _estimate_results(found.about_ball_center),
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
    return [[name, _known(float(value), float(width)), unit] for name, value, width, unit in measured]


def _known(value: float, half_width: float) -> str:
    """Return value and half width with two digits of the latter, and of the value no more than `_DIGITS`."""
    decimals = max(0, 1 - math.floor(math.log10(half_width))) if half_width > 0.0 else 4
    if value:
        decimals = max(0, min(decimals, _DIGITS - 1 - math.floor(math.log10(abs(value)))))
    return f"{value:.{decimals}f} ± {half_width:.{decimals}f}"


def _beside_file(one: SwingEstimate, robot: Robot) -> str:
    # rounding of the file's number is no deviation
    width, named = max(one.half_width, 1e-4 * one.value), []
    for value, axis in zip(np.diag(robot.body.inertia_about_ball_center())[:2].tolist(), "xy", strict=True):
        place = "within" if abs(value - one.value) <= width else "outside"
        named.append(f"{value:.4g} about {axis} lies {place}")
    return f"the file's {' and '.join(named)}."


def _estimate_results(one: SwingEstimate) -> dict[str, object]:
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
    kinds = {"viscous friction": (1, "N m s/rad"), "dry friction": (2, "N m")}
    shown = [
        f"{name}, {fit.values[i] * inertia:.2g} {unit}"
        for name, (i, unit) in kinds.items()
        if fit.values[i] > fit.half_widths[i]
    ]
    if not shown:
        return "The swing is too short to show which friction slows it; let it swing longer."
    return f"What slows it: {' and '.join(shown)}."
