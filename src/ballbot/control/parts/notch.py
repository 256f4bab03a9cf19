"""A notch: each wheel's torque without a narrow band about a resonance that identification found.

    H(s) = (s^2 + depth width w s + w^2) / (s^2 + width w s + w^2)        w = 2 pi frequency

sampled by the bilinear rule that keeps w where it is. Slow torques pass as they are, but late: the phase that it
costs well below w is about (1 - depth) width times the frequency's share of w, in radians, so a notch far above the
loop's crossover is cheap and one near it is not. `Notch.response` says how much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined


@dataclass(frozen=True, kw_only=True)
class Notch:
    """What is taken out of the torques.

    Raises
    ------
    InputError
        Where the frequency or the width is not positive, or the depth not a share below 1.
    """

    frequency: float  #: of the resonance [Hz], as the residuals' spectrum tells it
    width: float = 1.4  #: of the band over its frequency [-]
    depth: float = 0.15  #: share of the torque at the frequency that is left [-]

    def __post_init__(self) -> None:
        for name in ("frequency", "width"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} of the notch is {value:g}; it must be positive.")
        if not 0.0 <= self.depth < 1.0:
            raise InputError(f"depth of the notch is {self.depth:g}; it must be at least 0 and below 1.")

    def response(self, frequencies: ArrayLike, sample_time: float) -> NDArray[np.complex128]:
        """Return the sampled notch's response at frequencies [Hz]: its size, and its phase.

        Raises
        ------
        InputError
            As `check` does.
        """
        b_0, b_1, b_2, a_1, a_2 = pack_notch(self, sample_time)
        z = np.exp(2j * np.pi * sample_time * np.asarray(frequencies, dtype=np.complex128))
        return np.asarray((b_0 * z**2 + b_1 * z + b_2) / (z**2 + a_1 * z + a_2), dtype=np.complex128)

    def check(self, sample_time: float) -> None:
        """Raise `InputError` where a controller of that sample time [s] cannot have it."""
        if not self.frequency < 0.45 / sample_time:
            raise InputError(
                f"A notch at {self.frequency:g} Hz needs a sample time below {0.45 / self.frequency:.2g} s; the "
                f"controller's sample time is {sample_time:g} s."
            )


#: numbers that `pack_notch` returns, and that a notch remembers of each wheel
NOTCH_SIZE, NOTCH_MEMORY = 5, 2


def pack_notch(notch: Notch | None, sample_time: float) -> list[float]:
    """Return b_0, b_1, b_2, a_1, a_2 of (b_0 + b_1/z + b_2/z^2) / (1 + a_1/z + a_2/z^2); zero where there is none."""
    if notch is None:
        return [0.0] * NOTCH_SIZE
    notch.check(sample_time)
    t = math.tan(math.pi * notch.frequency * sample_time)
    whole, square = 1.0 + notch.width * t + t * t, 1.0 + t * t
    middle, left = 2.0 * (t * t - 1.0) / whole, notch.depth * notch.width * t
    return [
        (square + left) / whole,
        middle,
        (square - left) / whole,
        middle,
        (square - notch.width * t) / whole,
    ]


@inlined
def notched(row, place, memory, first, torque):
    """Return a wheel's torque through the notch at that place of a row, and step its memory (2,)."""
    left = row[place] * torque + memory[first]
    memory[first] = row[place + 1] * torque - row[place + 3] * left + memory[first + 1]
    memory[first + 1] = row[place + 2] * torque - row[place + 4] * left
    return left
