"""Quantities that follow from the parameters: shells, pendulum swings, speed limits, reflected inertia.

Formulas of the thesis's Appendix I (shell wall, speed limit) and III (pendulum), and of mechanics textbooks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballbot.errors import InputError
from ballbot.robot.robot import Robot


def shell_wall(
    *,
    mass: float,  # of the shell [kg]
    radius: float,  # outer radius [m]
    density: float,  # of the wall's material [kg/m^3]
) -> float:
    """Return the wall thickness [m] of a hollow sphere (Appendix I).

    InputError if even a solid sphere of that radius and density would be lighter.
    """
    cavity = radius**3 - 3.0 * mass / (4.0 * math.pi * density)
    if cavity < 0.0:
        heaviest = 4.0 / 3.0 * math.pi * radius**3 * density
        raise InputError(
            f"A sphere of radius {radius:g} m and density {density:g} kg/m^3 has a mass of at "
            f"most {heaviest:.3g} kg, not {mass:g} kg; check the unit of the density (kg/m^3)."
        )
    return radius - math.cbrt(cavity)


def thin_shell_inertia(*, mass: float, radius: float) -> float:
    """Return the inertia [kg m^2] of a thin spherical shell about its centre, 2/3 m r^2."""
    return 2.0 / 3.0 * mass * radius**2


def solid_sphere_inertia(*, mass: float, radius: float) -> float:
    """Return the inertia [kg m^2] of a solid sphere about its centre, 2/5 m r^2."""
    return 0.4 * mass * radius**2


def thick_shell_inertia(
    *,
    mass: float,  # of the shell [kg]
    radius: float,  # outer radius R [m]
    wall: float,  # thickness R - r [m], above zero and at most the radius
) -> float:
    """Return the inertia [kg m^2] of a spherical shell about its centre, 2/5 m (R^5 - r^5) / (R^3 - r^3).

    InputError if the wall is not between zero and the radius.
    """
    if not 0.0 < wall <= radius:
        raise InputError(f"A wall of {wall:g} m does not fit in a sphere of radius {radius:g} m.")
    # both differences divided by R - r, which would cancel digits where the wall is thin
    ratio = 1.0 - wall / radius
    fifth = sum(ratio**power for power in range(5))
    third = sum(ratio**power for power in range(3))
    return 0.4 * mass * radius**2 * fifth / third


def inertia_from_swing(
    *,
    mass: float,  # of the body [kg]
    gravity: float,  # g [m/s^2]
    distance: float,  # from pivot to centre of mass [m]
    angular_frequency: float,  # of small free swings [rad/s]
) -> float:
    """Return a hanging body's inertia [kg m^2] about its pivot, m g r / omega_n^2 (Appendix III)."""
    return mass * gravity * distance / angular_frequency**2


def encoder_step(*, encoder_counts: int, gear_ratio: float) -> float:
    """Return the wheel angle [rad] of one encoder count."""
    return 2.0 * math.pi / (encoder_counts * gear_ratio)


@dataclass(frozen=True, kw_only=True)
class Derived:
    """A quantity that follows from a robot's parameters."""

    name: str  #: in results.json
    value: float
    unit: str
    meaning: str  #: the quantity in words


def derived_quantities(robot: Robot) -> list[Derived]:
    """Return what `ballbot check` prints of a robot's parameters, in reading order."""
    ball, body, drive, wheels = robot.ball, robot.body, robot.drive, robot.wheels
    central = np.diag(body.inertia_about_center_of_mass())
    pivot = np.diag(body.inertia_about_ball_center())
    shell = thin_shell_inertia(mass=ball.mass, radius=ball.radius)
    solid = solid_sphere_inertia(mass=ball.mass, radius=ball.radius)
    swing = math.sqrt(body.mass * robot.gravity * body.center_of_mass / float(pivot[0]))
    step = encoder_step(encoder_counts=robot.sensors.encoder_counts, gear_ratio=drive.gear_ratio)
    about = {"pivot": (pivot, "the ball's centre"), "central": (central, "its centre of mass")}
    rotor, stuck = drive.reflected_inertia, max(robot.friction.breakaway)
    hung = "frequency at which the body swings, hung upside down at the ball's centre"
    rows = [
        ("total_mass", ball.mass + body.mass, "kg", "mass of ball and body"),
        ("ball_inertia_thin_shell", shell, "kg m^2", "inertia of the ball, were it a thin shell"),
        ("ball_inertia_solid", solid, "kg m^2", "inertia of the ball, were it solid"),
        *(
            (f"body_inertia_{key}_{axis}", value, "kg m^2", f"inertia {axis} of the body about {words}")
            for key, (moments, words) in about.items()
            for axis, value in zip(("xx", "yy", "zz"), moments, strict=True)
        ),
        ("swing_frequency", swing, "rad/s", hung),
        ("speed_ratio", ball.radius / wheels.radius, "1", "radius of the ball over that of a wheel"),
        ("reflected_rotor_inertia", rotor, "kg m^2", "inertia of motor and gear at a wheel, n^2 (j_m + j_g)"),
        ("wheel_speed_limit", drive.top_speed, "rad/s", "wheel speed at full supply without load"),
        ("encoder_step", step, "rad", "wheel angle of one count of the encoder"),
        ("break_away_torque", stuck, "N m", "largest break-away torque of a wheel, c + s"),
        ("rolling_resistance", robot.rolling_force, "N", "rolling resistance on level ground"),
    ]
    return [
        Derived(name=name, value=float(value), unit=unit, meaning=words) for name, value, unit, words in rows
    ]
