"""Numbers from callers, checked: arrays before compiled code reads them, sizes of tables before they are made.

Compiled code does not check an index: an array that is too short is read past its end, which gives wrong numbers or
ends the process, and an array of another type or order is compiled for anew, which takes seconds. So every public
function that passes arrays to compiled code passes them through `real_array`, once a call: the result has the
requested shape and is float64, contiguous, aligned and writable. An array that is so already is returned itself, not
copied.

A wrong unit or one stray number makes a table of seconds one of years. Code that makes rows from a user's numbers
calls `check_table` or `rows_between` first.
"""

import math
import operator
from numbers import Real
from typing import SupportsIndex, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_FLOAT = np.dtype(np.float64)
#: numbers up to which a product of vectors is taken, before it would be spread over threads
_FEW = 1000
#: length of each dimension; a name stands for any length above zero, "..." in front for any dimensions of any length
Shape = tuple[int | str, ...]


def real_array(
    # A list, or an array of integers or floats in any order; neither text nor complex numbers nor booleans
    value: ArrayLike,
    # length of each dimension; a name stands for any length above zero, "..." in front for any dimensions
    shape: Shape,
    what: str,  # what it is, as the message of an error begins
    *,
    finite: bool = True,  # whether every number must be finite
) -> Floats:
    """Return an array as compiled code takes it.

    InputError if the array has another shape, is not of real numbers, or holds a value that is not finite.

    Returns
    -------
    ndarray
        float64, C order, aligned and writable: `value` itself where it is so already.
    """
    if type(value) is np.ndarray and value.dtype == _FLOAT and value.flags.carray:
        array = value
    else:
        array = _converted(value, what)
    if array.shape != shape and not _fits(array.shape, shape):
        raise InputError(f"{what} has the shape {array.shape}; {_wanted(shape)}.")
    if finite and not _is_finite(array):
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        shown = place[0] if len(place) == 1 else place
        raise InputError(
            f"{what} holds a value that is not finite ({array[place]} at {shown}); every value must be "
            "finite."
        )
    return array


def index_array(value: ArrayLike, what: str, *, count: int, length: int) -> Ints:
    """Return `length` indices (length,) of `count` rows as compiled code takes them, contiguous int64.

    InputError if they are not so many whole numbers from 0 to count - 1.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.empty(0)
    if array.dtype.kind not in "iu" or array.shape != (length,):
        raise InputError(f"{what} is {_short(value)}; it must be a row of {length} whole numbers.")
    if length and not (array.min() >= 0 and array.max() < count):
        raise InputError(f"{what} has a number that is no row's, 0 to {count - 1}.")
    return np.require(array, np.int64, ["C", "A", "W"])


def real_number(value: object, what: str) -> float:
    """Return a finite number as a float; InputError if it is not one."""
    if type(value) is float and math.isfinite(value):
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        raise InputError(f"{what} is {_short(value)}; it must be a number.")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{what} is {_short(value)}; it must be a finite number.")
    return number


def positive_number(value: object, what: str) -> float:
    """Return a finite number above zero as a float; raise InputError if it is not one."""
    number = real_number(value, what)
    if not number > 0.0:
        raise InputError(f"{what} is {number:g}; it must be above zero.")
    return number


def checked_sample_time(value: object, what: str) -> float:
    """Return the sample time [s] of a robot's controller or sensors as a float; raise InputError if it is not one."""
    time = positive_number(value, what)
    if time < SHORTEST_SAMPLE:
        raise InputError(f"{what} is {time:g} s; it must be at least {SHORTEST_SAMPLE:g} s.")
    if time > LONGEST_SAMPLE:
        raise InputError(
            f"{what} is {time:g} s; it must be at most {LONGEST_SAMPLE:g} s; {instead_of_sample_time(time)}"
        )
    return time


def instead_of_sample_time(time: float) -> str:
    """Return what to do about a sample time [s] that is too long; milliseconds are often typed as seconds."""
    return f"did you mean {1e-3 * time:g} s?" if time >= LONGEST_SAMPLE else "shorten it."


def whole_number(value: object, what: str, *, least: int) -> int:
    """Return a whole number not below `least` as an int; raise InputError if it is not one."""
    if isinstance(value, bool | np.bool_) or not hasattr(value, "__index__"):
        raise InputError(f"{what} is {_short(value)}; it must be a whole number.")
    number = operator.index(cast("SupportsIndex", value))
    if number < least:
        raise InputError(f"{what} is {number}; it must be {least} or more.")
    return number


def _converted(value: ArrayLike, what: str) -> Floats:
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # rows of different lengths
        raise InputError(f"{what} is {_short(value)}; it must be an array of numbers.") from None
    if array.dtype.kind not in "iuf" or np.ma.is_masked(value):
        kind = "masked" if np.ma.is_masked(value) else array.dtype.name
        raise InputError(f"{what} is an array {array.shape} of {kind} values; it must be of real numbers.")
    return np.require(array, _FLOAT, ["C", "A", "W"])


def _is_finite(array: Floats) -> bool:
    # for a few numbers a sum of squares costs a fifth of isfinite; if it overflows, the numbers themselves decide
    if array.size <= _FEW and math.isfinite(np.vdot(array, array)):
        return True
    return bool(np.isfinite(array).all())


def _fits(shape: tuple[int, ...], wanted: Shape) -> bool:
    if wanted[0] == "...":
        wanted = wanted[1:]
        if len(shape) < len(wanted):
            return False
        shape = shape[len(shape) - len(wanted) :]
    return len(shape) == len(wanted) and all(
        have > 0 if isinstance(want, str) else have == want for have, want in zip(shape, wanted, strict=True)
    )


def _wanted(shape: Shape) -> str:
    if len(shape) == 1:
        return f"it must be {shape[0]} numbers"
    if shape[0] == "..." and len(shape) == 2:
        return f"its last dimension must be {shape[1]}"
    return f"it must be ({', '.join(map(str, shape))})"


def _short(value: object) -> str:
    words = " ".join(repr(value).split())
    return words if len(words) <= 40 else f"{words[:37]}..."


#: of a table in memory: 14 hours at 200 Hz; names of columns; 400 MB of float64
MOST_ROWS, MOST_COLUMNS, MOST_CELLS = 10_000_000, 1000, 50_000_000
#: between two decisions of a controller, and two steps of the physics engine [s]
SHORTEST_SAMPLE, SHORTEST_STEP = 1e-5, 1e-6
#: longest sample time of a robot's controller and sensors [s]
LONGEST_SAMPLE = 1.0
#: what a length of time is written in from twice of it on [s]
_LENGTHS = {"years": 365.25 * 86400.0, "days": 86400.0, "hours": 3600.0, "minutes": 60.0}


def check_table(
    # rows and columns: of the table that is to be made
    rows: float,
    columns: int,
    *,
    source: str,  # the subject of the refusal: a file's name, or "The run"
) -> None:
    """Do nothing if a table of that size fits.

    InputError if it does not.
    """
    if columns > MOST_COLUMNS:
        raise InputError(f"{source} has {columns:,} columns; at most {MOST_COLUMNS:,} are read.")
    most = min(MOST_ROWS, MOST_CELLS // max(columns, 1))
    if not rows <= most:
        raise InputError(
            f"{source} has {_count(rows)} rows of {columns} columns; at most {most:,} such rows fit in "
            "memory. Use a part of it or a lower sampling rate."
        )


def rows_between(
    # span and interval: [s]; the interval above zero
    span: float,
    interval: float,
    *,
    columns: int = 1,  # of the table that will have so many rows
    source: str,  # the subject of the refusal, as for `check_table`
) -> int:
    """Return how many whole intervals a span of time has.

    InputError if a table of so many rows does not fit.
    """
    rows = span / interval if interval > 0.0 else math.inf
    most = min(MOST_ROWS, MOST_CELLS // max(columns, 1))
    if not 0.0 <= rows <= most:
        raise InputError(
            f"{source} spans {format_duration(span)}, which is {_count(rows)} rows at intervals of {interval:g} "
            f"s; at most {most:,} rows fit in memory. Correct the times, their unit or the interval."
        )
    return math.floor(rows + 1e-6)


def format_duration(seconds: float) -> str:
    """Return a length of time in the unit in which one reads it: 4.06 s, 54 years."""
    for unit, length in _LENGTHS.items():
        if abs(seconds) >= 2.0 * length:
            number = seconds / length
            return f"{number:.2g} {unit}" if abs(number) < 10.0 else f"{number:.0f} {unit}"
    return f"{seconds:.4g} s"


def format_bytes(size: float) -> str:
    """Return a number of bytes as one reads it: 1.2 MB."""
    for unit, bytes_each in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= bytes_each:
            return f"{size / bytes_each:.3g} {unit}"
    return f"{size:.0f} bytes"


def _count(rows: float) -> str:
    return f"{rows:,.0f}" if rows < 1e15 else f"{rows:.3g}"
