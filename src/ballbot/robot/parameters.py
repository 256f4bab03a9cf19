"""Robot parameters, each stated once as its field of the robot, and the units that files may use.

    @parameter_class
    class Ball:
        radius: float = parameter("r_b, outer radius", "m", most=1.0, usual=(0.03, 0.5))

Robot files, checks, bounds of estimates, `ballbot check` and the documentation all walk along `parameters_of(Robot)`. A
parameter is added by adding such a field: one with a default may be missing from a file.

Units. 39.3 cm must be the same float as 0.393 m, so that powers of ten shift the decimal point of what is written; a
float's product or quotient would be off by a rounding.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import KW_ONLY, MISSING, Field, dataclass, field, fields, is_dataclass, replace
from decimal import Decimal
from functools import cache
from operator import attrgetter
from typing import Any, Literal, TypeVar, dataclass_transform, get_args, get_origin, get_type_hints

from ballbot.errors import InputError, either

T = TypeVar("T")

Shape = Literal["number", "whole number", "list", "truth value", "text"]
Value = float | int | tuple[float, ...]

#: the source of a value that states none
ASSUMED = "assumed"
#: kinds of source; a file may add detail after a colon ("data sheet: Maxon 449470")
SOURCES = ("measured", "data sheet", "previous work", "calculated", "identified", ASSUMED)

DIMENSIONLESS = "1"


@dataclass(frozen=True)
class Parameter:
    """One line of a file: a number, a list of numbers (in a robot file one for each wheel), a truth value or a text."""

    meaning: str  #: symbol, then what it is
    unit: str = DIMENSIONLESS  #: SI, as the dataclass holds it
    _: KW_ONLY
    written_in: str = ""  #: the unit that files are written in, if it is another
    least: float = 0.0  #: smallest allowed value, SI units
    least_is_allowed: bool = False
    most: float = math.inf  #: largest allowed magnitude, SI units: a larger one was meant in another unit
    #: least and greatest value of robots of 5 to 50 kg, SI units: within them an estimate is sought, and a value beyond
    #: them is unusual; infinite where no such range is stated
    usual: tuple[float, float] = (-math.inf, math.inf)
    error: float = 0.0  #: relative standard deviation of a value of which none is stated; 0 counts as exact
    name: str = ""  #: dotted, as in a file: "ball.radius"
    field: str = ""  #: dotted, as in the dataclass; differs from the name for the parts of an inertia
    place: int | str | None = None  #: of the part within such a field, or its name
    shape: Shape = "number"
    default: Value | None = None  #: of a file that omits the parameter; None if it may not be omitted

    def __post_init__(self) -> None:
        object.__setattr__(self, "written_in", self.written_in or self.unit)

    @property
    def symbol(self) -> str:
        """The symbol that its meaning begins with, without the index of a wheel: "c" or "v_s"."""
        return self.meaning.partition(",")[0].removesuffix("_i")

    @property
    def table(self) -> str:
        """The TOML table that the line stands in ("" for the top)."""
        return self.name.rpartition(".")[0]

    @property
    def key(self) -> str:
        """The line's key within its table."""
        return self.name.rpartition(".")[2]


def parameter(
    meaning: str,
    unit: str = DIMENSIONLESS,
    *,
    default: object = MISSING,
    written_in: str = "",
    least: float | None = None,  # -inf if it may be negative; above zero if not given
    most: float = math.inf,
    usual: tuple[float, float] = (-math.inf, math.inf),
    error: float = 0.0,
) -> Any:  # as `dataclasses.field`
    """Return a field that is a `Parameter`, with that default."""
    stated = Parameter(meaning, unit, written_in=written_in, most=most, usual=usual, error=error)
    if least is not None:
        stated = replace(stated, least=least, least_is_allowed=True)
    return field(default=default, metadata={"parameter": stated})


def components(heading: str, parts: Mapping[str, Parameter]) -> Any:  # as `dataclasses.field`
    """Return a field that is a tuple whose numbers are parameters with names of their own, in a table of their own."""
    return field(metadata={"heading": heading, "components": parts})


def table(
    heading: str,
    *,
    default: object = MISSING,
    example: object = None,  # what a file shows commented out if the table is off
) -> Any:  # as `dataclasses.field`
    """Return a field that is a table of a file; the heading stands above it as a comment."""
    return field(default=default, metadata={"heading": heading, "example": example})


@dataclass_transform(
    kw_only_default=True, frozen_default=True, field_specifiers=(parameter, components, table, field)
)
def parameter_class(kind: type[T]) -> type[T]:
    """Make a class of parameters a frozen dataclass with keyword arguments."""
    return dataclass(frozen=True, kw_only=True)(kind)


@cache
def parameters_of(kind: type) -> tuple[Parameter, ...]:
    """Return the parameters of a dataclass and of the dataclasses in it, in the order of a file."""
    # TOML wants what stands in no table at the top
    return tuple(sorted(_parameters(kind), key=lambda item: bool(item.table)))


@cache
def headings_of(kind: type) -> dict[str, str]:
    """Return the heading of each table of a dataclass, by its dotted name and in the order of a robot file."""
    return {name: item.metadata["heading"] for name, item, _ in _walk(kind) if "heading" in item.metadata}


def value_of(record: object, parameter: Parameter) -> Value:
    """Return a parameter's value in SI units, a tuple where there is one for each wheel."""
    value = attrgetter(parameter.field)(record)
    if isinstance(parameter.place, str):  # of pairs (name, value); () if no pair has that name
        return dict(value).get(parameter.place, ())
    return value if parameter.place is None else value[parameter.place]


def numbers_of(value: Value) -> tuple[float, ...]:
    """Return a value's numbers: one, or one for each wheel."""
    return value if isinstance(value, tuple) else (value,)


def build(
    kind: Callable[..., T],  # the dataclass
    values: Mapping[str, object],  # of parameters by their names; of other fields by their dotted field names
    *,
    place: str = "",  # what stands before the names of this dataclass's fields, such as "ball."
) -> T:
    """Return a dataclass of values by dotted names; a parameter without a value gets the field's default."""
    assert isinstance(kind, type)
    hints, arguments = _hints(kind), dict[str, object]()
    for item in _fields(kind):
        name = f"{place}{item.name}"
        if "components" in item.metadata:
            arguments[item.name] = tuple(values[f"{name}.{key}"] for key in item.metadata["components"])
        elif is_dataclass(hints[item.name]):
            arguments[item.name] = build(hints[item.name], values, place=f"{name}.")
        elif name in values:
            arguments[item.name] = values[name]
    return kind(**arguments)


def _fields(kind: type) -> tuple[Field[object], ...]:
    assert is_dataclass(kind)
    return fields(kind)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _walk(kind: type, place: str = "") -> Iterator[tuple[str, Field[object], Any]]:
    """Yield dotted name, field and type of each field of a dataclass and of its tables."""
    for item in _fields(kind):
        name, hint = f"{place}{item.name}", _hints(kind)[item.name]
        yield name, item, hint
        if "heading" in item.metadata and (below := _table_of(hint)):
            yield from _walk(below, f"{name}.")


def _parameters(kind: type) -> Iterator[Parameter]:
    for name, item, hint in _walk(kind):
        if "components" in item.metadata:
            for index, (key, part) in enumerate(item.metadata["components"].items()):
                yield replace(part, name=f"{name}.{key}", field=name, place=index)
        elif "parameter" in item.metadata:
            stated, default = item.metadata["parameter"], None if item.default is MISSING else item.default
            yield replace(stated, name=name, field=name, shape=_shape(hint), default=default)


def _shape(hint: object) -> Shape:
    if get_origin(hint) is tuple:
        return "list"
    if hint is str or get_origin(hint) is Literal:
        return "text"
    return "truth value" if hint is bool else "whole number" if hint is int else "number"


def _table_of(hint: object) -> type | None:
    """Return the dataclass that a field holds, may hold or holds several of; None for a union of several."""
    if is_dataclass(hint) and isinstance(hint, type):
        return hint
    tables = [kind for kind in map(_table_of, get_args(hint)) if kind]
    return tables[0] if len(tables) == 1 else None


_DEGREE, _TURN_A_MINUTE = math.pi / 180.0, math.pi / 30.0

#: for each SI unit, units understood in its place: one of them is 10^exponent times factor in SI, (exponent, factor)
UNITS: Mapping[str, Mapping[str, tuple[int, float]]] = {
    DIMENSIONLESS: {DIMENSIONLESS: (0, 1.0)},
    "m": {"m": (0, 1.0), "cm": (-2, 1.0), "mm": (-3, 1.0)},
    "kg": {"kg": (0, 1.0), "g": (-3, 1.0)},
    "kg m^2": {"kg m^2": (0, 1.0), "kg cm^2": (-4, 1.0), "g m^2": (-3, 1.0), "g cm^2": (-7, 1.0)},
    "rad": {"rad": (0, 1.0), "deg": (0, _DEGREE)},
    "rad/s": {
        "rad/s": (0, 1.0),
        "deg/s": (0, _DEGREE),
        "deg/min": (0, math.pi / 10800.0),
        "rpm": (0, _TURN_A_MINUTE),
    },
    "s": {"s": (0, 1.0), "ms": (-3, 1.0)},
    "V": {"V": (0, 1.0), "mV": (-3, 1.0)},
    "N m": {"N m": (0, 1.0), "mN m": (-3, 1.0)},
    "N m/A": {"N m/A": (0, 1.0), "mN m/A": (-3, 1.0)},
    "rad/s/V": {"rad/s/V": (0, 1.0), "rpm/V": (0, _TURN_A_MINUTE)},
    "N m s/rad": {"N m s/rad": (0, 1.0), "mN m s/rad": (-3, 1.0)},
    "m/s^2": {"m/s^2": (0, 1.0)},
}


def to_si(value: float, unit: str, si_unit: str) -> float:
    """Return a value given in `unit` as a value in `si_unit`.

    InputError if `unit` is not one that `si_unit` can be written in.
    """
    exponent, factor = _scale(unit, si_unit)
    return _shifted(value, exponent) * factor


def from_si(value: float, unit: str, si_unit: str) -> float | None:
    """Return the shortest decimal in `unit` that reads back as exactly this SI value, or None.

    A file can then say 45 deg and still give back the very float that it was written from.
    """
    exponent, factor = _scale(unit, si_unit)
    raw = _shifted(value / factor, -exponent)
    for digits in range(1, 18):
        candidate = float(f"{raw:.{digits}g}")
        if to_si(candidate, unit, si_unit) == value:
            return candidate
    return None


def _shifted(value: float, exponent: int) -> float:
    """Return the float nearest to a float's shortest decimal times 10^exponent."""
    return float(Decimal(repr(float(value))).scaleb(exponent)) if exponent else value


def _scale(unit: str, si_unit: str) -> tuple[int, float]:
    known = UNITS.get(si_unit, {si_unit: (0, 1.0)})
    spelled = unit.replace("²", "^2").replace("·", " ").replace("°", "deg").strip()
    if spelled not in known:
        quoted = either(f'"{name}"' for name in known)
        raise InputError(f"the unit {unit!r} is not known here; write {quoted}")
    return known[spelled]
