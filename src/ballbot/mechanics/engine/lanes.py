"""Robots side by side: the work array of a block, its rows, and how compiled code reads and writes them.

Row i of a block's flat array begins at i * LANES, and a robot is a column. Loops over lanes become vector code where
indices are unsigned and no array is put into a tuple. A step is a chain of operations that wait for each other; it is
therefore taken in short loops over all lanes, one for each part, that leave their results in the scratch rows: while
one lane's numbers wait, the next lane's are on their way.
"""

from collections.abc import Iterator
from itertools import count
from typing import TypeVar

import numpy as np
from numba import types

from ballbot.mechanics.engine.compiled import by_types_of, inlined
from ballbot.mechanics.engine.vector import written
from ballbot.mechanics.parameters import LARGEST_ROW

#: robots that one vectorised loop steps side by side; a constant, so that strides are known when compiling
LANES = 32

#: rows kept for a robot's numbers; the state and the rest follow
MAX_PARAMETERS = np.int64(LARGEST_ROW)  # with a plain integer, each row would be a function to compile
STATE = MAX_PARAMETERS
TRIAL = STATE + 11  #: where a step would end
TORQUE = TRIAL + 11
STEP = TORQUE + 4
MARGIN = STEP + 1  #: positive where the trial counts
ROBOT = MARGIN + 1  #: which of the block's robots the lane holds
ROTOR = ROBOT + 1  #: of gears with play (`play_block`): j_r of a motor [kg m^2], and the play [rad]
PLAY = ROTOR + 1
MOTOR = (
    PLAY + 1
)  #: the motors' speeds [rad/s], how far each is ahead of its wheel, and the wheels' angles [rad]
AHEAD = MOTOR + 4
ANGLE = AHEAD + 4
LOAD = ANGLE + 4  #: torques that load the wheels themselves [N m]
PASSED = LOAD + 4  #: torques that the gears pass on, and the forces at the other contacts
SCRATCH = PASSED + 7  #: results of a step's parts for its later parts
ROWS = SCRATCH + 160  # as many as `play_block` needs with four wheels and a ball that pivots

#: lanes that one vector instruction of the widest processors takes; ranges of lanes begin at multiples
GROUP = 8

Like = TypeVar("Like")


@inlined
def new_work():
    """Return a block's work array, zeros, from the beginning of a cache line: no vector then lies across two."""
    numbers = np.zeros(ROWS * LANES + GROUP)
    first = -(numbers.ctypes.data // 8) % GROUP
    return numbers[first : first + ROWS * LANES]


@inlined
def entry(work, row, lane):
    """Return the number of that row and lane."""
    # unsigned: no test for an index from the end, which keeps a loop scalar
    return work[np.uint64(row * LANES + lane)]


@inlined
def put(work, row, lane, value):
    """Store a number at that row and lane."""
    work[np.uint64(row * LANES + lane)] = value


@inlined
def put_robot(work, lane, row):
    """Store the numbers of a robot, a packed row, in a lane."""
    for i in range(len(row)):
        work[i * LANES + lane] = row[i]


@inlined
def robot_in(work, lane):
    """Return which of the block's robots a lane holds."""
    return int(entry(work, ROBOT, lane))


@inlined
def swap(work, row, first, second):
    """Exchange two lanes' numbers of a row."""
    number = entry(work, row, first)
    put(work, row, first, entry(work, row, second))
    put(work, row, second, number)


def restored(like: Like, work, row, lane) -> Like:  # pragma: no cover (compiled form below)
    """Return the numbers of a lane from `row` on as a tuple, named or not, or tuples in tuples, of the shape of `like`.

    The array is an argument of its own: in a tuple of arguments its reference would be counted in the loop over
    lanes, which would then not become vector code.
    """
    raise NotImplementedError("compiled code only")


@by_types_of(restored)
def _restored(like, work, row, lane):
    names = {one.__name__: one for one in _classes(like)}
    return written("like, work, row, lane", _entries(like, count()), unsigned=np.uint64, **names)


def _entries(shape: types.Type, rows: Iterator[int]) -> str:
    if isinstance(shape, types.BaseTuple):
        entries = "(" + "".join(f"{_entries(item, rows)}, " for item in _items(shape)) + ")"
        return _class_of(shape).__name__ + entries if isinstance(shape, types.BaseNamedTuple) else entries
    # written out: as a call, each row would be a function to compile
    return f"work[unsigned((row + {next(rows)}) * {LANES} + lane)]"


def _classes(shape: types.Type) -> Iterator[type]:
    """Yield the classes of named tuples in a tuple, its own included."""
    if isinstance(shape, types.BaseNamedTuple):
        yield _class_of(shape)
    if isinstance(shape, types.BaseTuple):
        for item in _items(shape):
            yield from _classes(item)


def stored(work, row, lane, value) -> None:  # pragma: no cover (compiled form below)
    """Store the numbers of a tuple, or of tuples in tuples, in the rows from `row` on."""
    raise NotImplementedError("compiled code only")


@by_types_of(stored)
def _stored(work, row, lane, value):
    # statements, not calls, likewise
    puts = (
        f"work[unsigned((row + {i}) * {LANES} + lane)] = {name}"
        for i, name in enumerate(_numbers(value, "value"))
    )
    return written("work, row, lane, value", "None", *puts, unsigned=np.uint64)


def _numbers(shape: types.Type, name: str) -> Iterator[str]:
    """Yield how each number of a tuple is written in code."""
    if isinstance(shape, types.BaseTuple):
        for i, item in enumerate(_items(shape)):
            yield from _numbers(item, f"{name}[{i}]")
    else:
        yield name


def _class_of(shape: types.BaseNamedTuple) -> type:
    return shape.instance_class  # pyright: ignore[reportAttributeAccessIssue] (each kind has it, their base does not)


def _items(shape: types.BaseTuple) -> tuple[types.Type, ...]:
    return tuple(shape)  # pyright: ignore[reportArgumentType] (each kind of tuple is iterable, their base is not)
