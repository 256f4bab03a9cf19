"""A robot drawn to scale in text, side view and top view, and the shapes that every drawing shows.

A robot file does not describe the body's shape. Its outline is two equal discs, one above the other, that have the
body's mass, centre of mass and inertia. The same shapes are drawn for print by `ballbot.robot.figure`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise, zip_longest
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.components import Body, Wheels
from ballbot.robot.robot import Robot

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
    """Return left, right, bottom and top [m] of a view, with the ground in the side view."""
    projection = PROJECTIONS[view]
    shape = body_shape(robot.body)
    rims = [wheel_rims(wheel, robot.wheels).reshape(-1, 3) @ projection.T for wheel in wheel_shapes(robot)]
    r_b, reach = robot.ball.radius, max(robot.ball.radius, shape.radius)
    low, high = (-r_b, shape.top) if view == "side" else (-reach, reach)
    corners = np.array([[-reach, low], [reach, high]])
    everything = np.vstack([*rims, corners])
    (left, bottom), (right, top) = everything.min(axis=0), everything.max(axis=0)
    return float(left), float(right), float(bottom), float(top)


#: bit of each dot of a braille character, by row and column
_DOT_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_BLANK = 0x2800

_ROWS = 26  #: most lines of text
_COLUMNS = 76  #: most characters on a line
_GAP = 6  #: characters between the views


class Canvas:
    """A sheet of braille dots, 2 by 4 to a character, that curves in metres are drawn on."""

    def __init__(self, *, left: float, right: float, bottom: float, top: float, dot: float) -> None:
        """Make an empty sheet for a rectangle [m] at `dot` metres a dot."""
        self._left, self._top, self._dot = left, top, dot
        columns = math.ceil((right - left) / (2.0 * dot)) + 1
        rows = math.ceil((top - bottom) / (4.0 * dot)) + 1
        self._bits = np.zeros((rows, columns), dtype=np.int64)
        self._letters: dict[tuple[int, int], str] = {}

    def curve(self, points: NDArray[np.float64]) -> None:
        """Draw straight lines from point to point, (N, 2) [m]; what lies outside the sheet is left out."""
        for start, end in pairwise(points):
            steps = math.ceil(float(np.abs(end - start).max()) / self._dot) + 1
            for fraction in np.linspace(0.0, 1.0, steps + 1):
                self._set(start + fraction * (end - start))

    def letter(self, point: NDArray[np.float64], text: str) -> None:
        """Put one character at a point, (2,) [m], over the dots."""
        column, row = self._dot_at(point)
        self._letters[row // 4, column // 2] = text

    def lines(self) -> list[str]:
        """Return the sheet's lines of text, all of one length."""
        return ["".join(self._character(row, column) for column in range(self._bits.shape[1]))
                for row in range(self._bits.shape[0])]  # fmt: skip

    def _character(self, row: int, column: int) -> str:
        bits = int(self._bits[row, column])
        return self._letters.get((row, column)) or (chr(_BLANK + bits) if bits else " ")

    def _dot_at(self, point: NDArray[np.float64]) -> tuple[int, int]:
        x, y = float(point[0]), float(point[1])
        return round((x - self._left) / self._dot), round((self._top - y) / self._dot)

    def _set(self, point: NDArray[np.float64]) -> None:
        column, row = self._dot_at(point)
        rows, columns = self._bits.shape
        if 0 <= column < 2 * columns and 0 <= row < 4 * rows:
            self._bits[row // 4, column // 2] |= _DOT_BITS[row % 4][column % 2]


def robot_drawing(robot: Robot) -> str:
    """Return the robot seen from its right and from above, both to one scale, as lines of text.

    The body appears as its two discs of equal mass (`ballbot.robot.drawing`), o marks the centre of mass and
    the digits number the wheels.
    """
    dot = _dot_size(robot)
    side, top = _view(robot, "side", dot), _view(robot, "top", dot)
    width = len(side[0])
    above = max(len(side) - len(top), 0) // 2
    pairs = zip_longest(side, [""] * above + top, fillvalue="")
    title = f"{'side (x right, z up)':<{width + _GAP}}top (x right, y up)"
    drawn = [f"{left:<{width + _GAP}}{right}".rstrip() for left, right in pairs]
    return "\n".join([title, *drawn, _scale_bar(dot)])


def _dot_size(robot: Robot) -> float:
    """Return the metres a dot at which both views fit beside each other."""
    side, top = extent(robot, "side"), extent(robot, "top")
    widths = side[1] - side[0] + top[1] - top[0]
    tallest = max(side[3] - side[2], top[3] - top[2])
    # two characters go to rounding each view up to whole ones
    return max(tallest / (4.0 * (_ROWS - 2)), widths / (2.0 * (_COLUMNS - _GAP - 4)))


def _view(robot: Robot, view: View, dot: float) -> list[str]:
    left, right, bottom, top = extent(robot, view)
    canvas = Canvas(left=left, right=right, bottom=bottom, top=top, dot=dot)
    canvas.curve(_circle(robot.ball.radius))
    shape = body_shape(robot.body)
    if view == "side":
        canvas.curve(np.array([[left, -robot.ball.radius], [right, -robot.ball.radius]]))
        canvas.curve(_rectangle(shape.radius, shape.bottom, shape.top))
        canvas.letter(np.array([0.0, robot.body.center_of_mass]), "o")
    else:
        canvas.curve(_circle(shape.radius))
    wheels = wheel_shapes(robot)
    for index in back_to_front(wheels, view):
        for rim in wheel_rims(wheels[index], robot.wheels):
            canvas.curve(rim @ PROJECTIONS[view].T)
        canvas.letter(PROJECTIONS[view] @ wheels[index].center, str(index + 1))
    return canvas.lines()


def _circle(radius: float) -> NDArray[np.float64]:
    angle = np.linspace(0.0, 2.0 * math.pi, 121)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _rectangle(half_width: float, bottom: float, top: float) -> NDArray[np.float64]:
    w = half_width
    return np.array([[-w, bottom], [w, bottom], [w, top], [-w, top], [-w, bottom]])


def _scale_bar(dot: float) -> str:
    length = next(size for size in (0.5, 0.2, 0.1, 0.05, 0.02, 0.01) if size < 48.0 * dot or size == 0.01)
    return f"|{'-' * max(round(length / (2.0 * dot)) - 2, 0)}| {length:g} m"
