"""The units a robot file may be written in, and their way to SI.

39.3 cm must be the same float as 0.393 m, so that powers of ten shift the decimal point of what is written; a
float's product or quotient would be off by a rounding.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

from ballbot.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Scale:
    """A unit in SI: 10^exponent times factor."""

    exponent: int = 0
    factor: float = 1.0


DIMENSIONLESS = "1"
_ONE = Scale()
_CENTI, _MILLI = Scale(exponent=-2), Scale(exponent=-3)
_DEGREE = Scale(factor=math.pi / 180.0)
_TURN_A_MINUTE = Scale(factor=math.pi / 30.0)

#: for each SI unit, the units that are understood in its place
UNITS: Mapping[str, Mapping[str, Scale]] = {
    DIMENSIONLESS: {DIMENSIONLESS: _ONE},
    "m": {"m": _ONE, "cm": _CENTI, "mm": _MILLI},
    "kg": {"kg": _ONE, "g": _MILLI},
    "kg m^2": {
        "kg m^2": _ONE,
        "kg cm^2": Scale(exponent=-4),
        "g m^2": _MILLI,
        "g cm^2": Scale(exponent=-7),
    },
    "rad": {"rad": _ONE, "deg": _DEGREE},
    "rad/s": {
        "rad/s": _ONE,
        "deg/s": _DEGREE,
        "deg/min": Scale(factor=math.pi / 10800.0),
        "rpm": _TURN_A_MINUTE,
    },
    "s": {"s": _ONE, "ms": _MILLI},
    "V": {"V": _ONE, "mV": _MILLI},
    "N m": {"N m": _ONE, "mN m": _MILLI},
    "N m/A": {"N m/A": _ONE, "mN m/A": _MILLI},
    "rad/s/V": {"rad/s/V": _ONE, "rpm/V": _TURN_A_MINUTE},
    "N m s/rad": {"N m s/rad": _ONE, "mN m s/rad": _MILLI},
    "m/s^2": {"m/s^2": _ONE},
}


def to_si(value: float, unit: str, si_unit: str) -> float:
    """Return a value given in `unit` as a value in `si_unit`.

    Raises
    ------
    InputError
        Where `unit` is not one that `si_unit` can be written in.
    """
    scale = _scale(unit, si_unit)
    return _shifted(value, scale.exponent) * scale.factor


def from_si(value: float, unit: str, si_unit: str) -> float | None:
    """Return the shortest decimal in `unit` that reads back as exactly this SI value, or None.

    A file can then say 45 deg and still give back the very float that it was written from.
    """
    scale = _scale(unit, si_unit)
    raw = _shifted(value / scale.factor, -scale.exponent)
    for digits in range(1, 18):
        candidate = float(f"{raw:.{digits}g}")
        if to_si(candidate, unit, si_unit) == value:
            return candidate
    return None


def _shifted(value: float, exponent: int) -> float:
    """Return the float nearest to a float's shortest decimal times 10^exponent."""
    return float(Decimal(repr(float(value))).scaleb(exponent)) if exponent else value


def _scale(unit: str, si_unit: str) -> Scale:
    known = UNITS[si_unit]
    spelled = unit.replace("²", "^2").replace("·", " ").replace("°", "deg").strip()
    if spelled not in known:
        raise InputError(f"the unit {unit!r} is not known here; write {_either(list(known))}")
    return known[spelled]


def _either(names: list[str]) -> str:
    quoted = [f'"{name}"' for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"
