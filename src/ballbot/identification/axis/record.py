"""One axis: what is recorded of it, and how a file holds that.

`AxisRecord`: force and position of one axis over time, and the loop that moved it where that is known.

The axis is   M a = F - offset - friction(v)   with F held over a sample. For an axis that turns, M is an inertia
[kg m^2], forces are torques [N m] and positions angles [rad].

Real numeric variables of a MATLAB file of version 4 to 7; everything else in the file is passed over.

SciPy's reader trusts the sizes that a file states, and damaged files end the interpreter. This one checks each
against what is there, and reads no more than `ballbot.files` allows, packed or unpacked. The formats are those of
"MAT-File Format" (The MathWorks, R2023b).

Axis records from files: named variables of a MATLAB file, or columns of CSV and Parquet.
"""

from __future__ import annotations

import difflib
import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import format_bytes, real_array, whole_number
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_bytes
from ballbot.log.columns import LARGEST_CELL, mark_missing
from ballbot.log.formats import read_columns

#: rows that make a record too short for any of the methods
LEAST_ROWS = 200
#: a sampling interval may differ from the mean one by this share of it
LARGEST_JITTER = 0.05


@dataclass(frozen=True, kw_only=True)
class PositionVelocityLoop:
    """A position loop around a velocity loop, both proportional.

    u = k_v (k_p (reference - position) - velocity), within +-limit; force = force_per_input u

    The velocity is the position's difference over `span` samples.
    """

    position_gain: float  #: k_p [1/s]
    velocity_gain: float  #: k_v [input s/m]
    force_per_input: float  #: [N/input]
    limit: float = np.inf  #: largest |u|
    span: int = 1  #: samples that the velocity is a difference over

    def __post_init__(self) -> None:
        for name in ("position_gain", "velocity_gain", "force_per_input", "limit"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"The loop's {name} is {getattr(self, name):g}; it must be above zero.")
        whole_number(self.span, "The loop's span of samples", least=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRecord:
    """A record at even intervals.

    Raises
    ------
    InputError
        Where lengths differ, values are missing, the axis never moves, or there are too few rows.
    """

    name: str
    sample_time: float  #: h [s]
    force: NDArray[np.float64]  #: (N,) F [N], held from each row to the next
    position: NDArray[np.float64]  #: (N,) [m]
    reference: NDArray[np.float64] | None = None  #: (N,) [m]; needed for closed loop
    loop: PositionVelocityLoop | None = None  #: needed for closed loop
    unit: Literal["m", "rad"] = "m"
    added: NDArray[np.float64] | None = None  #: (N,) the part of `force` that is not the loop's [N]

    def __post_init__(self) -> None:
        if not 0.0 < self.sample_time < np.inf:
            raise InputError(
                f"{self.name}: the sample time is {self.sample_time:g} s; it must be above zero."
            )
        for name in ("force", "position", "reference", "added"):
            if getattr(self, name) is None:
                continue
            # contiguous and writable, as compiled code takes it
            values = real_array(getattr(self, name), ("N",), f"{self.name}: {name}", finite=False)
            object.__setattr__(self, name, values)
            if values.shape != (len(self.force),):
                raise InputError(
                    f"{self.name}: {('the added force' if name == 'added' else name)} has {values.size} "
                    f"values and the force has {self.force.size}; name a column of the same length."
                )
            if not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
                raise InputError(
                    f"{self.name}: {name} is missing or not finite in row {row}; every row needs a value."
                )
        if len(self) < LEAST_ROWS:
            raise InputError(f"{self.name} has {len(self)} rows; at least {LEAST_ROWS} are needed.")
        if np.ptp(self.position) == 0.0:
            raise InputError(
                f"{self.name}: the position never changes, so friction cannot be identified; check its column."
            )

    def __len__(self) -> int:
        return len(self.force)

    @property
    def loop_force(self) -> NDArray[np.float64]:
        """The part of the force that its loop gives (N,) [N]."""
        return self.force if self.added is None else self.force - self.added

    @property
    def t(self) -> NDArray[np.float64]:
        """Time from the record's start (N,) [s]."""
        return self.sample_time * np.arange(len(self), dtype=np.float64)

    @property
    def force_unit(self) -> str:
        """[N], or [N m] for an axis that turns."""
        return "N" if self.unit == "m" else "N m"


def even_sample_time(name: str, t: NDArray[np.float64]) -> float:
    """Return the sample time [s] of rows at times t (N,).

    Raises
    ------
    InputError
        Where time does not increase, or not by even steps.
    """
    if len(t) < 2 or not np.isfinite(t).all():
        raise InputError(f"{name}: the time has fewer than two rows or missing values.")
    steps = np.diff(t)
    mean = float(t[-1] - t[0]) / len(steps)
    if mean <= 0.0 or np.abs(steps - mean).max() > LARGEST_JITTER * mean:
        row = int(np.abs(steps - mean).argmax()) + 2
        raise InputError(
            f"{name}: time increases by {steps[row - 2]:g} s at row {row} and "
            f"by {mean:g} s on average; identify-axis needs equal intervals."
        )
    return mean


Variables = dict[str, NDArray[np.float64]]

#: numbers as a data element of version 5 stores them, by its type
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED = 14, 15
#: classes of arrays, from double to uint64; before them cells, structures, texts and sparse matrices
_NUMERIC_CLASSES = range(6, 16)
_COMPLEX = 0x08
#: the types of version 4, by the third digit of a variable's first number
_STORED_4 = ("f8", "f4", "i4", "i2", "u2", "u1")
_HEADER, _HEADER_4 = 128, 20


class _DamagedError(Exception):
    """The file contradicts itself or ends too early."""


@dataclass(frozen=True, kw_only=True)
class _Element:
    """A tagged piece of a file of version 5."""

    kind: int
    content: memoryview


def read_mat(path: str | Path) -> Variables:
    """Return the variables of a file, each as one row of numbers in the order of its rows.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, of another version, or too large.
    """
    return parse_mat(memoryview(read_bytes(path)), source=str(path))


def parse_mat(content: memoryview, *, source: str) -> Variables:
    """Return the variables of a file's content, as `read_mat` does; a refusal names `source`."""
    try:
        if len(content) >= 4 and 0 in bytes(content[:4]):  # as no text of a header's begins
            return dict(_variables_4(content))
        return dict(_variables_5(content))
    except (_DamagedError, struct.error, zlib.error, UnicodeDecodeError) as error:
        raise InputError(
            f"{source} is not a complete MATLAB file of version 7 or earlier: {error}."
        ) from None


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


def _mat_array(content: memoryview, order: str) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the name and the numbers of an array, if it has real numbers."""
    parts = list(_elements(content, order))
    if not parts or len(parts[0].content) != 8:
        raise _DamagedError("a variable has no flags")
    flags = struct.unpack_from(f"{order}I", parts[0].content)[0]
    if flags & 0xFF not in _NUMERIC_CLASSES or (flags >> 8) & _COMPLEX:
        return
    if len(parts) < 4:
        raise _DamagedError("a variable has no numbers")
    if parts[1].kind != 5:
        raise _DamagedError("a variable has no shape")
    shape = np.frombuffer(parts[1].content[: len(parts[1].content) // 4 * 4], f"{order}i4").tolist()
    name = bytes(parts[2].content).decode("ascii")
    if not name:  # MATLAB's own, beside function handles
        return
    if not name.isprintable():
        raise _DamagedError("a variable has a name that cannot be printed")
    stored = _STORED.get(parts[3].kind)
    if stored is None:
        raise _DamagedError("a variable has numbers of an unknown type")
    yield name, _mat_numbers(parts[3].content, f"{order}{stored}", shape)


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
    """Return an array (N,), its rows one after another; MATLAB stores columns."""
    item = np.dtype(stored).itemsize
    if not shape or min(shape) < 0 or math.prod(shape) * item != len(content):
        raise _DamagedError(f"a variable has {len(content)} bytes for the shape {shape[:4]}")
    with np.errstate(invalid="ignore"):  # signalling NaN
        values = np.frombuffer(content, stored).astype(np.float64)
    return mark_missing(values.reshape(shape, order="F").ravel())


@dataclass(frozen=True, kw_only=True)
class AxisColumns:
    """Which variable of a file is what. Numbers may be written out, or be a scalar variable's name."""

    time: str = "t"
    position: str = "position"
    force: str = "force"
    force_scale: str = "1"  #: force [N] over what the file's column holds
    added_force: str | None = None  #: a force that acts beside it, in newtons already
    reference: str | None = None
    position_gain: str | None = None  #: k_p; both gains, or neither
    velocity_gain: str | None = None  #: k_v, from velocity to what the force column holds
    limit: str | None = None  #: of what the force column holds
    unit: Literal["m", "rad"] = "m"


def read_axis_record(path: str | Path, columns: AxisColumns) -> AxisRecord:
    """Read a record.

    Raises
    ------
    InputError
        Where the file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    variables = _read_variables(Path(path))
    name = Path(path).name

    def column(wanted: str) -> NDArray[np.float64]:
        return _variable(name, variables, wanted)

    t = column(columns.time)
    scale = _number(name, variables, columns.force_scale)
    force = scale * column(columns.force)
    added = None if columns.added_force is None else column(columns.added_force)
    if added is not None and added.shape == force.shape:
        force = force + added
    reference = None if columns.reference is None else column(columns.reference)
    record = AxisRecord(
        name=name,
        sample_time=even_sample_time(name, t),
        force=force,
        position=column(columns.position),
        reference=reference,
        unit=columns.unit,
        added=added,
    )
    loop = _loop(name, variables, columns, scale)
    if loop is None:
        return record
    if reference is None:
        raise InputError(
            f"{name}: the gains of the loop need the column of the reference as well; give --reference."
        )
    return replace(record, loop=_with_span(record, reference, loop))


def _loop(name: str, variables: Variables, columns: AxisColumns, scale: float) -> PositionVelocityLoop | None:
    if columns.position_gain is None and columns.velocity_gain is None:
        return None
    if columns.position_gain is None or columns.velocity_gain is None:
        raise InputError("The loop needs both gains; give --position-gain and --velocity-gain.")
    return PositionVelocityLoop(
        position_gain=_number(name, variables, columns.position_gain),
        velocity_gain=_number(name, variables, columns.velocity_gain),
        force_per_input=scale,
        limit=np.inf if columns.limit is None else _number(name, variables, columns.limit),
    )


def _with_span(
    record: AxisRecord, reference: NDArray[np.float64], loop: PositionVelocityLoop
) -> PositionVelocityLoop:
    """Return the loop with the span, 1 to 4 samples, that reproduces the force recorded best."""

    def error(span: int) -> float:
        velocity = (record.position[span:] - record.position[:-span]) / (span * record.sample_time)
        aim = loop.position_gain * (reference - record.position)[span:]
        u = np.clip(loop.velocity_gain * (aim - velocity), -loop.limit, loop.limit)
        return float(np.std(loop.force_per_input * u - record.loop_force[span:]))

    return replace(loop, span=min(range(1, 5), key=error))


def _read_variables(path: Path) -> Variables:
    return read_mat(path) if path.suffix.lower() == ".mat" else read_columns(path)


def _variable(name: str, variables: Variables, wanted: str) -> NDArray[np.float64]:
    if wanted not in variables:
        near = difflib.get_close_matches(wanted, variables, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(variables)}."
        raise InputError(f"{name} has no variable {wanted!r}; {hint}")
    return variables[wanted]


def _number(name: str, variables: Variables, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        values = _variable(name, variables, text)
        if values.size != 1:
            raise InputError(f"{name}: {text!r} has {values.size} values; it must be one number.") from None
        value = float(values[0])
    if not abs(value) <= LARGEST_CELL:
        raise InputError(f"{name}: {text!r} is {value:g}; it must be a finite number.")
    return value
