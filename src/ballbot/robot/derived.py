"""Quantities that follow from the parameters: shells, pendulum swings, speed limits, reflected inertia."""

import math
from dataclasses import dataclass

import numpy as np

from ballbot.robot.components import Sensors
from ballbot.robot.robot import Robot


def thin_shell_inertia(*, mass: float, radius: float) -> float:
    """Return the inertia [kg m^2] of a thin spherical shell about its centre, 2/3 m r^2.

    >>> round(thin_shell_inertia(mass=3.0, radius=0.1), 12)
    0.02
    """
    return 2.0 / 3.0 * mass * radius**2


def solid_sphere_inertia(*, mass: float, radius: float) -> float:
    """Return the inertia [kg m^2] of a solid sphere about its centre, 2/5 m r^2.

    >>> round(solid_sphere_inertia(mass=3.0, radius=0.1), 12)
    0.012
    """
    return 0.4 * mass * radius**2


def encoder_step(robot: Robot, sensors: Sensors | None = None) -> float:
    """Return the wheel angle [rad] of one count of a robot's encoders, or of those of other sensors on it."""
    return 2.0 * math.pi / ((sensors or robot.sensors).encoder_counts * robot.drive.gear_ratio)


@dataclass(frozen=True)
class Derived:
    """A quantity that follows from a robot's parameters."""

    name: str  #: in results.json
    value: float
    unit: str
    meaning: str  #: the quantity in words


def derived_quantities(robot: Robot) -> list[Derived]:
    """Return the derived quantities that `ballbot check` prints, in reading order."""
    ball, body, drive, wheels = robot.ball, robot.body, robot.drive, robot.wheels
    central = np.diag(body.inertia_about_center_of_mass())
    pivot = np.diag(body.inertia_about_ball_center())
    shell = thin_shell_inertia(mass=ball.mass, radius=ball.radius)
    solid = solid_sphere_inertia(mass=ball.mass, radius=ball.radius)
    swing = math.sqrt(body.mass * robot.gravity * body.center_of_mass / float(pivot[0]))
    step = encoder_step(robot)
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
    return [Derived(name, float(value), unit, words) for name, value, unit, words in rows]
