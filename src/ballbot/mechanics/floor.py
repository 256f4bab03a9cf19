"""The floor's friction on the ball (thesis 3.7); the formula stands here only.

    F = -N C_rr v/|v|,    N = (m_b + m_r) g

N C_rr is `Robot.rolling_force`, and `P.rolling_force` in compiled code. It brakes a ball that rolls, and holds one at
rest against any force up to it: the disc of the convex step (`engine/convex.py`, `stick_slip.py`). A ball that pivots
has pivoting friction of constant size against its spin.

NumPy's form is `rolling_friction`. The compiled one is `floor_friction`; `floor_margin` and `rolling_margin` find where
it may change its direction.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.engine.compiled import by_types_of, inlined
from ballbot.mechanics.friction import sign

#: a ball slower than this [m/s, rad/s] is at rest
REST = 1e-9
_NO_SPEED = 1e-300  # in place of a speed of zero, which has no direction


def rolling_friction(
    velocity: ArrayLike, rolling_force: float, *, slowest: float = _NO_SPEED
) -> NDArray[np.float64]:
    """Return the force of the floor on a rolling ball, -N C_rr v/|v|, zero at rest.

    Parameters
    ----------
    velocity : array_like (..., 2)
        v [m/s].
    rolling_force : float
        N C_rr [N].
    slowest : float
        Speed [m/s] below which the force falls in proportion to the speed.

    Returns
    -------
    ndarray (..., 2)
        [N].
    """
    v = np.asarray(velocity, dtype=float)
    return -rolling_force * v / np.maximum(np.hypot(v[..., 0], v[..., 1]), slowest)[..., None]


# --- compiled: of `Parameters` P, at a velocity v (2,), or (3,) with the spin where the ball pivots ---


class FloorFriction(NamedTuple):
    """The floor's friction on the ball."""

    force: tuple  #: on v: rolling, -N C_rr v/|v|, and pivoting, against the spin
    holding: float  #: largest torque that keeps a ball without spin so [N m]; zero where it spins


def floor_friction(P, v) -> FloorFriction:  # pragma: no cover (compiled form below)
    """Return the floor's friction at a velocity v."""
    raise NotImplementedError("compiled code only")


@by_types_of(floor_friction)
def _floor_friction(P, v):
    if len(v) == 2:
        return lambda P, v: FloorFriction(_rolling_friction(P, v), 0.0)

    def with_pivoting(P, v):
        F = _rolling_friction(P, v)
        holding = P.pivoting if v[2] == 0.0 else 0.0
        return FloorFriction((F[0], F[1], -P.pivoting * sign(v[2])), holding)

    return with_pivoting


@inlined
def _rolling_friction(P, v):
    brake = rolling_brake(P.rolling_force, math.sqrt(v[0] * v[0] + v[1] * v[1]))
    return (-brake * v[0], -brake * v[1])


@inlined
def rolling_brake(rolling_force, speed):
    """Return N C_rr/|v|, the factor of the velocity in the force; finite at rest."""
    return rolling_force / max(speed, _NO_SPEED)


@inlined
def rolling_margin(P, v):
    """Return a number that is positive if the ball rolls, or has no rolling friction."""
    return v[0] * v[0] + v[1] * v[1] - REST * REST if P.rolling_force > 0.0 else 1.0


def floor_margin(P, start, state) -> float:  # pragma: no cover (compiled form below)
    """Return a number that stays positive while the ball rolls on forward and spins the same way."""
    raise NotImplementedError("compiled code only")


@by_types_of(floor_margin)
def _floor_margin(P, start, state):
    if len(start) == 10:
        return lambda P, start, state: _forward_margin(P, start, state)
    return lambda P, start, state: min(
        _forward_margin(P, start, state), _spin_margin(start[10], state[10]) if P.pivoting > 0.0 else 1.0
    )


@inlined
def _spin_margin(start, spin):
    """Return a number that is positive while the spin keeps its sign, or stays zero."""
    return start * spin if start != 0.0 or spin != 0.0 else 1.0


@inlined
def _forward_margin(P, start, state):
    return start[5] * state[5] + start[6] * state[6] if P.rolling_force > 0.0 else 1.0
