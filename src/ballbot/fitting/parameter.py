"""Parameters of a fit, and their scaling.

A fit works with scaled parameters z, which run from 0 to 1 between the bounds of a parameter p (`ParameterSpace`):

    p = lower + z (upper - lower)          "amount" (zero or more) and "signed" (either sign)
    p = lower (upper / lower)^z            "ratio" (a positive size, such as v_s, delta or a torque gain)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from ballbot.arrays import Bools, Floats, Ints

#: see the module's text
Scale = Literal["amount", "ratio", "signed"]
#: the lower and the upper bound; equal bounds hold a parameter
Limits = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class FitParameter:
    """One number that a fit estimates or holds."""

    name: str  #: of the quantity in options and files, as "coulomb"
    symbol: str  #: label in results, as "c1"
    unit: str
    scale: Scale
    bounds: Limits  #: equal bounds hold it
    default: float  #: nominal value, before estimation
    meaning: str = ""  #: in a few words

    @staticmethod
    def about(
        name: str, default: float, unit: str, *, within: float = 0.0, factor: float = 1.0
    ) -> FitParameter:
        """Return a signed parameter `within` so much of its default, or a ratio within a `factor` of it."""
        scale: Scale = "ratio" if factor > 1.0 else "signed"
        bounds = (default / factor - within, default * factor + within)
        return FitParameter(name=name, symbol=name, unit=unit, scale=scale, bounds=bounds, default=default)


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterSpace:
    """p parameters in order, and their scaling."""

    parameters: tuple[FitParameter, ...]
    alike: tuple[str, ...] = ()  #: quantities whose parameters all have one common value

    def holding(self, *names: str) -> ParameterSpace:
        """Return the space with these quantities held at their defaults."""
        held = (
            replace(own, bounds=(own.default, own.default)) if own.name in names else own
            for own in self.parameters
        )
        return replace(self, parameters=tuple(held))

    @property
    def labels(self) -> tuple[str, ...]:
        """The parameters' labels (p,), as "b1" or "C_rr"."""
        return tuple(parameter.symbol for parameter in self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """The quantity that each parameter belongs to (p,)."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def nominal(self) -> Floats:
        """The values before estimation (p,)."""
        return np.array([parameter.default for parameter in self.parameters], dtype=float)

    @cached_property
    def lower(self) -> Floats:
        """The lower bounds (p,)."""
        return np.array([parameter.bounds[0] for parameter in self.parameters], dtype=float)

    @cached_property
    def upper(self) -> Floats:
        """The upper bounds (p,)."""
        return np.array([parameter.bounds[1] for parameter in self.parameters], dtype=float)

    @cached_property
    def first(self) -> Ints:
        """The index (p,) of the parameter whose value each one has: its own, or the first of a quantity in `alike`."""
        names = self.names
        return np.array([names.index(name) if name in self.alike else i for i, name in enumerate(names)])

    @cached_property
    def free(self) -> Bools:
        """Which parameters (p,) a fit varies: those whose bounds differ; the first of a quantity in `alike`."""
        return (self.upper > self.lower) & (self.first == np.arange(len(self.parameters)))

    @cached_property
    def logarithmic(self) -> Bools:
        """Which parameters (p,) are scaled logarithmically."""
        return np.array([parameter.scale == "ratio" for parameter in self.parameters])

    @cached_property
    def nonnegative(self) -> Bools:
        """Which parameters (p,) are amounts, zero or more."""
        return np.array([parameter.scale == "amount" for parameter in self.parameters])

    def physical(self, scaled: Floats) -> Floats:
        """Return parameters (..., p) in SI units from scaled ones (..., p)."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        ratio = np.where(self.logarithmic, self.upper / low, 1.0)
        scaled = scaled[..., self.first]
        linear = self.lower + scaled * (self.upper - self.lower)
        return np.clip(np.where(self.logarithmic, low * ratio**scaled, linear), self.lower, self.upper)

    def scaled(self, physical: Floats) -> Floats:
        """Return scaled parameters (..., p) from those in SI units, clipped to the bounds."""
        values = np.clip(physical, self.lower, self.upper)
        wide = self.upper > self.lower
        width = np.where(wide, self.upper - self.lower, 1.0)
        low = np.where(self.logarithmic, self.lower, 1.0)
        width_log = np.log(np.where(self.logarithmic & wide, self.upper / low, np.e))
        log = np.log(np.where(self.logarithmic, values, 1.0) / low) / width_log
        return np.where(self.logarithmic, log, (values - self.lower) / width)

    def physical_one(self, index: int, scaled: float) -> float:
        """Return the value in SI units of the parameter with this index, from its scaled value."""
        return float(self.physical(np.full(len(self.parameters), scaled))[index])

    def scaled_one(self, index: int, physical: float) -> float:
        """Return the scaled value, clipped to the bounds, of the parameter with this index."""
        return float(self.scaled(np.full(len(self.parameters), physical))[index])

    def slopes(self, scaled: Floats) -> Floats:
        """Return dp/dz (..., p), the factor from an error of a scaled parameter to one in SI units."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        rate = np.log(np.where(self.logarithmic, self.upper / low, 1.0))
        return np.where(self.logarithmic, self.physical(scaled) * rate, self.upper - self.lower)
