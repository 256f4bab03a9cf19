"""Robots side by side: the work array of a block, its rows, and how compiled code reads and writes them.

Row i of a block's flat array begins at i * LANES, and a robot is a column. A step is a chain of operations that wait
for each other; it is therefore taken in short loops over all lanes, one for each part, that leave their results in the
scratch rows: while one lane's numbers wait, the next lane's are on their way.

`load` returns one robot's numbers with their names, the `RobotNumbers` of a lane.
"""

from collections.abc import Iterator
from itertools import count
from typing import TypeVar, cast

import numpy as np

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.tracing import traced
from ballbot.mechanics.engine.vector import each
from ballbot.mechanics.friction import Wheel, under_load
from ballbot.mechanics.parameters import (
    LARGEST_ROW,
    RIGID_SHAPE,
    WHEEL_SHAPE,
    Pivoting,
    RobotNumbers,
    parameter_count,
)

#: a number, a tuple or tuples in tuples
Shape = TypeVar("Shape")

#: robots that one vectorised loop steps side by side; a constant, so that strides are known when compiling. An odd
#: number of cache lines: with 32 lanes the rows of one robot alone fell into a quarter of the cache's sets
LANES = 40

#: rows kept for a robot's numbers; the state and the rest follow
MAX_PARAMETERS = LARGEST_ROW
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
#: of contacts that may slip (`engine/slip.py`): how fast the wheels turn beyond rolling [rad/s] and the ball's lowest
#: point moves over the floor [m/s]; the friction coefficients of wheels and floor, 0 where nothing slips; weight of the
#: body less what pushes it [N]; a row of `pack_contacts`; the floor's load [N]; the step of a lane in which one slips
SLIP = PASSED + 7
GRIP = SLIP + 6
BODY = GRIP + 2
PRESSING = BODY + 3
FLOOR = PRESSING + 30
SLIDES = FLOOR + 1
SCRATCH = SLIDES + 1  #: results of a step's parts for its later parts
ROWS = SCRATCH + 177  # as many as `play_block` needs with four wheels and a ball that pivots

#: lanes that one vector instruction of the widest processors takes; ranges of lanes begin at multiples
GROUP = 8


@inlined
def new_work(rows):
    """Return a work array of so many rows, zeros, from the start of a cache line: no vector then lies across two."""
    numbers = np.zeros(rows * LANES + GROUP)
    first = -(numbers.ctypes.data // 8) % GROUP
    return numbers[first : first + rows * LANES]


@traced
def entry(work, row, lane):
    """Return the number of that row and lane."""
    return work[row * LANES + lane]


@traced
def put(work, row, lane, value):
    """Store a number at that row and lane."""
    work[row * LANES + lane] = value


@inlined
def put_robot(work, lane, row):
    """Store the numbers of a robot, a packed row, in a lane."""
    for i in range(len(row)):
        work[i * LANES + lane] = row[i]


@inlined
def robot_in(work, lane):
    """Return which of the block's robots a lane holds."""
    return int(entry(work, ROBOT, lane))


@traced
def swap(work, row, first, second):
    """Exchange two lanes' numbers of a row."""
    number, other = entry(work, row, first), entry(work, row, second)
    put(work, row, first, other)
    put(work, row, second, number)


@traced
def restored(like: Shape, work, row, lane) -> Shape:
    """Return the numbers of a lane from `row` on in the shape of `like`, a tuple or tuples in tuples."""
    return cast(Shape, shaped(like, (entry(work, row + i, lane) for i in count())))


def shaped(like: object, numbers: Iterator):
    """Return the next numbers in the shape of `like`."""
    if not isinstance(like, tuple):
        return next(numbers)
    items = [shaped(part, numbers) for part in like]
    return type(like)(*items) if hasattr(like, "_fields") else tuple(items)


@traced
def stored(work, row, lane, value):
    """Store the numbers of a tuple, or of tuples in tuples, in the rows from `row` on."""
    for i, number in enumerate(_flat(value)):
        put(work, row + i, lane, number)


def _flat(value: float | tuple) -> Iterator:
    if isinstance(value, tuple):
        for part in value:
            yield from _flat(part)
    else:
        yield value


_DECAY = RobotNumbers._fields.index("decay")


def unpacked(selected, at):
    """Return the `RobotNumbers` of a robot whose numbers are at(0), at(1), .., without a motor's load."""
    n, indices = len(selected.wheels), count()
    rigid = shaped(RIGID_SHAPE, map(at, indices))
    wheels = [Wheel(*shaped(WHEEL_SHAPE, map(at, indices)), *rigid[_DECAY]) for _ in range(n)]
    if selected.own_wheel:
        like = (0.0,) * parameter_count(selected)
        wheels = [
            selected.own_wheel(
                wheel.axle,
                wheel.b,
                wheel.terms.coulomb_asymmetry,
                wheel.terms.load,
                shaped(like, map(at, indices)),
                0.0,
            )
            for wheel in wheels
        ]
    return RobotNumbers(*rigid, tuple(wheels))  # pyright: ignore[reportCallIssue] (as many as `RIGID_SHAPE`)


@traced
def load_parameters(selected, work, lane):
    """Return the `RobotNumbers` of one lane without a motor's load."""
    return unpacked(selected, lambda index: entry(work, index, lane))


@traced
def under_torque(P, u):
    """Return the `RobotNumbers` with the friction that the drives have under the motors' torques u."""
    return P._replace(wheels=each(under_load, P.wheels, u))


@traced
def load(selected, work, lane):
    """Return the `RobotNumbers` of one lane of a whole block's work array, under the torques in the lane."""
    P = load_parameters(selected, work, lane)
    return under_torque(P, restored(selected.wheels, work, TORQUE, lane))


def state_like(selected):
    """Return zeros, as many as a state has numbers: ten, and the spin where the ball pivots."""
    return (0.0,) * (11 if isinstance(selected, Pivoting) else 10)
