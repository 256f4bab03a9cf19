"""The floor's friction on the ball (thesis 3.7); the formula stands here only.

    F = -N C_rr v/|v|,    N = (m_b + m_r) g

N C_rr is `Robot.rolling_force`, and `P.rolling_force` in compiled code. It brakes a ball that rolls, and holds one at
rest against any force up to it: the disc of the convex step (`engine/convex.py`, `stick_slip.py`). A ball that pivots
has pivoting friction of constant size against its spin.

NumPy's form is `rolling_friction`. The compiled one is `floor_friction`; `floor_margin` and `rolling_margin` find where
it may change its direction.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.engine.tracing import both, greatest, least, root, traced, where
from ballbot.mechanics.friction import sign

#: a ball slower than this [m/s, rad/s] is at rest
REST = 1e-9
#: estimated or wanted speed below which friction counts in proportion [m/s]; single precision holds it exactly
SLOW = 0.046875
_NO_SPEED = 1e-300  # in place of a speed of zero, which has no direction


def rolling_friction(
    velocity: ArrayLike, rolling_force: float, *, slowest: float = _NO_SPEED
) -> NDArray[np.float64]:
    """Return the force (..., 2) [N] of the floor on a ball of velocity v (..., 2) [m/s], -N C_rr v/|v|, zero at rest.

    `rolling_force` is N C_rr [N]; below the speed `slowest` [m/s] the force falls in proportion to the speed.
    """
    v = np.asarray(velocity, dtype=float)
    return -rolling_force * v / np.maximum(np.hypot(v[..., 0], v[..., 1]), slowest)[..., None]


# --- compiled: of `RobotNumbers` P, at a velocity v (2,), or (3,) with the spin where the ball pivots ---


class FloorFriction(NamedTuple):
    """The floor's friction on the ball."""

    force: tuple  #: on v: rolling, -N C_rr v/|v|, and pivoting, against the spin
    holding: float  #: largest torque that keeps a ball without spin so [N m]; zero where it spins


@traced
def floor_friction(P, v):
    """Return the floor's friction at a velocity v."""
    brake = rolling_brake(P.rolling_force, root(v[0] * v[0] + v[1] * v[1]))
    F = (-brake * v[0], -brake * v[1])
    if len(v) == 2:
        return FloorFriction(F, 0.0)
    return FloorFriction((*F, -P.pivoting * sign(v[2])), where(v[2] == 0.0, P.pivoting, 0.0))


@traced
def rolling_brake(rolling_force, speed):
    """Return N C_rr/|v|, the factor of the velocity in the force; finite at rest."""
    return rolling_force / greatest(speed, _NO_SPEED)


def rolling_margin(P, v):
    """Return a number that is positive if the ball rolls, or has no rolling friction."""
    return where(P.rolling_force > 0.0, v[0] * v[0] + v[1] * v[1] - REST * REST, 1.0)


def floor_margin(P, start, state):
    """Return a number that stays positive while the ball rolls on forward and spins the same way."""
    forward = where(P.rolling_force > 0.0, start[5] * state[5] + start[6] * state[6], 1.0)
    if len(start) == 10:
        return forward
    before, spin = start[10], state[10]
    keeps = where(both(before == 0.0, spin == 0.0), 1.0, before * spin)  # or stays zero
    return least(forward, where(P.pivoting > 0.0, keeps, 1.0))
