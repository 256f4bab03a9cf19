"""A disturbance observer: the torque that is lost is given back, whatever took it. Friction need not be known.

    d' = w (lost - d),      u += d

The model-free rival of friction compensation: it pays for friction, slope and payload alike, late by 1/w, and hands
the sensors' noise on. With a compensation it gives back what that leaves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballbot.control.parts.torque_balance import TorqueBalance
from ballbot.errors import InputError


@dataclass(frozen=True, kw_only=True)
class DisturbanceObserver:
    """How the lost torque is given back.

    Raises
    ------
    InputError
        Where a number is not positive.
    """

    balance: TorqueBalance  #: of the robot
    frequency: float = 10.0  #: w of the lag [rad/s]
    limit: float = 0.5  #: most that a wheel is given back [N m]

    def __post_init__(self) -> None:
        for name in ("frequency", "limit"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} of the disturbance observer is {value:g}; it must be positive.")


def pack_observer(observer: DisturbanceObserver | None, sample_time: float) -> list[float]:
    """Return the part of the way that d goes in a sample, and the limit; zero where there is none."""
    if observer is None:
        return [0.0, 0.0]
    return [-math.expm1(-observer.frequency * sample_time), observer.limit]
