"""The shapes that a drawing of a robot is made of, in the body frame with the ball's centre as origin.

Ball, wheels and rollers are to scale. A robot file says nothing about the body's shape, so that the body is
drawn as two thin horizontal discs, each of half its mass, with its centre of mass and (mean) inertia.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.robot import Body, Robot, Wheels

View = Literal["side", "top"]

#: rows: what points right and what points up on paper; the side view is seen from the robot's right
PROJECTIONS: dict[View, NDArray[np.float64]] = {
    "side": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "top": np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}
#: unit vectors from the paper towards the eye
TOWARDS_EYE: dict[View, NDArray[np.float64]] = {
    "side": np.array([0.0, -1.0, 0.0]),
    "top": np.array([0.0, 0.0, 1.0]),
}


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
    radius_squared = 2.0 * float(zz)
    height_squared = 2.0 * float(xx + yy) - radius_squared
    half = 0.5 * math.sqrt(max(height_squared, 0.0))
    return BodyShape(
        radius=math.sqrt(radius_squared), bottom=body.center_of_mass - half, top=body.center_of_mass + half
    )


def wheel_shapes(robot: Robot) -> list[WheelShape]:
    """Return the wheels in the order of their azimuths, touching the ball."""
    reach = robot.ball.radius + robot.wheels.radius
    return [_wheel_shape(azimuth, robot.wheels.tilt, reach) for azimuth in robot.wheels.azimuths]


def _wheel_shape(azimuth: float, tilt: float, reach: float) -> WheelShape:
    contact = np.array(
        [math.cos(azimuth) * math.sin(tilt), math.sin(azimuth) * math.sin(tilt), math.cos(tilt)]
    )
    rolling = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    return WheelShape(
        contact=contact, rolling=rolling, axle=np.cross(contact, rolling), center=reach * contact
    )


def row_offsets(wheels: Wheels) -> NDArray[np.float64]:
    """Return where along the axle each row of rollers lies, from the wheel's middle [m], shape (rows,)."""
    rollers = wheels.rollers
    middle = 0.5 * (rollers.rows - 1)
    return np.array([rollers.row_spacing * (row - middle) for row in range(rollers.rows)])


def wheel_rims(wheel: WheelShape, wheels: Wheels, *, points: int = 73) -> NDArray[np.float64]:
    """Return the closed circles through the outside of each row of rollers, (rows, points, 3) [m]."""
    angle = np.linspace(0.0, 2.0 * math.pi, points)[:, None]
    circle = wheels.radius * (np.cos(angle) * wheel.contact + np.sin(angle) * wheel.rolling)
    return wheel.center + circle + row_offsets(wheels)[:, None, None] * wheel.axle


def back_to_front(wheels: list[WheelShape], view: View) -> list[int]:
    """Return the wheels' indices in the order to paint them in, the one nearest to the eye last."""
    return sorted(range(len(wheels)), key=lambda index: float(wheels[index].center @ TOWARDS_EYE[view]))


def extent(robot: Robot, view: View) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top [m] of what a view shows, with the ground in the side view."""
    projection = PROJECTIONS[view]
    shape = body_shape(robot.body)
    rims = [wheel_rims(wheel, robot.wheels).reshape(-1, 3) @ projection.T for wheel in wheel_shapes(robot)]
    r_b, reach = robot.ball.radius, max(robot.ball.radius, shape.radius)
    low, high = (-r_b, shape.top) if view == "side" else (-reach, reach)
    corners = np.array([[-reach, low], [reach, high]])
    everything = np.vstack([*rims, corners])
    (left, bottom), (right, top) = everything.min(axis=0), everything.max(axis=0)
    return float(left), float(right), float(bottom), float(top)
