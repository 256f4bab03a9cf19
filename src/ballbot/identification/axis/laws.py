"""The ladder of nested friction laws of one axis, and how their parameters are scaled for a search.

    viscous       M, b, offset
    coulomb       and c                                    tau = b v + c sgn(v)
    stribeck      and s, v_s                               and s exp(-|v/v_s|) sgn(v)
    dahl          coulomb and sigma_0                      bristles that bend before they slide
    lugre         dahl and s, v_s, sigma_1                 (Canudas de Wit 1995)
    asymmetric    coulomb with b, c of either direction    of which offset and c+ - c- are one while it slides

The laws are those of `ballbot.mechanics.friction_laws`; Dahl's is LuGre's without s and sigma_1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.mechanics.friction_laws.lugre import LuGre

Values = Mapping[str, float]
Law = Classical | LuGre

#: bristles need some Coulomb friction to slide at
_LEAST_COULOMB = 1e-9
#: a parameter on a logarithmic scale is sought within e to this power of where the search starts, either way
_WIDEST = 7.0


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """What a number of an axis is."""

    symbol: str
    meaning: str
    unit: str  #: of an axis that moves along a line; see `unit_for`
    logarithmic: bool = False  #: above zero, and ratios matter
    signed: bool = False

    def unit_for(self, axis_unit: str) -> str:
        """Return the unit for an axis of positions in "m" or "rad"."""
        if axis_unit == "m":
            return self.unit
        return {
            "kg": "kg m^2",
            "N s/m": "N m s/rad",
            "N": "N m",
            "m/s": "rad/s",
            "N/m": "N m/rad",
        }.get(self.unit, self.unit)


PARAMETERS: Mapping[str, Parameter] = MappingProxyType(
    {
        "mass": Parameter(symbol="M", meaning="mass or inertia", unit="kg", logarithmic=True),
        "viscous": Parameter(symbol="b", meaning="viscous", unit="N s/m"),
        "coulomb": Parameter(symbol="c", meaning="Coulomb", unit="N"),
        "offset": Parameter(symbol="offset", meaning="constant force", unit="N", signed=True),
        "stribeck": Parameter(symbol="s", meaning="break-away above Coulomb", unit="N"),
        "stribeck_speed": Parameter(symbol="v_s", meaning="Stribeck speed", unit="m/s", logarithmic=True),
        "stiffness": Parameter(symbol="sigma_0", meaning="bristles' stiffness", unit="N/m", logarithmic=True),
        "micro_damping": Parameter(
            symbol="sigma_1", meaning="bristles' damping", unit="N s/m", logarithmic=True
        ),
        "viscous_plus": Parameter(symbol="b+", meaning="viscous, forwards", unit="N s/m"),
        "viscous_minus": Parameter(symbol="b-", meaning="viscous, backwards", unit="N s/m"),
        "coulomb_plus": Parameter(symbol="c+", meaning="Coulomb, forwards", unit="N"),
        "coulomb_minus": Parameter(symbol="c-", meaning="Coulomb, backwards", unit="N"),
    }
)


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One law of the ladder."""

    name: str
    below: str | None  #: the rung that it has to beat
    names: tuple[str, ...]  #: its parameters

    @property
    def symmetric(self) -> bool:
        """Whether both directions have one friction."""
        return "viscous" in self.names

    def laws(self, values: Values) -> tuple[Law, Law]:
        """Return the friction forwards and backwards."""
        if not self.symmetric:
            sides = (("viscous_plus", "coulomb_plus"), ("viscous_minus", "coulomb_minus"))
            plus, minus = (Classical(viscous=values[b], coulomb=values[c]) for b, c in sides)
            return plus, minus
        law = self._bristles(values) if "stiffness" in self.names else self._classical(values)
        return law, law

    @staticmethod
    def _classical(values: Values) -> Classical:
        return Classical(
            viscous=values["viscous"],
            coulomb=values.get("coulomb", 0.0),
            stribeck=values.get("stribeck", 0.0),
            stribeck_speed=values.get("stribeck_speed", 1.0),
            stribeck_exponent=1.0,
        )

    @staticmethod
    def _bristles(values: Values) -> LuGre:
        return LuGre(
            viscous=values["viscous"],
            coulomb=max(values["coulomb"], _LEAST_COULOMB),
            stribeck=values.get("stribeck", 0.0),
            stribeck_speed=values.get("stribeck_speed", 1.0),
            stribeck_exponent=1.0,
            stiffness=values["stiffness"],
            micro_damping=values.get("micro_damping", 0.0),
            may_drive=True,  # a search passes such values; what it ends with is looked at
        )


_COULOMB = ("mass", "viscous", "coulomb", "offset")

RUNGS: Mapping[str, Rung] = MappingProxyType(
    {
        rung.name: rung
        for rung in (
            Rung(name="viscous", below=None, names=("mass", "viscous", "offset")),
            Rung(name="coulomb", below="viscous", names=_COULOMB),
            Rung(name="stribeck", below="coulomb", names=(*_COULOMB, "stribeck", "stribeck_speed")),
            Rung(name="dahl", below="coulomb", names=(*_COULOMB, "stiffness")),
            Rung(
                name="lugre",
                below="dahl",
                names=(*_COULOMB, "stiffness", "stribeck", "stribeck_speed", "micro_damping"),
            ),
            Rung(
                name="asymmetric",
                below="coulomb",
                names=("mass", "viscous_plus", "coulomb_plus", "viscous_minus", "coulomb_minus"),
            ),
        )
    }
)


def rung_of(name: str) -> Rung:
    """Return the rung of that name; InputError where there is none."""
    if name not in RUNGS:
        raise InputError(f"There is no friction law {name!r}; the laws are {', '.join(RUNGS)}.")
    return RUNGS[name]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scaling:
    """A rung's parameters as a search sees them: z = ln p, or p over its size."""

    names: tuple[str, ...]
    sizes: NDArray[np.float64]  #: (p,)

    def values(self, z: NDArray[np.float64]) -> dict[str, float]:
        """Return the parameters in SI units of scaled ones (p,)."""
        return {
            name: float(np.exp(one) if PARAMETERS[name].logarithmic else one * size)
            for name, one, size in zip(self.names, z, self.sizes, strict=True)
        }

    def scaled(self, values: Values) -> NDArray[np.float64]:
        """Return scaled parameters (p,)."""
        return np.array(
            [
                np.log(values[name]) if PARAMETERS[name].logarithmic else values[name] / size
                for name, size in zip(self.names, self.sizes, strict=True)
            ]
        )

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the least and the greatest scaled values (p,): zero for what cannot be negative, and e^+-7 sizes."""
        kinds = [PARAMETERS[name] for name in self.names]
        logarithmic = np.array([kind.logarithmic for kind in kinds])
        signed = np.array([kind.signed for kind in kinds])
        middle = np.where(logarithmic, np.log(self.sizes), 0.0)
        lower = np.where(logarithmic, middle - _WIDEST, np.where(signed, -np.inf, 0.0))
        return lower, np.where(logarithmic, middle + _WIDEST, np.inf)

    def slopes(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dp/dz (p,)."""
        logarithmic = np.array([PARAMETERS[name].logarithmic for name in self.names])
        return np.where(logarithmic, np.array(list(self.values(z).values())), self.sizes)
