"""The inertia that a friction law slows down, with the drive's speed limit: J w_dot = T(u, w) - tau.

The limit is a torque-speed curve, |T| up to T_stall (1 -+ w/w_0), or the thesis's clamp (3.2) of the speed that
friction and sensors see while the integrated one runs on. Without a limit both are far away.
"""

from typing import NamedTuple

from ballbot.mechanics.compiled import inlined

#: stands for "no limit"; finite, so that it stays a number when multiplied by zero
UNLIMITED = 1e200


class Inertia(NamedTuple):
    """A driven inertia, in compiled code."""

    inv_J: float  #: 1/J [1/(kg m^2)]
    clamp: float  #: l of (3.2) [rad/s]
    stall: float  #: torque available at rest [N m]
    inv_no_load: float  #: 1/w_0 [s/rad]


@inlined
def available(inertia, torque, speed):
    """Return the torque [N m] that the supply lets through at that speed."""
    lost = inertia.stall * (speed * inertia.inv_no_load)
    return min(max(torque, -inertia.stall - lost), inertia.stall - lost)


@inlined
def clamped(inertia, speed):
    """Return the speed within the thesis's clamp."""
    return min(max(speed, -inertia.clamp), inertia.clamp)
