"""What a peak in the residuals' spectrum comes from, as far as its frequency says.

What is renewed every 1/f s makes lines at multiples of f, and those above half the sampling rate are folded down.
Rollers pass at a rate that follows the wheel's speed. Where the wheels turn evenly that names a peak; over uneven
speeds `ballbot.validation.residuals.position_effect` finds what comes back with their position, and a peak at a
frequency at which that came back may be it. What is neither is a resonance, of the robot or of the loop; one above half
the sampling rate shows folded down as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log import STATE_NAMES
from ballbot.robot import Rollers
from ballbot.validation.residuals.spectrum import Peak, Spectrum
from ballbot.validation.residuals.updates import Updates

#: multiples of a rate that are looked at
_HARMONICS = 6
#: wheels turn evenly where 80 % of their speeds are within this part of the median
_EVEN = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Clues:
    """What else a log tells about its frequencies."""

    updates: Updates
    turning: NDArray[np.float64] | None  #: (3,) [turns/s] 10 %, 50 % and 90 % of the wheels' speeds
    rollers: Rollers
    orders: tuple[int, ...]  #: times a turn of a wheel at which a residual torque comes back


@dataclass(frozen=True, kw_only=True)
class NamedPeak:
    """A frequency at which one state's residual or several have a peak."""

    frequency: float  #: [Hz]
    states: tuple[str, ...]
    cause: str


def named_peaks(found: Spectrum, clues: Clues) -> tuple[NamedPeak, ...]:
    """Return the peaks of all states, those within the resolution of each other as one, in order of frequency."""
    causes = [*_of_updates(found, clues), *_of_rollers(clues)]
    named = []
    for group in _groups(found):
        strongest = max(group, key=lambda peak: peak.ratio)
        frequency, apart = strongest.frequency, found.resolution
        near = [words for low, high, words in causes if low - apart <= frequency <= high + apart]
        states = tuple(STATE_NAMES[index] for index in sorted({peak.state for peak in group}))
        cause = near[0] if near else "a resonance, of the robot or of the loop, that the model lacks"
        named.append(NamedPeak(frequency=frequency, states=states, cause=cause))
    return tuple(named)


def _groups(found: Spectrum) -> Iterator[list[Peak]]:
    group: list[Peak] = []
    for peak in sorted(found.peaks, key=lambda one: one.frequency):
        if group and peak.frequency - group[-1].frequency > found.resolution:
            yield group
            group = []
        group.append(peak)
    if group:
        yield group


def _of_updates(found: Spectrum, clues: Clues) -> Iterator[tuple[float, float, str]]:
    """Yield from and to which frequency [Hz] what is slower than the log shows, and what that is."""
    rate, updates = 2.0 * float(found.frequencies[-1]), clues.updates
    slow = [
        (renewed, f"{name} is updated at only {renewed:.4g} Hz") for name, renewed in updates.states.items()
    ]
    if updates.torques is not None:
        slow.append((updates.torques, f"the control rate, {updates.torques:.4g} Hz"))
    for renewed, words in slow:
        for multiple in range(1, _HARMONICS + 1):
            folded = _folded(multiple * renewed, rate)
            yield folded, folded, words


def _of_rollers(clues: Clues) -> Iterator[tuple[float, float, str]]:
    """Yield from and to which frequency [Hz] what comes back with the wheels' position shows, and what that is."""
    if clues.turning is None:
        return
    slow, usual, fast = clues.turning
    if usual > 0.0 and fast - slow < _EVEN * usual:
        for rings in range(1, clues.rollers.rows + 1):
            passing = rings * clues.rollers.per_row * usual
            yield (
                passing,
                passing,
                f"rollers of {'one ring' if rings == 1 else 'all rings'} passing the contact",
            )
    for order in clues.orders:
        yield (
            order * slow,
            order * fast,
            f"something that recurs {order} times per turn of the wheels, or a resonance",
        )


def _folded(frequency: float, rate: float) -> float:
    """Return where a frequency appears when sampled at `rate`."""
    return abs(frequency - rate * round(frequency / rate))
