"""Standing still: what friction compensation does where a wheel's speed says little.

Below the speed band the sign of a speed is a ramp (`ballbot.control.law`), so that a wheel at rest is not compensated
at all: it sticks until the feedback alone overcomes its break-away torque, and then jumps. Two cures, each a share
from 0 (off) to 1:

    ahead      the speed compensated is w + ahead (w_d - w), w_d that of the motion asked for: friction is paid
               before the wheel turns, and at a spot there is nothing to chatter
    feed       within the band, feed (1 - |ramp(w)|) (c + s) u/u_0 besides, u the law's own torque, between -1 and 1:
               a wheel at rest gets its break-away torque in the direction in which it is pushed
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballbot.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Standstill:
    """How friction is compensated about zero speed.

    Raises
    ------
    InputError
        Where a share is not between 0 and 1, or the torque is not positive.
    """

    ahead: float = 0.0  #: share of the speed asked for in the speed compensated
    feed: float = 0.0  #: share of the break-away torque that a wheel at rest is given
    feed_torque: float = 0.2  #: u_0, the law's torque at which it is given in full [N m]

    def __post_init__(self) -> None:
        for name in ("ahead", "feed"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise InputError(f"{name} of the standstill is {value:g}; it must be from 0 to 1.")
        if not (math.isfinite(self.feed_torque) and self.feed_torque > 0.0):
            raise InputError(
                f"feed_torque of the standstill is {self.feed_torque:g} N m; it must be positive."
            )


#: numbers that `pack_standstill` returns
STANDSTILL_SIZE = 3


def pack_standstill(standstill: Standstill | None) -> list[float]:
    """Return share ahead, share fed and 1/u_0; no share of anything where there is none."""
    if standstill is None:
        return [0.0, 0.0, 1.0]
    return [standstill.ahead, standstill.feed, 1.0 / standstill.feed_torque]
