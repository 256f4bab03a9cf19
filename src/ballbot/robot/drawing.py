"""A robot drawn to scale in text, side view and top view, from the dots of braille characters."""

from __future__ import annotations

import math
from itertools import pairwise, zip_longest

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.outline import (
    PROJECTIONS,
    View,
    back_to_front,
    body_shape,
    extent,
    wheel_rims,
    wheel_shapes,
)
from ballbot.robot.robot import Robot

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
            for share in np.linspace(0.0, 1.0, steps + 1):
                self._set(start + share * (end - start))

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

    The body appears as its two discs of equal mass (`ballbot.robot.outline`), o marks the centre of mass and
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
