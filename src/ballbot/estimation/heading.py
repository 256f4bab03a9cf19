"""Unwrap headings sample by sample: a jump from pi to -pi, or from 2 pi to 0, is not a motion.

A jump of more than `JUMP` between two successive values within one turn (-pi to pi, or 0 to 2 pi) is a wrap: the
heading continues by the shorter way. A smaller jump is a motion, so that a commanded step of pi keeps its sign. Values
beyond one turn count turns by themselves and stay as they are.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ballbot.log.wrapping import LARGEST_TURN
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.records import number, schema_of, whole

TURN = 2.0 * math.pi  #: [rad]
#: the smallest jump that is a wrap [rad], as in a log
JUMP = LARGEST_TURN
#: noise that may carry a value beyond one turn [rad]
_NOISE = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadingMemory:
    """The last value of a heading that wraps around, and the whole turns since the start."""

    started: int = field(metadata=whole())
    last: float = field(metadata=number("rad"))
    turns: int = field(metadata=whole())


HEADING = schema_of(HeadingMemory)
_HEADING_TYPE = HEADING.dtype()


@inlined
def turns_after(angle, last, turns):
    """Return the whole turns to add to a heading [rad], from the value before it and the turns added to that."""
    low, high = min(angle, last), max(angle, last)
    if angle < -0.5 * TURN - _NOISE or angle > TURN + _NOISE:
        return 0
    about_zero = low >= -0.5 * TURN - _NOISE and high <= 0.5 * TURN + _NOISE
    above_zero = low >= -_NOISE and high <= TURN + _NOISE
    if high - low > JUMP and (about_zero or above_zero):
        return turns + 1 if angle < last else turns - 1
    return turns


#: a turn in single precision, and what it lacks [rad]
_SINGLE_TURN, _LACKING = 6.2831854820251465, -1.7484556025237907e-07


@inlined
def unwrapped(memory, angle):
    """Return the next value of a heading [rad] without a jump of a turn; the memory is zero before the first one."""
    last = memory.last if memory.started == 1 else angle
    memory.turns = turns_after(angle, last, memory.turns)
    memory.last = angle
    memory.started = 1
    return (angle + _SINGLE_TURN * memory.turns) + _LACKING * memory.turns


@compiled
def _unwrapped(memory, angle):
    return unwrapped(memory.view(_HEADING_TYPE)[0], angle)


class Heading:
    """An unwrapped heading, fed one value at a time."""

    def __init__(self) -> None:
        self._memory = HEADING.zeros().view(np.float64)

    def unwrapped(self, angle: float) -> float:
        """Return the next value without a jump of a turn [rad]."""
        return _unwrapped(self._memory, angle)
