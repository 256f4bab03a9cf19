"""The lean that the law may ask for is bounded, so that an error of place or speed cannot ask for more than there is.

K e is a torque for each wheel, and its part for place and speed, K_p (e_x e_y e_x' e_y'), is what a lean error
a = K_l^+ K_p (e_x e_y e_x' e_y') would give: the lean asked for. First the errors of place are made smaller where they
alone ask for more than the limit, in one ratio, so that a robot far away comes no faster than it can be stopped; then
all four, where |a| is still beyond it. So while a fall or a push must be caught, the wheels' torque is left to the
lean. (Saturations one within another: A. Teel, Systems & Control Letters 18 (1992) 165-171.) The heading's error and
its rate are bounded by the turn they ask for. Nothing changes within the limits; beyond them integrals do not grow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined

if TYPE_CHECKING:
    from ballbot.control.controller import Controller

#: where x, y and their rates stand in the state
_PLACE = (0, 1, 5, 6)


@dataclass(frozen=True, kw_only=True)
class LeanLimit:
    """How much lean, and how much of a turn, errors may ask for.

    Raises
    ------
    InputError
        Where a limit is not positive.
    """

    lean: float = 0.1  #: [rad]
    turn: float = 0.5  #: e_psi with what its rate adds [rad]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{field.name} of the lean limit is {value:g}; it must be positive.")


def lean_asked(gain: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lean (2, 4) [rad] that errors of x, y [m] and of their rates [m/s] ask for under a gain (n, 10)."""
    return np.asarray(np.linalg.pinv(gain[:, 2:4]) @ gain[:, _PLACE], dtype=np.float64)


def turn_asked(gain: NDArray[np.float64]) -> float:
    """Return the heading's error [rad] that is worth one of its rate [rad/s] under a gain (n, 10)."""
    heading = gain[:, 4]
    return float(heading @ gain[:, 9] / max(float(heading @ heading), 1e-300))


#: numbers that `pack_bound` returns
BOUND_SIZE = 11


def pack_bound(controller: Controller) -> list[float]:
    """Return the numbers that `bounded` reads; all zero where there is no bound."""
    bound = controller.parts.lean_bound
    if bound is None:
        return [0.0] * BOUND_SIZE
    asked = lean_asked(controller.gain).ravel().tolist()
    return [bound.lean, *asked, bound.turn, turn_asked(controller.gain)]


@inlined
def bounded(row, place, e):
    """Return the heading frame's error (10,) with no more of place, speed and heading than may be asked for."""
    near, p, h = _shares(row, place, e)
    return near * p * e[0], near * p * e[1], e[2], e[3], h * e[4], p * e[5], p * e[6], e[7], e[8], h * e[9]


@inlined
def asks_much(row, place, e):
    """Return whether `bounded` makes the error smaller; integrals then may only shrink."""
    near, p, h = _shares(row, place, e)
    return near * p * h < 1.0


@inlined
def _shares(row, place, e):
    """Return what is left of the place, then of place and speed together, and of the heading."""
    near = _share(row[place], *_lean(row, place, e[0], e[1], 0.0, 0.0))
    p = _share(row[place], *_lean(row, place, near * e[0], near * e[1], e[5], e[6]))
    return near, p, _share(row[place + 9], e[4] + row[place + 10] * e[9], 0.0)


@inlined
def _share(limit, a, b):
    size = (a * a + b * b) ** 0.5
    return limit / size if size > limit else 1.0


@inlined
def _lean(row, place, x, y, v_x, v_y):
    """Return the lean that errors ask for."""
    one, other = place + 1, place + 5
    return (
        row[one] * x + row[one + 1] * y + row[one + 2] * v_x + row[one + 3] * v_y,
        row[other] * x + row[other + 1] * y + row[other + 2] * v_x + row[other + 3] * v_y,
    )
