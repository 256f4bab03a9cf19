"""A limit of the lean that errors command, so that no error of position or speed commands more than is available.

The part of K e for position and speed, K_p (e_x e_y e_x' e_y'), equals the torques of a lean error, the commanded lean
a = K_l^+ K_p (e_x e_y e_x' e_y'). First the position errors are scaled down together if they alone command more than
the limit, so that a distant robot approaches no faster than it can be stopped; then all four if |a| still exceeds it.
While a fall or a push must be caught, the wheels' torque is thus available for the lean. (Saturations one within
another: A. Teel, Systems & Control Letters 18 (1992) 165-171.) The heading's error and its rate are limited by the turn
that they command. Within the limits nothing changes; beyond them integrals do not grow.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.part import LawSettings, Part, both_rows_times
from ballbot.control.records import number, whole
from ballbot.mechanics.engine.compiled import inlined
from ballbot.robot.parameters import parameter, parameter_class

#: indices of x, y and their rates in the state
_POSITION_PLACES = (0, 1, 5, 6)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeanLimitRecord:
    """The limits, and the lean that errors command."""

    on: int = field(default=1, metadata=whole())
    lean: float = field(metadata=number("rad"))
    asked: NDArray[np.float64] = field(metadata=number("rad/m", 2, 4))
    turn: float = field(metadata=number("rad"))
    turn_rate: float = field(metadata=number("s"))


@inlined
def limit_error(law, memory, e):
    """Return the error with position, speed and heading within the limits, and whether it is reduced."""
    own = law.lean_limit
    if own.on == 0:
        return e, False
    near, p, h = _fractions(own, memory.tuning, e)
    less = (near * p * e[0], near * p * e[1], e[2], e[3], h * e[4], p * e[5], p * e[6], e[7], e[8], h * e[9])
    return less, near * p * h < 1.0


@inlined
def _fractions(own, tuned, e):
    """Return the shares kept of the position, then of position and speed together, and of the heading."""
    near = _fraction(own.lean, *_commanded(own, tuned, (e[0], e[1], 0.0, 0.0)))
    p = _fraction(own.lean, *_commanded(own, tuned, (near * e[0], near * e[1], e[5], e[6])))
    return near, p, _fraction(own.turn, e[4] + (own.turn_rate + tuned.turn_rate) * e[9], 0.0)


@inlined
def _commanded(own, tuned, errors):
    """Return the lean that errors of position and speed command."""
    (first, second), (more, too) = both_rows_times(own.asked, errors), both_rows_times(tuned.asked, errors)
    return first + more, second + too


@inlined
def _fraction(limit, a, b):
    size = (a * a + b * b) ** 0.5
    return limit / size if size > limit else 1.0


@parameter_class
class LeanLimit(Part):
    """Limit the lean and the turn that errors may command.

    Scales down the errors of x, y [m] and their rates [m/s], heading frame, until the lean that they command under the
    gain is at most `lean`; the error of psi and its rate likewise for `turn`. Errors of theta and phi pass unchanged.
    Without the limit, a robot with a stiff gain falls from leans that it recovers from with a soft one.

    InputError if a limit is not positive.
    """

    label = "lean limit"
    comment = (
        "Errors of position and speed command at most this lean, errors of the heading at most this turn."
    )
    record = LeanLimitRecord

    lean: float = parameter("largest commanded lean", "rad", default=0.1)
    turn: float = parameter("largest commanded turn, with the contribution of its rate", "rad", default=0.5)

    def numbers(self, settings: LawSettings) -> LeanLimitRecord:
        """Return the limits with the lean that the gain commands."""
        gain, heading = settings.gain, settings.gain[:, 4]
        return LeanLimitRecord(
            lean=self.lean,
            asked=np.asarray(np.linalg.pinv(gain[:, 2:4]) @ gain[:, _POSITION_PLACES], dtype=np.float64),
            turn=self.turn,
            # the heading's error that is worth one of its rate
            turn_rate=float(heading @ gain[:, 9] / max(float(heading @ heading), 1e-300)),
        )
