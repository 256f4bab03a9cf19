"""Parameters of a fit: what each is, and how a search scales it.

Between bounds (`ParameterSpace`) a search sees each parameter p as z, which runs from 0 to 1:

    p = lower + z (upper - lower)          amounts from zero, and numbers of either sign
    p = lower (upper / lower)^z            sizes of which ratios matter, as v_s, delta and a torque's gain

A random search looks more closely at amounts near zero: it draws y and takes z = y^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

#: an amount from zero, at which a search looks more closely near zero; a size, of which ratios matter; or a number of
#: either sign
Scale = Literal["amount", "ratio", "signed"]
#: the least and the greatest value; equal ones hold a parameter
Limits = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number that a fit estimates or holds."""

    name: str  #: the quantity that it belongs to, in options and files
    symbol: str  #: its own label in results, as "b1" or "C_rr"
    unit: str
    scale: Scale
    bounds: Limits  #: equal ones hold it
    default: float  #: its nominal value, before any estimation
    meaning: str = ""  #: in a few words

    @property
    def free(self) -> bool:
        """Whether its bounds leave it free."""
        return self.bounds[1] > self.bounds[0]

    @staticmethod
    def about(name: str, default: float, unit: str, *, within: float = 0.0, factor: float = 1.0) -> Parameter:
        """Return a number of either sign, within so much of its default, or one within a factor of it."""
        scale: Scale = "ratio" if factor > 1.0 else "signed"
        bounds = (default / factor - within, default * factor + within)
        return Parameter(name=name, symbol=name, unit=unit, scale=scale, bounds=bounds, default=default)


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterSpace:
    """p parameters, in their order, and their scaling."""

    parameters: tuple[Parameter, ...]
    alike: tuple[str, ...] = ()  #: quantities that have one number for all of theirs

    @property
    def labels(self) -> tuple[str, ...]:
        """The parameters' labels (p,), as "b1" or "C_rr"."""
        return tuple(one.symbol for one in self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """The quantity that each parameter belongs to (p,)."""
        return tuple(one.name for one in self.parameters)

    @cached_property
    def nominal(self) -> NDArray[np.float64]:
        """Their values before any estimation (p,)."""
        return np.array([one.default for one in self.parameters], dtype=float)

    @cached_property
    def lower(self) -> NDArray[np.float64]:
        """Their least values (p,)."""
        return np.array([one.bounds[0] for one in self.parameters], dtype=float)

    @cached_property
    def upper(self) -> NDArray[np.float64]:
        """Their greatest values (p,)."""
        return np.array([one.bounds[1] for one in self.parameters], dtype=float)

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """The place of the number that each one (p,) equals: its own, or the first of a quantity in `alike`."""
        names = self.names
        return np.array([names.index(name) if name in self.alike else i for i, name in enumerate(names)])

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters (p,) a fit moves: those whose bounds differ; of numbers that are equal, the first."""
        return (self.upper > self.lower) & (self.first == np.arange(len(self.parameters)))

    @cached_property
    def logarithmic(self) -> NDArray[np.bool_]:
        """Of which parameters ratios matter (p,)."""
        return np.array([one.scale == "ratio" for one in self.parameters])

    @cached_property
    def sqrt_scaled(self) -> NDArray[np.bool_]:
        """At which parameters a random search looks more closely near zero (p,)."""
        return np.array([one.scale == "amount" for one in self.parameters])

    def physical(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameters (..., p) in SI units from scaled ones (..., p)."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        ratio = np.where(self.logarithmic, self.upper / low, 1.0)
        scaled = scaled[..., self.first]
        linear = self.lower + scaled * (self.upper - self.lower)
        return np.clip(np.where(self.logarithmic, low * ratio**scaled, linear), self.lower, self.upper)

    def scaled(self, physical: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scaled parameters (..., p) from those in SI units, brought within their bounds."""
        values = np.clip(physical, self.lower, self.upper)
        wide = self.upper > self.lower
        width = np.where(wide, self.upper - self.lower, 1.0)
        low = np.where(self.logarithmic, self.lower, 1.0)
        width_log = np.log(np.where(self.logarithmic & wide, self.upper / low, np.e))
        log = np.log(np.where(self.logarithmic, values, 1.0) / low) / width_log
        return np.where(self.logarithmic, log, (values - self.lower) / width)

    def from_search(self, drawn: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scaled parameters from those of a random search, z = y^2 for amounts."""
        return np.where(self.sqrt_scaled, drawn**2, drawn)

    def physical_one(self, place: int, scaled: float) -> float:
        """Return the value of the parameter at a place in SI units, from a scaled one."""
        return float(self.physical(np.full(len(self.parameters), scaled))[place])

    def scaled_one(self, place: int, physical: float) -> float:
        """Return a value of the parameter at a place, scaled and brought within its bounds."""
        return float(
            self.scaled(np.where(np.arange(len(self.parameters)) == place, physical, self.nominal))[place]
        )

    def slopes(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dp/dz (..., p): what turns an error of a scaled parameter into one in SI units."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        rate = np.log(np.where(self.logarithmic, self.upper / low, 1.0))
        return np.where(self.logarithmic, self.physical(scaled) * rate, self.upper - self.lower)
