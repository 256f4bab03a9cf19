"""The shapes that every drawing of a robot shows.

A robot file does not describe the body's shape. Its outline is two equal discs, one above the other, that have the
body's mass, centre of mass and inertia.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.components import Body, Wheels
from ballbot.robot.robot import Robot
from ballbot.robot.wheel_directions import axles, contact_directions, rolling_directions


@dataclass(frozen=True, kw_only=True)
class BodyShape:
    """Two discs that weigh and turn as the body does."""

    radius: float  #: [m]
    bottom: float  #: height of the lower disc above the ball's centre [m]
    top: float  #: height of the upper disc [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class WheelShape:
    """One wheel: unit vectors and centre, all (3,)."""

    contact: NDArray[np.float64]  #: n_i, from the ball's centre towards the contact point
    rolling: NDArray[np.float64]  #: t_i
    axle: NDArray[np.float64]  #: a_i = n_i x t_i
    center: NDArray[np.float64]  #: [m]


def body_shape(body: Body) -> BodyShape:
    """Return the two discs with the body's mass, centre of mass and inertia.

    With m/2 at each height l +- h/2: I_zz = m R^2 / 2 and I_xx = m (R^2 + h^2) / 4.
    """
    xx, yy, zz = np.diag(body.inertia_about_center_of_mass()) / body.mass
    radius_squared, middle = 2.0 * float(zz), body.center_of_mass
    half = 0.5 * math.sqrt(max(2.0 * float(xx + yy) - radius_squared, 0.0))
    return BodyShape(radius=math.sqrt(radius_squared), bottom=middle - half, top=middle + half)


def wheel_shapes(robot: Robot) -> list[WheelShape]:
    """Return the wheels in the order of their azimuths, touching the ball."""
    reach, azimuths, tilt = robot.ball.radius + robot.wheels.radius, robot.wheels.azimuths, robot.wheels.tilt
    directions = contact_directions(azimuths, tilt), rolling_directions(azimuths), axles(azimuths, tilt)
    return [
        WheelShape(contact=contact, rolling=rolling, axle=axle, center=reach * contact)
        for contact, rolling, axle in zip(*directions, strict=True)
    ]


def row_offsets(wheels: Wheels) -> NDArray[np.float64]:
    """Return where along the axle each row of rollers lies, from the wheel's middle [m], shape (rows,)."""
    rollers = wheels.rollers
    middle = 0.5 * (rollers.rows - 1)
    return np.array([rollers.row_spacing * (row - middle) for row in range(rollers.rows)])
