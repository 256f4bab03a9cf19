"""A limit of the lean that errors command, so that no error of position or speed commands more than is available.

The part of K e for position and speed, K_p (e_x e_y e_x' e_y'), equals the torques of a lean error, the commanded lean
a = K_l^+ K_p (e_x e_y e_x' e_y'). First the position errors are scaled down together if they alone command more than
the limit, so that a distant robot approaches no faster than it can be stopped; then all four if |a| still exceeds it.
While a fall or a push must be caught, the wheels' torque is thus available for the lean. (Saturations one within
another: A. Teel, Systems & Control Letters 18 (1992) 165-171.) The heading's error and its rate are limited by the turn
that they command. Within the limits nothing changes; beyond them integrals do not grow.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.part import LawSettings, Part, RobotState
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import number, whole
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


class LimitedError(NamedTuple):
    """An error within the limits, and whether it is reduced."""

    e: RobotState
    limited: bool


@inlined
def limit_error(law, memory, e):
    """Return the error with position, speed and heading within the limits."""
    own, tuned = law.lean_limit, memory.tuning
    if own.on == 0:
        return LimitedError(e, False)
    near = _lean_fraction(own, tuned, e.x, e.y, 0.0, 0.0)
    both = _lean_fraction(own, tuned, near * e.x, near * e.y, e.x_dot, e.y_dot)
    heading = _fraction(own.turn, e.psi + (own.turn_rate + tuned.turn_rate) * e.psi_dot, 0.0)
    less = RobotState(
        near * both * e.x,
        near * both * e.y,
        e.theta,
        e.phi,
        heading * e.psi,
        both * e.x_dot,
        both * e.y_dot,
        e.theta_dot,
        e.phi_dot,
        heading * e.psi_dot,
    )
    return LimitedError(less, near * both * heading < 1.0)


@inlined
def _lean_fraction(own, tuned, x, y, v_x, v_y):
    """Return the fraction that is kept of errors of position and speed."""
    first = _commanded(own.asked[0], x, y, v_x, v_y) + _commanded(tuned.asked[0], x, y, v_x, v_y)
    second = _commanded(own.asked[1], x, y, v_x, v_y) + _commanded(tuned.asked[1], x, y, v_x, v_y)
    return _fraction(own.lean, first, second)


@inlined
def _commanded(asked, x, y, v_x, v_y):
    """Return a lean that errors of position and speed command."""
    return asked[0] * x + asked[1] * y + asked[2] * v_x + asked[3] * v_y


@inlined
def _fraction(limit, a, b):
    """Return limit / |(a, b)|, or 1 within the limit."""
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
