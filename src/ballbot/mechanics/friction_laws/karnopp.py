"""Karnopp's law: a dead zone of speeds that count as rest.

    |w| > D_v:  tau = b w + c sgn(w)          |w| <= D_v:  the inertia counts as at rest, tau = T within +-F_s

D. Karnopp, Computer simulation of stick-slip friction in mechanical dynamic systems, ASME Journal of Dynamic
Systems, Measurement, and Control 107, 1985. It was made for fixed steps that never meet zero speed; so speeds below
D_v are lost, and an inertia that stuck while turning forwards must cross the whole zone before it turns back.
Within the zone the integrated speed (the paper's momentum) keeps its value while friction balances the torque, and
gains by what exceeds F_s. A step ends exactly where the zone begins, and goes on from there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.friction import sign
from ballbot.mechanics.friction_laws.interface import available, check_values, register, slide, time_to_slow


class KarnoppNumbers(NamedTuple):
    """Karnopp's law in compiled code; s, inv_vs and delta say that sliding knows no Stribeck effect."""

    b: float
    c: float
    s: float
    inv_vs: float
    delta: float
    static: float
    zone: float


@dataclass(frozen=True, kw_only=True)
class Karnopp:
    """Coulomb and viscous friction, static friction in a dead zone of speeds.

    Raises
    ------
    InputError
        Where a value is negative or not finite, the dead zone is zero, or the static friction is below what acts
        at the zone's edge.
    """

    viscous: float  #: b [N m s/rad]
    coulomb: float  #: c [N m]
    static: float  #: F_s [N m], what holds in the dead zone
    dead_zone: float  #: D_v [rad/s]

    def __post_init__(self) -> None:
        check_values(self, positive=("dead_zone",), not_negative=("viscous", "coulomb", "static"))
        at_edge = self.coulomb + self.viscous * self.dead_zone
        if self.static < at_edge:
            raise InputError(
                f"Karnopp's static friction is {self.static:g}, below the {at_edge:g} at the edge of the dead "
                "zone; it must be at least as large, or a torque between the two neither moves nor holds the "
                "wheel."
            )

    def numbers(self) -> KarnoppNumbers:
        """Return what compiled code reads."""
        return KarnoppNumbers(
            b=self.viscous,
            c=self.coulomb,
            s=0.0,
            inv_vs=1.0,
            delta=1.0,
            static=self.static,
            zone=self.dead_zone,
        )

    def initial_state(self, step: float) -> NDArray[np.float64]:  # noqa: ARG002 (the interface's)
        """Return the empty state."""
        return np.empty(0)

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return b w + c sgn(w) [N m] at speeds (...), 0 in the dead zone."""
        w = np.asarray(speed, dtype=float)
        return np.where(np.abs(w) > self.dead_zone, self.viscous * w + self.coulomb * np.sign(w), 0.0)

    def explicit_slope(self) -> float:
        """Return b [N m s/rad]."""
        return self.viscous


@inlined
def _friction(law, state, speed, applied):
    if abs(speed) <= law.zone:
        return min(max(applied, -law.static), law.static)
    return law.b * speed + sign(speed) * law.c


@inlined
def _settle(law, state, before, after, h):
    return None


@inlined
def _cross_zone(law, inertia, torque, speed, h) -> tuple[float, float]:
    """Move within the dead zone, and out of it where the torque exceeds F_s for long enough."""
    T = available(inertia, torque, 0.0)
    excess = T - min(max(T, -law.static), law.static)
    if excess == 0.0:
        return speed, 0.0
    acceleration = inertia.inv_J * excess
    edge = sign(excess) * law.zone
    if acceleration * h * sign(excess) <= (edge - speed) * sign(excess):
        return speed + acceleration * h, 0.0
    return slide(law, inertia, torque, edge, sign(excess), h - (edge - speed) / acceleration)


@inlined
def _move(law, inertia, torque, state, speed, h):
    if abs(speed) <= law.zone:
        return _cross_zone(law, inertia, torque, speed, h)
    direction = sign(speed)
    end, travel = slide(law, inertia, torque, speed, direction, h)
    if direction * end > law.zone:
        return end, travel
    stop = time_to_slow(law, inertia, torque, speed, direction, law.zone, h)
    _, travel = slide(law, inertia, torque, speed, direction, stop)
    end, further = _cross_zone(law, inertia, torque, direction * law.zone, h - stop)
    return end, travel + further


@inlined
def _visible(law, speed):
    return speed if abs(speed) > law.zone else 0.0


register(KarnoppNumbers, friction=_friction, settling=_settle, moving=_move, visible=_visible)
