"""One robot's numbers out of a block's work array, with their names, in compiled code.

`load` returns the `Parameters` of a lane. `ballbot.mechanics.parameters` has the list of these numbers, which is
followed here.
"""

from itertools import count

from ballbot.mechanics.engine.lanes import TORQUE, entry, restored, shaped
from ballbot.mechanics.engine.tracing import traced
from ballbot.mechanics.engine.vector import each
from ballbot.mechanics.friction import under_load
from ballbot.mechanics.parameters import (
    RIGID_SHAPE,
    WHEEL_SHAPE,
    Parameters,
    Pivoting,
    Wheel,
    row_size,
)

_DECAY = Parameters._fields.index("decay")


@traced
def row_count(selected):
    """Return `row_size` in compiled code."""
    return row_size(selected)


def unpacked(selected, at):
    """Return the `Parameters` of a robot whose numbers are at(0), at(1), .., without a motor's load."""
    n, places = len(selected.wheels), count()
    rigid = shaped(RIGID_SHAPE, map(at, places))
    wheels = [Wheel(*shaped(WHEEL_SHAPE, map(at, places)), *rigid[_DECAY]) for _ in range(n)]
    return Parameters(*rigid, tuple(wheels))  # pyright: ignore[reportCallIssue] (as many as `RIGID_SHAPE`)


@traced
def load_parameters(selected, work, lane):
    """Return the `Parameters` of one lane without a motor's load."""
    return unpacked(selected, lambda place: entry(work, place, lane))


@traced
def under_torque(P, u):
    """Return the `Parameters` with the friction that the drives have under the motors' torques u."""
    return P._replace(wheels=each(under_load, P.wheels, u))


@traced
def load(selected, work, lane):
    """Return the `Parameters` of one lane of a whole block's work array, under the torques in the lane."""
    P = load_parameters(selected, work, lane)
    return under_torque(P, restored(selected.wheels, work, TORQUE, lane))


def state_like(selected):
    """Return zeros, as many as a state has numbers: ten, and the spin where the ball pivots."""
    return (0.0,) * (11 if isinstance(selected, Pivoting) else 10)
