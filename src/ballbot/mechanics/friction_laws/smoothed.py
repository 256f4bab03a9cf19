"""The classical law with a smoothed sign, for comparison with tools that have nothing else.

    tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sigma(w),    sigma = tanh(w/eps) or w/sqrt(w^2 + eps^2)

It never sticks: under any torque below c + s the inertia creeps, at about eps T/(c + s). It is stiff for small eps,
so a step is implicit (two stages, order two, L-stable: R. Alexander, Diagonally implicit Runge-Kutta methods for
stiff O.D.E.'s, SIAM Journal on Numerical Analysis 14, 1977).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.elementary import exponential
from ballbot.mechanics.friction import dry_friction, stribeck_decay
from ballbot.mechanics.friction_laws.interface import available, check_values, clamped, crossing, register

SmoothSign = Literal["tanh", "root"]

_GAMMA = 1.0 - 0.5**0.5  # Alexander's


class SmoothedNumbers(NamedTuple):
    """The smoothed law in compiled code."""

    b: float
    c: float
    s: float
    inv_vs: float
    delta: float
    width: float
    tanh: float  #: 1 for tanh, 0 for the root


@dataclass(frozen=True, kw_only=True)
class Smoothed:
    """Static, Coulomb, viscous and Stribeck friction with a smoothed sign: it creeps where it should stick.

    Raises
    ------
    InputError
        If a value is negative or not finite, the width, Stribeck speed or exponent is zero, or the sign has
        another name.
    """

    viscous: float  #: b [N m s/rad]
    coulomb: float  #: c [N m]
    stribeck: float = 0.0  #: s [N m], break-away above Coulomb
    stribeck_speed: float = 1.0  #: v_s [rad/s]
    stribeck_exponent: float = 2.0  #: delta [-]
    width: float  #: eps [rad/s]
    sign: SmoothSign = "tanh"  #: tanh(w/eps), or "root": w/sqrt(w^2 + eps^2)

    def __post_init__(self) -> None:
        check_values(
            self,
            positive=("width", "stribeck_speed", "stribeck_exponent"),
            not_negative=("viscous", "coulomb", "stribeck"),
        )
        if self.sign not in ("tanh", "root"):
            raise InputError(f"Smoothed's sign is {self.sign!r}; it must be 'tanh' or 'root'.")

    def numbers(self) -> SmoothedNumbers:
        """Return the law's numbers for compiled code."""
        return SmoothedNumbers(
            b=self.viscous,
            c=self.coulomb,
            s=self.stribeck,
            inv_vs=1.0 / self.stribeck_speed,
            delta=self.stribeck_exponent,
            width=self.width,
            tanh=1.0 if self.sign == "tanh" else 0.0,
        )

    def initial_state(self, step: float) -> NDArray[np.float64]:  # noqa: ARG002 (the interface's)
        """Return the empty state."""
        return np.empty(0)

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return tau(w) [N m] at speeds (...)."""
        w = np.asarray(speed, dtype=float)
        smooth = np.tanh(w / self.width) if self.sign == "tanh" else w / np.hypot(w, self.width)
        decay = stribeck_decay(w / self.stribeck_speed, self.stribeck_exponent)
        return self.viscous * w + (self.coulomb + self.stribeck * decay) * smooth

    def explicit_slope(self) -> float:
        """Return the falling slope [N m s/rad] that a step must resolve for its implicit equation to have one root."""
        return self.stribeck * max(self.stribeck_exponent, 1.0) / self.stribeck_speed


@inlined
def _smooth_sign(law, speed):
    if law.tanh == 1.0:
        decay = exponential(-2.0 * abs(speed) / law.width)
        size = (1.0 - decay) / (1.0 + decay)
        return size if speed >= 0.0 else -size
    return speed / (speed * speed + law.width * law.width) ** 0.5


@inlined
def _friction(law, state, speed, applied):
    return law.b * speed + dry_friction(law, speed) * _smooth_sign(law, speed)


@inlined
def _settle(law, state, before, after, h):
    return None


@inlined
def _acceleration(law, inertia, torque, speed):
    seen = clamped(inertia, speed)
    friction = law.b * seen + dry_friction(law, seen) * _smooth_sign(law, seen)
    return inertia.inv_J * (available(inertia, torque, speed) - friction)


@inlined
def _excess(speed, context):
    law, inertia, torque, base, h = context
    return speed - base - h * _acceleration(law, inertia, torque, speed)


@inlined
def _implicit_stage(law, inertia, torque, base, h):
    """Return the root of w = base + h a(w); viscous friction and a supply's curve only draw it towards zero."""
    reach = abs(base) + h * inertia.inv_J * (abs(torque) + law.c + law.s)
    return crossing(_excess, (law, inertia, torque, base, h), -reach - 1e-300, reach + 1e-300)


@inlined
def _move(law, inertia, torque, state, speed, h):
    w1 = _implicit_stage(law, inertia, torque, speed, _GAMMA * h)
    a1 = (w1 - speed) / (_GAMMA * h)
    end = _implicit_stage(law, inertia, torque, speed + (1.0 - _GAMMA) * h * a1, _GAMMA * h)
    travel = h * ((1.0 - _GAMMA) * clamped(inertia, w1) + _GAMMA * clamped(inertia, end))
    return end, travel


register(SmoothedNumbers, friction=_friction, settling=_settle, moving=_move)
