"""MATLAB files of version 4 to 7: their real numeric variables; everything else in them is passed over.

The fields of a structure are variables, too: `log.roll` is roll if no other structure of the file has series, else
log.roll.

A long matrix, such as the angles of three wheels or a whole log, is also given by its columns: `wheel` of N rows and
three columns is wheel_1, wheel_2, wheel_3.

SciPy's reader trusts the sizes that a file states, and damaged files end the interpreter. This one checks each against
the content, and reads no more than `ballbot.files` allows, packed or unpacked. The formats are those of "MAT-File
Format" (The MathWorks, R2023b).
"""

from __future__ import annotations

import io
import math
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import format_bytes
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_bytes, write_bytes
from ballbot.log.columns import Columns

#: numbers as a data element of version 5 stores them, by its type
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED = 14, 15
#: classes of arrays, from double to uint64; before them cells, structures, texts and sparse matrices
_NUMERIC_CLASSES = range(6, 16)
_STRUCTURE = 2
#: structures within structures that are read
_DEEPEST = 3
_COMPLEX = 0x08
#: a matrix has a log's columns if it has so many rows, and so many times more than columns
_LONG, _LONGER = 50, 5
#: the types of version 4, by the third digit of a variable's first number
_STORED_4 = ("f8", "f4", "i4", "i2", "u2", "u1")
_HEADER, _HEADER_4 = 128, 20
#: what MATLAB takes as the name of a variable
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")


class _DamagedError(Exception):
    """The file contradicts itself or ends too early."""


@dataclass(frozen=True, kw_only=True)
class _Element:
    """A tagged piece of a file of version 5."""

    kind: int
    content: memoryview


def read_mat(path: str | Path) -> Columns:
    """Return the variables of a file, each as one row of numbers in the order of its rows, and long matrices' columns.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, of another version, or too large.
    """
    return parse_mat(memoryview(read_bytes(path)), source=str(path))


def write_mat(path: str | Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) as compressed column vectors of those names, whole or not at all.

    Raises
    ------
    InputError
        If MATLAB has no variable of such a name, or the file cannot be written.
    """
    from scipy.io import savemat  # scipy.io takes longer to import than a file to read

    for name in columns:
        if not _NAME.fullmatch(name):
            raise InputError(
                f"The column name {name!r} cannot be written to a MATLAB file; use up to 63 letters, digits and "
                "underscores, a letter first."
            )
    stream = io.BytesIO()
    vectors = {name: np.asarray(values)[:, None] for name, values in columns.items()}
    savemat(stream, vectors, do_compression=True, long_field_names=True)
    write_bytes(path, stream.getvalue())


def parse_mat(content: memoryview, *, source: str) -> Columns:
    """Return the variables of a file's content, as `read_mat` does; a refusal names `source`."""
    try:
        if len(content) >= 4 and 0 in bytes(content[:4]):  # as no text of a header's begins
            return _by_name(_variables_4(content))
        return _by_name(_variables_5(content))
    except (_DamagedError, struct.error, zlib.error, UnicodeDecodeError) as error:
        raise InputError(
            f"{source} is not a complete MATLAB file of version 7 or earlier: {error}."
        ) from None


def _by_name(variables: Iterator[tuple[str, NDArray[np.float64]]]) -> Columns:
    found: Columns = {}
    parts: Columns = {}
    for name, values in _without_prefix(list(variables)):
        if name in found:
            raise _DamagedError(f"two variables have the name {name[:40]!r}")
        found[name] = values.ravel()
        for column, numbers in enumerate(_columns_of(values), start=1):
            parts.setdefault(f"{name}_{column}", numbers)
    return parts | found


def _without_prefix(
    variables: list[tuple[str, NDArray[np.float64]]],
) -> list[tuple[str, NDArray[np.float64]]]:
    """Return variables with the fields of the file's only structure by their own names, if these are no others'.

    Structures of single numbers, such as a robot's parameters beside its log, do not count if one has series.
    """
    structures = {name.partition(".")[0] for name, _ in variables if "." in name}
    series = {name.partition(".")[0] for name, values in variables if "." in name and values.size > 1}
    chosen = series if len(series) == 1 else structures
    parts = [name.partition(".") for name, _ in variables]
    names = [
        field if field and first in chosen else name
        for (first, _, field), (name, _) in zip(parts, variables, strict=True)
    ]
    if len(chosen) != 1 or len(set(names)) < len(names):
        return variables
    return [(short, values) for short, (_, values) in zip(names, variables, strict=True)]


def _columns_of(values: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the columns of a long matrix, or its rows if these are long; none of other arrays."""
    if values.ndim != 2 or min(values.shape) < 2:
        return []
    tall = values if values.shape[0] > values.shape[1] else values.T
    rows, columns = tall.shape
    return list(tall.T) if rows >= max(_LONG, _LONGER * columns) else []


def _variables_5(content: memoryview) -> Iterator[tuple[str, NDArray[np.float64]]]:
    if len(content) < _HEADER:
        raise _DamagedError("it is too short")
    order = {b"IM": "<", b"MI": ">"}.get(bytes(content[126:128]))
    if order is None or struct.unpack_from(f"{order}H", content, 124)[0] != 0x0100:
        raise _DamagedError("its header is of another format, such as version 7.3 (save it with -v7)")
    left = LARGEST_TABLE
    for element in _elements(content[_HEADER:], order):
        if element.kind == _COMPRESSED:
            unpacked = zlib.decompressobj().decompress(element.content, left + 1)
            left -= len(unpacked)
            if left < 0:
                raise _DamagedError(f"it unpacks to more than {format_bytes(LARGEST_TABLE)}")
            inner = list(_elements(memoryview(unpacked), order))
        else:
            inner = [element]
        for one in inner:
            if one.kind == _MATRIX:
                yield from _mat_array(one.content, order)


def _elements(content: memoryview, order: str) -> Iterator[_Element]:
    place = 0
    while place + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, place)
        if kind >> 16:  # a small one, its size and type in four bytes and its content in the next four
            kind, size, start, step = kind & 0xFFFF, kind >> 16, place + 4, 8
            if size > 4:
                raise _DamagedError("a small element claims more than its four bytes")
        else:
            start, step = place + 8, 8 + (size if kind == _COMPRESSED else -(-size // 8) * 8)
        if start + size > len(content):
            raise _DamagedError("it ends within a variable")
        yield _Element(kind=kind, content=content[start : start + size])
        place += step
    if place < len(content) and any(content[place:]):
        raise _DamagedError("it ends within a variable")


def _mat_array(content: memoryview, order: str, field: str = "") -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the name and the numbers of an array, if it has real numbers; of a structure those of its fields.

    `field` is the name of an array that is a field, which its own content lacks.
    """
    parts = list(_elements(content, order))
    if not parts or len(parts[0].content) != 8:
        raise _DamagedError("a variable has no flags")
    flags = struct.unpack_from(f"{order}I", parts[0].content)[0]
    if flags & 0xFF == _STRUCTURE and field.count(".") < _DEEPEST:
        yield from _fields(parts, order, field)
    if flags & 0xFF not in _NUMERIC_CLASSES or (flags >> 8) & _COMPLEX:
        return
    if len(parts) < 4:
        raise _DamagedError("a variable has no numbers")
    if parts[1].kind != 5:
        raise _DamagedError("a variable has no shape")
    shape = np.frombuffer(parts[1].content[: len(parts[1].content) // 4 * 4], f"{order}i4").tolist()
    name = field or bytes(parts[2].content).decode("ascii")
    if not name:  # MATLAB's own, beside function handles
        return
    if not name.isprintable():
        raise _DamagedError("a variable has a name that cannot be printed")
    stored = _STORED.get(parts[3].kind)
    if stored is None:
        raise _DamagedError("a variable has numbers of an unknown type")
    yield name, _mat_numbers(parts[3].content, f"{order}{stored}", shape)


def _fields(parts: list[_Element], order: str, field: str) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the name and the numbers of each field of a structure that is no array of structures."""
    if len(parts) < 5 or len(parts[3].content) != 4:
        raise _DamagedError("a structure has no fields")
    (length,) = struct.unpack(f"{order}i", parts[3].content)
    text = bytes(parts[4].content)
    if length < 1 or len(text) % length:
        raise _DamagedError("a structure has names of an unknown length")
    names = [text[k : k + length].partition(b"\0")[0].decode("ascii") for k in range(0, len(text), length)]
    owner = field or bytes(parts[2].content).decode("ascii")
    if len(parts) - 5 != len(names) or not owner:
        return
    for name, part in zip(names, parts[5:], strict=True):
        if part.kind == _MATRIX and part.content:
            yield from _mat_array(part.content, order, f"{owner}.{name}")


def _variables_4(content: memoryview) -> Iterator[tuple[str, NDArray[np.float64]]]:
    place = 0
    order = "<" if 0 <= struct.unpack_from("<i", content)[0] <= 5000 else ">"
    while place < len(content):
        if place + _HEADER_4 > len(content):
            raise _DamagedError("it ends within a variable")
        form, rows, columns, imaginary, name_size = struct.unpack_from(f"{order}5i", content, place)
        stored, kind = form // 10 % 10, form % 10
        if not 0 <= form <= 5000 or stored >= len(_STORED_4) or min(rows, columns, name_size) < 0:
            raise _DamagedError("the header of a variable is invalid")
        start = place + _HEADER_4 + name_size
        numbers = f"{order}{_STORED_4[stored]}"
        size = rows * columns * np.dtype(numbers).itemsize
        place = start + size * (2 if imaginary else 1)
        if place > len(content):
            raise _DamagedError("it ends within a variable")
        if kind == 0 and not imaginary:
            name = bytes(content[start - name_size : start]).rstrip(b"\0").decode("latin-1")
            if not name.isprintable():
                raise _DamagedError("a variable has a name that cannot be printed")
            yield name, _mat_numbers(content[start : start + size], numbers, [rows, columns])


def _mat_numbers(content: memoryview, stored: str, shape: list[int]) -> NDArray[np.float64]:
    """Return an array of that shape; MATLAB stores columns."""
    item = np.dtype(stored).itemsize
    if not shape or min(shape) < 0 or math.prod(shape) * item != len(content):
        raise _DamagedError(f"a variable has {len(content)} bytes for the shape {shape[:4]}")
    with np.errstate(invalid="ignore"):  # signalling NaN
        values = np.frombuffer(content, stored).astype(np.float64)
    return values.reshape(shape, order="F")
