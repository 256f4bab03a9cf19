"""Adaptation: friction compensation that follows the friction as it changes, by warmth, another floor, a payload.

The compensation of wheel i is scaled by a_i, that of the rolling friction by a_r. Each sample's lost torque says by
how much they are off (normalised gradient; f_i the friction compensated and r_i the wheel's part in the rolling
friction, both unscaled):

    miss_i = lost_i - a_i f_i - a_r r_i
    a_i += h/T miss_i f_i / (f_i^2 + f_0^2)        a_r += h/T sum(miss_i r_i) / (sum(r_i^2) + f_0^2)

with a within its bounds, and at rest where nothing is told: while a wheel turns more slowly than the speed band, and
while a torque is at its limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballbot.control.torque_balance import TorqueBalance
from ballbot.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Adaptation:
    """How fast and how far the compensation follows.

    Raises
    ------
    InputError
        Where a number is not positive, or the bounds leave no room for 1.
    """

    balance: TorqueBalance  #: of the robot
    time: float = 4.0  #: T, over which a wheel that turns forgets [s]
    lowest: float = 0.3  #: bound of the scales
    highest: float = 1.5  #: bound of the scales; above 1 the compensation may exceed what was identified
    floor: float = 0.03  #: f_0, friction below which little is told [N m]

    def __post_init__(self) -> None:
        for name in ("time", "floor"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} of an adaptation is {value:g}; it must be positive.")
        if not 0.0 <= self.lowest <= 1.0 <= self.highest < math.inf:
            raise InputError(
                f"The bounds of an adaptation are {self.lowest:g} and {self.highest:g}; 1 must lie between them."
            )


def pack_adaptation(adaptation: Adaptation | None, sample_time: float) -> list[float]:
    """Return h/T, the bounds and f_0^2; with no h/T where there is none."""
    if adaptation is None:
        return [0.0, 1.0, 1.0, 1.0]
    return [sample_time / adaptation.time, adaptation.lowest, adaptation.highest, adaptation.floor**2]
