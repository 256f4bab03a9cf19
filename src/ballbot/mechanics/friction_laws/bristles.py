"""LuGre's and Dahl's laws: bristles that bend before they slide, for the twin's drivelines.

LuGre:

    z_dot = w - sigma_0 |w| z / g(w)              g(w) = c + s exp(-|w/v_s|^delta)
    tau = sigma_0 z + sigma_1(w) z_dot + b w      sigma_1(w) = sigma_1 exp(-(w/v_d)^2)

C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, A new model for control of systems with friction, IEEE
Transactions on Automatic Control 40, 1995; its F_C, F_S and sigma_2 are c, c + s and b, its delta is 2, and its
sigma_1 is constant (v_d infinite). v_d is Olsson's remedy (Control systems with friction, thesis, Lund 1996).

*It may drive.* With sigma_1 constant, the law takes more energy out than was put in when bristles loaded at low
speed meet a high one, unless sigma_1 s/c <= b (N. Barabanov and R. Ortega, Necessary and sufficient conditions for
passivity of the LuGre friction model, same journal 45, 2000). The paper's own parameters do that. So such values are
refused unless asked for.

Dahl: friction is a function of travel, with hysteresis and without rate.

    dF/dx = sigma (1 - (F/c) sgn(w))^i            tau = F + b w,    z = F / sigma

P. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968. Between two reversals the travel gives
the force in closed form: with y = 1 - (F/c) sgn(w), y = y_0 e^(-kappa) for i = 1 and otherwise
y^(1-i) = y_0^(1-i) + (i - 1) kappa, with kappa = sigma |x| / c. Dahl has no b; it is there because a driveline has.
There is no static friction above c, so nothing sticks and slips.

A law's state is its deflection z [rad], zero after a long rest without load.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballbot.errors import InputError
from ballbot.mechanics.friction import stribeck_decay
from ballbot.mechanics.friction_laws.classical import check_values


@dataclass(frozen=True, kw_only=True)
class LuGre:
    """Bristles with a Stribeck curve.

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
        g = self.coulomb + self.stribeck * stribeck_decay(w / self.stribeck_speed, self.stribeck_exponent)
        x = np.minimum(0.5 * sigma_1 * w, largest)
        power = x * x / g + (sigma_1 + self.viscous) * w - sigma_1 * w * x / g
        worst = int(np.argmin(power / w))
        return float(w[worst]) if power[worst] < 0.0 else None

    def advanced(self, z: float, *, speed: float, step: float) -> float:
        """Return the deflection [rad] after `step` [s] at constant speed [rad/s], exactly."""
        r = self._relaxing(speed)
        if r * step > 1e-9:
            return speed / r + (z - speed / r) * math.exp(-r * step)
        return z + step * (speed - r * z)

    def friction(self, z: float, speed: float) -> float:
        """Return the friction [N m] at a deflection and a speed; it acts against positive speeds if positive."""
        bending = speed - self._relaxing(speed) * z
        sigma_1 = self.micro_damping * math.exp(-((speed / self.damping_speed) ** 2))
        return self.stiffness * z + sigma_1 * bending + self.viscous * speed

    def _relaxing(self, speed: float) -> float:
        """Return r = sigma_0 |w| / g(w) [1/s]."""
        decay = stribeck_decay(np.float64(speed / self.stribeck_speed), self.stribeck_exponent)
        return float(self.stiffness * abs(speed) / (self.coulomb + self.stribeck * decay))


@dataclass(frozen=True, kw_only=True)
class Dahl:
    """Friction that grows with travel towards Coulomb's.

    Raises
    ------
    InputError
        If a value is negative or not finite, or Coulomb friction, stiffness or shape is zero.
    """

    coulomb: float  #: c [N m]
    stiffness: float  #: sigma [N m/rad], dF/dx at F = 0
    shape: float = 1.0  #: i [-]: below 1 for brittle materials, 1 or more for ductile ones
    viscous: float = 0.0  #: b [N m s/rad]

    def __post_init__(self) -> None:
        check_values(self, positive=("coulomb", "stiffness", "shape"), not_negative=("viscous",))

    def advanced(self, z: float, *, speed: float, step: float) -> float:
        """Return the deflection [rad] after `step` [s] at constant speed [rad/s], exactly."""
        direction = float(np.sign(speed))
        if direction == 0.0:
            return z
        y = max(1.0 - direction * self.stiffness * z / self.coulomb, 0.0)  # kept from rounding below zero
        kappa = self.stiffness * abs(speed) * step / self.coulomb
        more = self.shape - 1.0
        if abs(more) < 1e-12:
            y *= math.exp(-kappa)
        elif y > 0.0:
            # y (1 + (i - 1) kappa y^(i-1))^(-1/(i-1)); below i = 1 the force arrives at c after a finite travel
            growth = 1.0 + more * kappa * y**more
            y = y * growth ** (-1.0 / more) if growth > 0.0 else 0.0
        return direction * self.coulomb / self.stiffness * (1.0 - y)

    def friction(self, z: float, speed: float) -> float:
        """Return the friction [N m] at a deflection and a speed; it acts against positive speeds if positive."""
        return self.stiffness * z + self.viscous * speed
