"""The LuGre law: bristles that bend before they slide.

    z_dot = w - sigma_0 |w| z / g(w)              g(w) = c + s exp(-|w/v_s|^delta)
    tau = sigma_0 z + sigma_1(w) z_dot + b w      sigma_1(w) = sigma_1 exp(-(w/v_d)^2)

C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, A new model for control of systems with friction, IEEE
Transactions on Automatic Control 40, 1995; its F_C, F_S and sigma_2 are c, c + s and b, its delta is 2, and its
sigma_1 is constant (v_d infinite). v_d is Olsson's remedy (Control systems with friction, thesis, Lund 1996).

*It may drive.* With sigma_1 constant, the law takes more energy out than was put in when bristles loaded at low
speed meet a high one, unless sigma_1 s/c <= b (N. Barabanov and R. Ortega, Necessary and sufficient conditions for
passivity of the LuGre friction model, same journal 45, 2000). The paper's own parameters do that. So such values are
refused unless asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.elementary import exponential
from ballbot.mechanics.friction import dry_friction, stribeck_curve
from ballbot.mechanics.friction_laws.interface import (
    Bristles,
    available,
    check_values,
    linear_motion,
    register,
)


class LuGreNumbers(NamedTuple):
    """The LuGre law in compiled code."""

    b: float
    c: float
    s: float
    inv_vs: float
    delta: float
    sigma_0: float
    sigma_1: float
    inv_vd: float


@dataclass(frozen=True, kw_only=True)
class LuGre:
    """Bristles with a Stribeck curve. Its state is their deflection z [rad].

    Raises
    ------
    InputError
        If a value is negative or not finite (`damping_speed` may be infinite), one that divides is zero, or the
        friction could drive (see the module) and `may_drive` does not say that this is wanted.
    """

    viscous: float  #: b, the paper's sigma_2 [N m s/rad]
    coulomb: float  #: c [N m]
    stribeck: float  #: s [N m], break-away above Coulomb
    stribeck_speed: float  #: v_s [rad/s]
    stribeck_exponent: float = 2.0  #: delta [-]
    stiffness: float  #: sigma_0 [N m/rad]
    micro_damping: float  #: sigma_1 [N m s/rad]
    damping_speed: float = math.inf  #: v_d [rad/s], above which the micro-damping fades
    may_drive: bool = False  #: accept values with which the friction can drive

    def __post_init__(self) -> None:
        check_values(
            self,
            positive=("coulomb", "stribeck_speed", "stribeck_exponent", "stiffness"),
            not_negative=("viscous", "stribeck", "micro_damping"),
        )
        if not self.damping_speed > 0.0:
            raise InputError(
                f"LuGre's damping_speed is {self.damping_speed:g}; it must be above zero, or infinite for a "
                "constant micro-damping."
            )
        speed = None if self.may_drive else self.driving_speed()
        if speed is not None:
            raise InputError(
                f"LuGre's friction could inject energy at speeds like {speed:.2g}, because its micro_damping of "
                f"{self.micro_damping:g} acts on bristles deflected by {self.stribeck:g} beyond the steady "
                f"state. Use at most {self.viscous * self.coulomb / self.stribeck:.3g}, a damping_speed, or "
                "may_drive=True."
            )

    def driving_speed(self) -> float | None:
        """Return a speed [rad/s] at which bristles bent at low speed would drive, or None.

        With the energy sigma_0 z^2/2 in the bristles, the power that friction takes is, over |w|,
        x^2/g + (sigma_1 + b) |w| - sigma_1 |w| x/g with x = sigma_0 z in the speed's direction, which low speeds
        bring up to c + s. The friction never drives if that is never negative.
        """
        largest = self.coulomb + self.stribeck
        if self.micro_damping * self.stribeck <= self.viscous * self.coulomb:
            return None
        if math.isinf(self.damping_speed):
            # twice the speed from which g = c, x = c + s is the worst, and the power falls in a straight line
            excess = self.micro_damping * self.stribeck / self.coulomb - self.viscous
            falling = max(2.0 * largest / self.micro_damping, largest**2 / (self.coulomb * excess))
            return 2.0 * max(falling, 5.0 * self.stribeck_speed)
        w = np.geomspace(1e-6, 30.0, 4000) * self.damping_speed
        sigma_1 = self.micro_damping * np.exp(-((w / self.damping_speed) ** 2))
        g = self.steady_friction(w) - self.viscous * w
        x = np.minimum(0.5 * sigma_1 * w, largest)
        power = x * x / g + (sigma_1 + self.viscous) * w - sigma_1 * w * x / g
        worst = int(np.argmin(power / w))
        return float(w[worst]) if power[worst] < 0.0 else None

    def numbers(self) -> LuGreNumbers:
        """Return the law's numbers for compiled code."""
        return LuGreNumbers(
            b=self.viscous,
            c=self.coulomb,
            s=self.stribeck,
            inv_vs=1.0 / self.stribeck_speed,
            delta=self.stribeck_exponent,
            sigma_0=self.stiffness,
            sigma_1=self.micro_damping,
            inv_vd=1.0 / self.damping_speed,
        )

    def initial_state(self, step: float) -> NDArray[np.float64]:  # noqa: ARG002 (the interface's)
        """Return straight bristles, (1,)."""
        return np.zeros(1)

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return g(w) sgn(w) + b w [N m] at speeds (...), 0 at rest."""
        return stribeck_curve(
            speed,
            viscous=self.viscous,
            coulomb=self.coulomb,
            stribeck=self.stribeck,
            stribeck_speed=self.stribeck_speed,
            stribeck_exponent=self.stribeck_exponent,
        )

    def explicit_slope(self) -> float:
        """Return 0: the step is exponential."""
        return 0.0


@inlined
def _rate(law, speed):
    """Return r = sigma_0 |w| / g(w) [1/s]."""
    return law.sigma_0 * abs(speed) / dry_friction(law, speed)


@inlined
def _micro_damping(law, speed):
    ratio = speed * law.inv_vd
    return law.sigma_1 * exponential(-ratio * ratio)


@inlined
def _friction(law, state, speed, applied):
    bending = speed - _rate(law, speed) * state[0]
    return law.sigma_0 * state[0] + _micro_damping(law, speed) * bending + law.b * speed


@inlined
def _settle(law, state, before, after, h):
    speed = 0.5 * (before + after)
    r = _rate(law, speed)
    if r * h > 1e-9:
        steady = speed / r
        state[0] = steady + (state[0] - steady) * exponential(-r * h)
    else:
        state[0] += h * (speed - r * state[0])


@inlined
def _motion(law, inertia, torque, z, w, at_w, h) -> tuple[float, float, float]:
    """Move from (z, w) with everything frozen at the speed `at_w`."""
    T = available(inertia, torque, at_w)
    r, sigma_1 = _rate(law, at_w), _micro_damping(law, at_w)
    return linear_motion(Bristles(law.sigma_0, sigma_1, law.b, r, 1.0), T, inertia.inv_J, z, w, h)


@inlined
def _move(law, inertia, torque, state, speed, h):
    z = state[0]
    _, middle, _ = _motion(law, inertia, torque, z, speed, speed, 0.5 * h)
    state[0], end, travel = _motion(law, inertia, torque, z, speed, middle, h)
    return end, travel


register(LuGreNumbers, friction=_friction, settling=_settle, moving=_move)
