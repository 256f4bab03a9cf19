"""From a swing's frequency to the body's inertia, with everything that is not known for sure carried through.

    I_pivot = m g r / omega_n^2        I_com = I_pivot - m r^2        J_0 = I_com + m l^2

m the hanging mass, r from the pivot to its centre of mass, l from the ball's centre to it (thesis, Appendix III, which
hung the body at the ball's centre, r = l). The causes (frequency, m, r, l) count as independent; with the derivative
d_i of a result by each, its variance is the sum of (d_i s_i)^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ballbot.errors import InputError
from ballbot.identification.swing.fit import SwingFit
from ballbot.robot import Robot
from ballbot.robot.derived import inertia_from_swing

#: standard deviations to either side of a 95 % interval
_NORMAL = 1.959964

#: units that t is taken for seconds in, or what else makes a clock wrong, and the factor that mends it
_CLOCKS = (
    ("milliseconds", "", 1e-3),
    ("microseconds", "", 1e-6),
    ("nanoseconds", "", 1e-9),
    ("minutes", "", 60.0),
    ("", "The clock appears to run at half its rate, as if frames were counted twice.", 0.5),
    ("", "The clock appears to run at twice its rate, as if every second frame were missing.", 2.0),
)
#: over the distance to the pivot
_USUAL_GYRATION = (0.15, 1.2)


@dataclass(frozen=True, kw_only=True)
class Pivot:
    """Where the body hangs."""

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

        Raises
        ------
        InputError
            Where the distance is not above zero, or the deviation below it.
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
class Estimate:
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
    """What a swing says of the body's inertia about the axis that it swung about [kg m^2]."""

    about_pivot: Estimate
    about_center_of_mass: Estimate
    about_ball_center: Estimate


def inertia_of_swing(fit: SwingFit, robot: Robot, pivot: Pivot) -> SwingInertia:
    """Return the inertia of the body that swung, with its uncertainty.

    Parameters
    ----------
    fit : SwingFit
    robot : Robot
        Gives the hanging mass, l and g, and their standard deviations.
    pivot : Pivot

    Raises
    ------
    InputError
        Where the pivot's distance leaves nothing for the body about its own centre of mass.
    """
    m, g, r = robot.body.mass, robot.gravity, pivot.distance
    height = robot.body.center_of_mass
    about_pivot = inertia_from_swing(mass=m, gravity=g, distance=r, angular_frequency=fit.frequency)
    own = about_pivot - m * r**2
    if own <= 0.0:
        cause = likely_cause(fit.frequency, robot, pivot)
        raise InputError(
            f"With {m:g} kg at {r:g} m, the swing of {fit.frequency:.4g} rad/s gives an inertia "
            f"of {own:.3g} kg m^2 about the centre of mass, which no body has; the distance "
            f"must be below {g / fit.frequency**2:.4g} m.{(f' {cause}' if cause else '')}"
        )
    # what each result changes by one standard deviation of each cause; where r is l they are one cause
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


def likely_cause(frequency: float, robot: Robot, pivot: Pivot) -> str:
    """Return the slip of units, in a sentence, that makes a usual body of one that no body is; "" if none does."""
    times = {f"t appears to be in {unit}." if unit else words: factor for unit, words, factor in _CLOCKS}
    distances = {
        f"The distance to the pivot appears to be in {unit}, that is {factor * pivot.distance:.3g} m.": factor
        for unit, factor in (("centimetres", 1e-2), ("millimetres", 1e-3))
    }
    causes = [(words, factor, 1.0) for words, factor in times.items()]
    if not pivot.at_ball_center:
        causes = [*((words, 1.0, factor) for words, factor in distances.items()), *causes]
    for words, clock, scale in causes:
        moved = replace(pivot, distance=scale * pivot.distance)
        share = radius_of_gyration(frequency / clock, robot, moved) / moved.distance
        if _USUAL_GYRATION[0] <= share <= _USUAL_GYRATION[1]:
            return words
    return ""


def _estimate(value: float, changes: dict[str, float]) -> Estimate:
    variance = sum(change**2 for change in changes.values())
    shares = {cause: change**2 / variance if variance else 0.0 for cause, change in changes.items()}
    return Estimate(value=value, deviation=math.sqrt(variance), shares=shares)


def _deviation(robot: Robot, name: str) -> float:
    deviation = robot.standard_deviations.get(name, 0.0)
    assert not isinstance(deviation, tuple)  # neither of the two is a list, which `check_deviations` sees to
    return float(deviation)
