"""The records of numbers, of a controller, a filter or sensors, and of their memory, as compiled code reads them.

A record is a frozen dataclass whose fields carry a `Number`: unit and shape. `schema_of` derives the NumPy structured
type from it; Numba reads its fields by name. Array lengths are compile-time maxima (`MAX_WHEELS`), so that every
controller has the same record. A part's memory is declared in the same way and starts as zeros.

    @dataclass(frozen=True, kw_only=True, eq=False)
    class IntegralRecord:
        on: int = field(default=1, metadata=whole())
        step: float = field(metadata=number("s"))
        gain: NDArray[np.float64] = field(metadata=number("N m/(m s)", MAX_WHEELS, 3))

All fields are 8 bytes wide (or 4, see `converted`), so that a record has no padding: names, order, units and lengths
are those of a C struct. `Schema.digest` covers all of them.

A record is passed to compiled code as the float64 array of its bytes, which the code views as the record. A call then
takes 1.2 us; with records (`np.void`) it takes 17 us, because Numba determines their type at every call.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from hashlib import sha256
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

#: wheels that a record has room for
MAX_WHEELS = 4

#: key of a field's metadata
_NUMBER = "number"


@dataclass(frozen=True, kw_only=True)
class Number:
    """Unit, shape and kind of a record's field."""

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
    text: str = ""  #: description, for the comment of the struct in C

    def dtype(self, precision: Precision = "double") -> np.dtype[np.void]:
        """Return the NumPy structured type: 8 bytes a number, or 4 in single precision."""
        real, integer = _TYPES[precision]
        return np.dtype(
            [
                (name, member.dtype(precision))
                if isinstance(member, Schema)
                else (name, integer if member.whole else real, member.shape)
                for name, member in self.fields.items()
            ]
        )

    @property
    def digest(self) -> str:
        """SHA-256 of names, order, types, lengths and units."""
        return sha256("\n".join(self.lines()).encode()).hexdigest()

    def lines(self, above: str = "") -> list[str]:
        """Return a line for each number, as "prediction.by_torque real [4, 20, 10] 1/(N m)"."""
        lines = []
        for name, member in self.fields.items():
            if isinstance(member, Schema):
                lines += member.lines(f"{above}{name}.")
            else:
                lines.append(
                    f"{above}{name} {'whole' if member.whole else 'real'} {list(member.shape)} {member.unit}"
                )
        return lines

    def zeros(self) -> NDArray[np.void]:
        """Return a record (1,) of zeros: a missing part, or the memory at the start of a run."""
        return np.zeros(1, self.dtype())


@cache
def schema_of(record: type) -> Schema:
    """Return the schema of a record's dataclass."""
    numbers: dict[str, Number | Schema] = {member.name: member.metadata[_NUMBER] for member in fields(record)}
    return Schema(name=record.__name__, fields=numbers, text=(record.__doc__ or "").partition("\n")[0])


def fill_record(target: NDArray[np.void], value: object) -> None:
    """Copy a record's dataclass into a structured array (1,); an array fills the first elements of its field."""
    for name, member in schema_of(type(value)).fields.items():
        if isinstance(member, Schema):
            continue
        given = np.asarray(getattr(value, name), dtype=np.float64)
        room = target[name][0]
        if not np.isfinite(given).all():
            raise InputError(f"{name} of the controller's record {type(value).__name__} is not finite.")
        if given.ndim != len(member.shape) or any(
            a > b for a, b in zip(given.shape, member.shape, strict=True)
        ):
            raise InputError(
                f"{name} of the controller's record {type(value).__name__} has the shape {given.shape}; there is "
                f"room for {member.shape}."
            )
        if member.shape:
            room[tuple(slice(size) for size in given.shape)] = given
        else:
            target[name][0] = given


def packed(value: object) -> NDArray[np.float64]:
    """Return a record's numbers as compiled code reads them: the float64 array of its bytes."""
    record = schema_of(type(value)).zeros()
    fill_record(record, value)
    return record.view(np.float64)


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
    for name, member in schema.fields.items():
        path, given = f"{above}.{name}", source[name]
        if isinstance(member, Schema):
            _convert(given, target[name], member, path, largest_loss)
            continue
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            target[name] = given
        back = target[name].astype(given.dtype)
        lost = ~(back == given if member.whole else np.abs(back - given) <= largest_loss * np.abs(given))
        if lost.any():
            worst = given[lost].ravel()[0]
            raise InputError(
                f"{path} is {worst:g}; in single precision it would become {back[lost].ravel()[0]:g}."
            )
