"""The parameters of an axis, and the friction laws that are tried.

The nested friction laws of one axis:

    viscous       M, b, offset
    coulomb       and c                                    tau = b v + c sgn(v)
    stribeck      and s, v_s                               and s exp(-|v/v_s|) sgn(v)
    dahl          coulomb and sigma_0                      bristles that bend before they slide
    lugre         dahl and s, v_s, sigma_1                 (Canudas de Wit 1995)
    asymmetric    coulomb with b, c of either direction    of which offset and c+ - c- are one while it slides

The laws are those of `ballbot.mechanics.friction_laws`; Dahl's is LuGre's without s and sigma_1. With each of them the
dry friction may grow with a load (`load`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from ballbot.errors import InputError, suggest
from ballbot.fitting.parameter import Parameter, Scale
from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.mechanics.friction_laws.lugre import LuGre

Values = Mapping[str, float]
Law = Classical | LuGre

#: bristles need some Coulomb friction to slide
LEAST_COULOMB = 1e-9


def _parameter(name: str, symbol: str, unit: str, meaning: str, *, scale: Scale = "amount") -> Parameter:
    bounds = (-math.inf, math.inf) if scale == "signed" else (0.0, math.inf)
    default = 1.0 if scale == "ratio" else 0.0
    return Parameter(
        name=name, symbol=symbol, unit=unit, scale=scale, bounds=bounds, default=default, meaning=meaning
    )


#: by name; units are those of an axis that moves along a line, see `unit_for`
PARAMETERS: Mapping[str, Parameter] = MappingProxyType(
    {
        one.name: one
        for one in (
            _parameter("mass", "M", "kg", "mass or inertia", scale="ratio"),
            _parameter("viscous", "b", "N s/m", "viscous"),
            _parameter("coulomb", "c", "N", "Coulomb"),
            _parameter("offset", "offset", "N", "constant force", scale="signed"),
            _parameter("stribeck", "s", "N", "break-away above Coulomb"),
            _parameter("stribeck_speed", "v_s", "m/s", "Stribeck speed", scale="ratio"),
            _parameter("stiffness", "sigma_0", "N/m", "bristles' stiffness", scale="ratio"),
            _parameter("micro_damping", "sigma_1", "N s/m", "bristles' damping", scale="ratio"),
            _parameter("viscous_plus", "b+", "N s/m", "viscous, forwards"),
            _parameter("viscous_minus", "b-", "N s/m", "viscous, backwards"),
            _parameter("coulomb_plus", "c+", "N", "Coulomb, forwards"),
            _parameter("coulomb_minus", "c-", "N", "Coulomb, backwards"),
            _parameter("spring", "k", "N/m", "spring or cable", scale="signed"),
            _parameter("load", "mu", "1", "Coulomb, as a share of the load"),
        )
    }
)


#: the highest harmonic of a force over position
MOST_HARMONICS = 500


def parameter_named(name: str) -> Parameter:
    """Return the parameter of that name, a harmonic's or a drift's too: "sin_1", "cos_1", "drift_1"."""
    if name in PARAMETERS:
        return PARAMETERS[name]
    kind, _, number = name.partition("_")
    if kind == "drift":
        return _parameter(name, f"drift {number}", "N", "change of the constant force", scale="signed")
    symbol = {"sin": "S", "cos": "C"}[kind]
    return _parameter(name, f"{symbol}_{number}", "N", f"{kind}({number} w q)", scale="signed")


def unit_for(parameter: Parameter, axis_unit: str) -> str:
    """Return a parameter's unit for an axis of positions in "m" or "rad"; empty for a number without one."""
    if axis_unit == "m" or parameter.unit == "1":
        return parameter.unit.removeprefix("1")
    turning = {"kg": "kg m^2", "N s/m": "N m s/rad", "N": "N m", "m/s": "rad/s", "N/m": "N m/rad"}
    return turning.get(parameter.unit, parameter.unit)


@dataclass(frozen=True, kw_only=True)
class AxisLaw:
    """One law of the ladder."""

    name: str
    below: str | None  #: the law within it
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
            coulomb=max(values["coulomb"], LEAST_COULOMB),
            stribeck=values.get("stribeck", 0.0),
            stribeck_speed=values.get("stribeck_speed", 1.0),
            stribeck_exponent=1.0,
            stiffness=values["stiffness"],
            micro_damping=values.get("micro_damping", 0.0),
            may_drive=True,  # a search passes such values; its end is checked
        )


_COULOMB = ("mass", "viscous", "coulomb", "offset")

AXIS_LAWS: Mapping[str, AxisLaw] = MappingProxyType(
    {
        law.name: law
        for law in (
            AxisLaw(name="viscous", below=None, names=("mass", "viscous", "offset")),
            AxisLaw(name="coulomb", below="viscous", names=_COULOMB),
            AxisLaw(name="stribeck", below="coulomb", names=(*_COULOMB, "stribeck", "stribeck_speed")),
            AxisLaw(name="dahl", below="coulomb", names=(*_COULOMB, "stiffness")),
            AxisLaw(
                name="lugre",
                below="dahl",
                names=(*_COULOMB, "stiffness", "stribeck", "stribeck_speed", "micro_damping"),
            ),
            AxisLaw(
                name="asymmetric",
                below="coulomb",
                names=("mass", "viscous_plus", "coulomb_plus", "viscous_minus", "coulomb_minus"),
            ),
        )
    }
)


def axis_law_named(name: str) -> AxisLaw:
    """Return the law of that name; InputError if no law has it."""
    if name not in AXIS_LAWS:
        hint = suggest(name, AXIS_LAWS, otherwise="the laws are")
        raise InputError(f"There is no friction law {name!r} (--law); {hint}")
    return AXIS_LAWS[name]
