"""A notch: it removes a narrow band about a resonance from each wheel's torque.

    H(s) = (s^2 + depth width w s + w^2) / (s^2 + width w s + w^2)        w = 2 pi frequency

sampled by the bilinear transform with w prewarped. Slow torques pass unchanged in size but with a phase lag: well below
w it is about (1 - depth) width f / frequency [rad] at a frequency f, so a notch far above the loop's crossover is cheap
and one near it is not.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.part import LawSettings, Part
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole
from ballbot.robot.parameters import parameter, parameter_class


@dataclass(frozen=True, kw_only=True, eq=False)
class NotchRecord:
    """(b_0 + b_1/z + b_2/z^2) / (1 + a_1/z + a_2/z^2)."""

    on: int = field(default=1, metadata=whole())
    b_0: float = field(metadata=number("1"))
    b_1: float = field(metadata=number("1"))
    b_2: float = field(metadata=number("1"))
    a_1: float = field(metadata=number("1"))
    a_2: float = field(metadata=number("1"))


@dataclass(frozen=True, kw_only=True, eq=False)
class NotchState:
    """Of each wheel's filter."""

    delayed: NDArray[np.float64] = field(metadata=number("N m", MAX_WHEELS, 2))


@inlined
def notched(law, memory, torque, i):
    """Return a wheel's torque through the notch, and step its state."""
    own, delayed = law.notch, memory.notch.delayed
    if own.on == 0:
        return torque
    left = own.b_0 * torque + delayed[i, 0]
    delayed[i, 0] = own.b_1 * torque - own.a_1 * left + delayed[i, 1]
    delayed[i, 1] = own.b_2 * torque - own.a_2 * left
    return left


@parameter_class
class Notch(Part):
    """Remove a narrow band from each wheel's torque [N m], such as a resonance that `ballbot validate` reports.

    Off by default. Torques lag by 7 to 8 degrees at 3 Hz; without play in the gears the error on the square rises.

    InputError if the frequency or the width is not positive, or the depth not a fraction; when the controller
    is made, if its sample time is too long for the frequency.
    """

    label = "notch"
    comment = "Torques pass a notch."
    record = NotchRecord
    state = NotchState

    frequency: float = parameter("centre of the band, such as a resonance", "Hz")
    width: float = parameter("of the band, over its frequency", default=1.4)
    depth: float = parameter("fraction of the torque left at its centre", default=0.15, least=0.0, most=1.0)

    def numbers(self, settings: LawSettings) -> NotchRecord:
        """Return the sampled filter."""
        return self.sampled(settings.sample_time)

    def sampled(self, sample_time: float) -> NotchRecord:
        """Return the filter for a sample time [s]. InputError if the sample time is too long for the frequency."""
        if not self.frequency < 0.45 / sample_time:
            raise InputError(
                f"A notch at {self.frequency:g} Hz needs a sample time below {0.45 / self.frequency:.2g} s; the "
                f"controller's sample time is {sample_time:g} s."
            )
        t = math.tan(math.pi * self.frequency * sample_time)
        scale, square = 1.0 + self.width * t + t * t, 1.0 + t * t
        middle, left = 2.0 * (t * t - 1.0) / scale, self.depth * self.width * t
        return NotchRecord(
            b_0=(square + left) / scale,
            b_1=middle,
            b_2=(square - left) / scale,
            a_1=middle,
            a_2=(square - self.width * t) / scale,
        )
