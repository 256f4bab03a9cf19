"""Unwrap headings sample by sample: a jump from pi to -pi, or from 2 pi to 0, is not a motion.

A jump of more than `JUMP` between two successive values within one turn (-pi to pi, or 0 to 2 pi) is a wrap: the
heading continues by the shorter way. A smaller jump is a motion, so that a commanded step of pi keeps its sign. Values
beyond one turn count turns by themselves and stay as they are.
"""

import math
from dataclasses import dataclass

from ballbot.log.wrapping import LARGEST_TURN
from ballbot.mechanics.engine.compiled import inlined

TURN = 2.0 * math.pi  #: [rad]
#: the smallest jump that is a wrap [rad], as in a log
JUMP = LARGEST_TURN
#: noise that may carry a value beyond one turn [rad]
_NOISE = 0.1


def turns_after(angle: float, last: float, turns: int) -> int:
    """Return the whole turns to add to a heading [rad], from the value before it and the turns added to that."""
    low, high = min(angle, last), max(angle, last)
    if angle < -0.5 * TURN - _NOISE or angle > TURN + _NOISE:
        return 0
    about_zero = low >= -0.5 * TURN - _NOISE and high <= 0.5 * TURN + _NOISE
    above_zero = low >= -_NOISE and high <= TURN + _NOISE
    if high - low > JUMP and (about_zero or above_zero):
        return turns + 1 if angle < last else turns - 1
    return turns


#: the same for compiled code
compiled_turns_after = inlined(turns_after)
#: a turn in single precision, and what it lacks [rad]
_SINGLE_TURN, _LACKING = 6.2831854820251465, -1.7484556025237907e-07


@inlined
def unwrapped(memory, angle):
    """Return the next value of a heading [rad] without a jump of a turn; the memory is zero before the first one."""
    last = memory.last if memory.started == 1 else angle
    memory.turns = compiled_turns_after(angle, last, memory.turns)
    memory.last = angle
    memory.started = 1
    return (angle + _SINGLE_TURN * memory.turns) + _LACKING * memory.turns


@dataclass
class Heading:
    """An unwrapped heading, fed one value at a time."""

    last: float | None = None  #: the last value, as measured [rad]
    turns: int = 0  #: whole turns added to it

    def unwrapped(self, angle: float) -> float:
        """Return the next value without a jump of a turn [rad]."""
        self.turns = turns_after(angle, angle if self.last is None else self.last, self.turns)
        self.last = angle
        return angle + TURN * self.turns
