"""One schema for each part of the controller: the settings that people write, the records that compiled code reads.

Settings are a frozen dataclass whose fields are annotated by a `Setting`: unit, meaning and allowed range. The checks,
the table of a controller file and its comments follow from it.

    @dataclass(frozen=True, kw_only=True)
    class Notch(Part):
        frequency: Annotated[float, Setting("Hz", "centre of the band", above=0.0)]

A record is a frozen dataclass whose fields carry a `Number`: unit and shape. `schema_of` derives the NumPy structured
type from it; Numba reads its fields by name. Array lengths are compile-time maxima (`MAX_WHEELS`), so that every
controller has the same record. What a part remembers is declared in the same way and starts as zeros.

    @dataclass(frozen=True, kw_only=True, eq=False)
    class IntegralRecord:
        on: int = field(default=1, metadata=whole())
        step: float = field(metadata=number("s"))
        gain: NDArray[np.float64] = field(metadata=number("N m/(m s)", MAX_WHEELS, 3))

All fields are 8 bytes wide (or 4, see `converted`), so that a record has no padding: names, order, units and lengths
are those of a C struct. `Schema.digest` covers all of them.

Between Python and compiled code a record travels as the float64 array of its bytes and is viewed as the record inside:
1.2 us a call, where records by themselves (`np.void`) take 17 us, because Numba works out the type of each anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, MISSING, dataclass, fields
from functools import cache
from hashlib import sha256
from typing import Annotated, Any, Literal, TypeVar, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, create_model

from ballbot.errors import InputError
from ballbot.schema import validate_table

#: wheels that a record has room for
MAX_WHEELS = 4

#: key of a field's metadata
_NUMBER = "number"


@dataclass(frozen=True)
class Setting:
    """What a field of a part's settings means, and which values it may have; it annotates the field."""

    unit: str  #: SI unit; "1" without one
    text: str  #: what it is, for the comment in a file
    _: KW_ONLY
    above: float | None = None  #: exclusive lower limit
    at_least: float | None = None
    at_most: float | None = None
    below: float | None = None  #: exclusive upper limit
    columns: int = 0  #: of a matrix with a row for each wheel; 0 for a number


@cache
def settings_of(part: type) -> dict[str, Setting]:
    """Return the settings of a part's dataclass by name, in order."""
    hints = get_type_hints(part, include_extras=True)
    return {one.name: get_args(hints[one.name])[1] for one in fields(part)}


def check_settings(part: object, label: str) -> None:
    """Check every setting of a part, and make arrays of its matrices.

    InputError if a value is outside its range, or a matrix has another shape or a value that is not finite.
    """
    values = {name: np.asarray(getattr(part, name)).tolist() for name in settings_of(type(part))}
    try:
        validate_table(table_of(type(part)), values, of="its settings")
    except InputError as error:
        raise InputError(f"The {label}: {error}") from None
    for name, one in settings_of(type(part)).items():
        if one.columns:
            object.__setattr__(part, name, np.array(values[name], dtype=np.float64))


class Table(BaseModel):
    """A table of a file that knows its keys and refuses others."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


TableType = TypeVar("TableType", bound=Table)


@cache
def table_of(part: type) -> type[Table]:
    """Return the table of a controller file that describes a part, derived from its settings."""
    known = settings_of(part)
    return extended_table(
        f"{part.__name__}Table",
        Table,
        {
            one.name: (_type_of(known[one.name]), ... if one.default is MISSING else one.default)
            for one in fields(part)
        },
    )


def extended_table(
    name: str, base: type[TableType], keys: Mapping[str, tuple[object, object]]
) -> type[TableType]:
    """Return a table with more keys, each with its type and its default (... if it must be given)."""
    described: dict[str, Any] = dict(keys)  # pydantic types its keyword arguments one by one
    return create_model(name, __base__=base, **described)


def _type_of(one: Setting) -> object:
    if not one.columns:
        return Annotated[float, Field(gt=one.above, ge=one.at_least, le=one.at_most, lt=one.below)]
    row = Annotated[tuple[FiniteFloat, ...], Field(min_length=one.columns, max_length=one.columns)]
    return Annotated[tuple[row, ...], Field(min_length=3, max_length=MAX_WHEELS)]


def table_text(name: str, part: object, text: str) -> str:
    """Return a part's table for a controller file, each key with its meaning and unit; `text` stands above it."""
    lines = [f"\n# {text}", f"[{name}]"]
    for key, one in settings_of(type(part)).items():
        unit = "" if one.unit == "1" else f" [{one.unit}]"
        lines += [f"# {one.text}{unit}", f"{key} = {_value_text(getattr(part, key))}"]
    return "\n".join(lines) + "\n"


def _value_text(value: float | NDArray[np.float64]) -> str:
    if isinstance(value, np.ndarray):
        rows = "".join(f"\n  [{', '.join(map(repr, row))}]," for row in value.tolist())
        return f"[{rows}\n]"
    return repr(float(value))


@dataclass(frozen=True, kw_only=True)
class Number:
    """What a field of a record is."""

    unit: str  #: SI unit; "1" without one
    shape: tuple[int, ...] = ()  #: of an array; () for a single number
    whole: bool = False  #: a count or a flag


def number(unit: str, *shape: int) -> Mapping[str, Number]:
    """Return the metadata of a record's field that holds a real number, or an array of them."""
    return {_NUMBER: Number(unit=unit, shape=shape)}


def whole(*shape: int) -> Mapping[str, Number]:
    """Return the metadata of a record's field that holds a whole number: a count, or a flag that is 0 or 1."""
    return {_NUMBER: Number(unit="1", shape=shape, whole=True)}


Precision = Literal["double", "single"]
_TYPES = {"double": (np.float64, np.int64), "single": (np.float32, np.int32)}


@dataclass(frozen=True, kw_only=True)
class Schema:
    """Names, order, types, lengths and units of a record's fields; a field is a `Number` or a record itself."""

    name: str
    fields: Mapping[str, Number | Schema]
    text: str = ""  #: what the record is, for the comment of the struct in C

    def dtype(self, precision: Precision = "double") -> np.dtype[np.void]:
        """Return the NumPy structured type: 8 bytes a number, or 4 in single precision."""
        real, integer = _TYPES[precision]
        return np.dtype(
            [
                (name, one.dtype(precision))
                if isinstance(one, Schema)
                else (name, integer if one.whole else real, one.shape)
                for name, one in self.fields.items()
            ]
        )

    @property
    def digest(self) -> str:
        """SHA-256 of names, order, types, lengths and units."""
        return sha256("\n".join(self.lines()).encode()).hexdigest()

    def lines(self, above: str = "") -> list[str]:
        """Return a line for each number, as "prediction.by_torque real [4, 20, 10] 1/(N m)"."""
        found = []
        for name, one in self.fields.items():
            if isinstance(one, Schema):
                found += one.lines(f"{above}{name}.")
            else:
                found.append(f"{above}{name} {'whole' if one.whole else 'real'} {list(one.shape)} {one.unit}")
        return found

    def zeros(self) -> NDArray[np.void]:
        """Return a record (1,) of zeros: a part that the controller lacks, or the memory at the start."""
        return np.zeros(1, self.dtype())


@cache
def schema_of(record: type) -> Schema:
    """Return the schema of a record's dataclass."""
    numbers: dict[str, Number | Schema] = {one.name: one.metadata[_NUMBER] for one in fields(record)}
    return Schema(name=record.__name__, fields=numbers, text=(record.__doc__ or "").partition("\n")[0])


def fill_record(target: NDArray[np.void], value: object) -> None:
    """Copy a record's dataclass into a structured array (1,); an array fills the first places of its room.

    InputError if an array has more rows than there is room for, or a value is not finite.
    """
    for name, one in schema_of(type(value)).fields.items():
        if isinstance(one, Schema):
            continue
        given = np.asarray(getattr(value, name), dtype=np.float64)
        room = target[name][0]
        if not np.isfinite(given).all():
            raise InputError(f"{name} of the controller's record {type(value).__name__} is not finite.")
        if given.ndim != len(one.shape) or any(a > b for a, b in zip(given.shape, one.shape, strict=True)):
            raise InputError(
                f"{name} of the controller's record {type(value).__name__} has the shape {given.shape}; there is "
                f"room for {one.shape}."
            )
        if one.shape:
            room[tuple(slice(size) for size in given.shape)] = given
        else:
            target[name][0] = given


def converted(record: NDArray[np.void], schema: Schema, *, largest_loss: float = 1e-6) -> NDArray[np.void]:
    """Return records of a schema in single precision, as firmware has them.

    InputError if a number is beyond the range of its type, or rounding loses more than `largest_loss` of it.
    """
    result = np.zeros(record.shape, schema.dtype("single"))
    _convert(record, result, schema, schema.name, largest_loss)
    return result


def _convert(
    source: NDArray[np.void], target: NDArray[np.void], schema: Schema, above: str, largest_loss: float
) -> None:
    for name, one in schema.fields.items():
        place, given = f"{above}.{name}", source[name]
        if isinstance(one, Schema):
            _convert(given, target[name], one, place, largest_loss)
            continue
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            target[name] = given
        back = target[name].astype(given.dtype)
        kept = back == given if one.whole else np.abs(back - given) <= largest_loss * np.abs(given)
        lost = ~kept
        if lost.any():
            worst = given[lost].ravel()[0]
            raise InputError(
                f"{place} is {worst:g}; in single precision it would become {back[lost].ravel()[0]:g}."
            )
