"""The parameters as a search sees them: each scaled to run from 0 to 1 between its bounds.

    p = lower + z (upper - lower)          b, c, s and C_rr
    p = lower (upper / lower)^z            v_s and delta, of which ratios matter

The order is [b_1 .. b_n, c_1 .. c_n, s_1 .. s_n, v_s, delta, C_rr], 3 n + 3 numbers for n wheels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.bounds import LOGARITHMIC, Bounds
from ballbot.robot import Friction

#: the parameters by their names in `Friction`, with the paper's symbols; the first three are every wheel's own
SYMBOLS = {
    "viscous": "b",
    "coulomb": "c",
    "stribeck": "s",
    "stribeck_speed": "v_s",
    "stribeck_exponent": "delta",
    "rolling": "C_rr",
}
PER_WHEEL = ("viscous", "coulomb", "stribeck")


@dataclass(frozen=True, kw_only=True, eq=False)
class Coordinates:
    """How p parameters are scaled."""

    labels: tuple[str, ...]  #: (p,), as "b1" or "C_rr"
    lower: NDArray[np.float64]  #: (p,)
    upper: NDArray[np.float64]  #: (p,)
    logarithmic: NDArray[np.bool_]  #: (p,)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters their bounds leave free (p,)."""
        return self.upper > self.lower

    def physical(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameters (..., p) in SI units from scaled ones (..., p)."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        ratio = np.where(self.logarithmic, self.upper / low, 1.0)
        linear = self.lower + scaled * (self.upper - self.lower)
        return np.clip(np.where(self.logarithmic, low * ratio**scaled, linear), self.lower, self.upper)

    def scaled(self, physical: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scaled parameters (..., p) from those in SI units, brought within their bounds."""
        values = np.clip(physical, self.lower, self.upper)
        width = np.where(self.free, self.upper - self.lower, 1.0)
        low = np.where(self.logarithmic, self.lower, 1.0)
        width_log = np.log(np.where(self.logarithmic & self.free, self.upper / low, np.e))
        log = np.log(np.where(self.logarithmic, values, 1.0) / low) / width_log
        return np.where(self.logarithmic, log, (values - self.lower) / width)

    def from_search(self, sought: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scaled parameters from those of a random search, which looks closer near zero: z = y^2 for amounts."""
        return np.where(self.logarithmic, sought, sought**2)

    def slopes(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dp/dz (..., p): what turns an error of a scaled parameter into one in SI units."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        rate = np.log(np.where(self.logarithmic, self.upper / low, 1.0))
        return np.where(self.logarithmic, self.physical(scaled) * rate, self.upper - self.lower)


def scale_between(bounds: Bounds, wheel_count: int) -> Coordinates:
    """Return the coordinates of a robot's friction parameters inside these bounds."""
    labels, names = [], []
    for name, symbol in SYMBOLS.items():
        count = wheel_count if name in PER_WHEEL else 1
        labels += [f"{symbol}{i}" for i in range(1, count + 1)] if name in PER_WHEEL else [symbol]
        names += [name] * count
    intervals = np.array([bounds.interval(name) for name in names])
    return Coordinates(
        labels=tuple(labels),
        lower=intervals[:, 0],
        upper=intervals[:, 1],
        logarithmic=np.array([name in LOGARITHMIC for name in names]),
    )


def to_friction(values: NDArray[np.float64]) -> Friction:
    """Return parameters (p,) in the order of the module's text as a `Friction`."""
    b, c, s, (v_s, delta, C_rr) = _parts(values)
    return Friction(
        viscous=tuple(b),
        coulomb=tuple(c),
        stribeck=tuple(s),
        stribeck_speed=v_s,
        stribeck_exponent=delta,
        rolling=C_rr,
    )


def from_friction(friction: Friction) -> NDArray[np.float64]:
    """Return a `Friction` as parameters (p,) in the order of the module's text."""
    shared = (friction.stribeck_speed, friction.stribeck_exponent, friction.rolling)
    return np.array([*friction.viscous, *friction.coulomb, *friction.stribeck, *shared])


def by_symbol(values: NDArray[np.float64]) -> dict[str, list[float] | float]:
    """Return parameters (p,) as {b: [..], c: [..], s: [..], v_s, delta, C_rr}."""
    b, c, s, (v_s, delta, C_rr) = _parts(values)
    return {"b": b, "c": c, "s": s, "v_s": v_s, "delta": delta, "C_rr": C_rr}


def _parts(values: NDArray[np.float64]) -> tuple[list[float], list[float], list[float], list[float]]:
    n = (len(values) - 3) // 3
    b, c, s, shared = (part.tolist() for part in np.split(values, [n, 2 * n, 3 * n]))
    return b, c, s, shared
