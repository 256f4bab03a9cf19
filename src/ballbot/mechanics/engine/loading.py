"""One robot's numbers out of a block's work array, with their names, in compiled code.

`load` returns the `Parameters` of a lane. `ballbot.mechanics.parameters` has the list of these numbers, which is
followed here. The wheels' further terms are loaded only for a `DirectedLaw`, and are absent otherwise.
"""

from itertools import count

from ballbot.mechanics.engine.lanes import TORQUE, entry, restored, shaped
from ballbot.mechanics.engine.tracing import traced
from ballbot.mechanics.friction import NO_TERMS, DirectedLaw, has_directions, loaded_coulomb
from ballbot.mechanics.parameters import (
    RIGID_SHAPE,
    RIGID_SIZE,
    TERMS_SIZE,
    WHEEL_SHAPE,
    WHEEL_SIZE,
    DirectedWheel,
    Parameters,
    Pivoting,
    Wheel,
)

_DECAY = Parameters._fields.index("decay")


@traced
def row_count(selected):
    """Return `row_size` in compiled code."""
    own = WHEEL_SIZE + TERMS_SIZE * isinstance(selected.law, DirectedLaw)
    return RIGID_SIZE + len(selected.wheels) * own


def unpacked(selected, at):
    """Return the `Parameters` of a robot whose numbers are at(0), at(1), .., without a motor's load."""
    n, places = len(selected.wheels), count()
    rigid = shaped(RIGID_SHAPE, map(at, places))
    wheels = [Wheel(*shaped(WHEEL_SHAPE, map(at, places)), *rigid[_DECAY]) for _ in range(n)]
    if isinstance(selected.law, DirectedLaw):
        wheels = [DirectedWheel(*wheel, shaped(NO_TERMS, map(at, places))) for wheel in wheels]
    return Parameters(*rigid, tuple(wheels))  # pyright: ignore[reportCallIssue] (as many as `RIGID_SHAPE`)


@traced
def load_parameters(selected, work, lane):
    """Return the `Parameters` of one lane without a motor's load."""
    return unpacked(selected, lambda place: entry(work, place, lane))


@traced
def under_torque(P, u):
    """Return the `Parameters` with the friction that the drives have under the motors' torques u."""
    wheels = [
        wheel._replace(c=loaded_coulomb(wheel.c, wheel.terms, torque)) if has_directions(wheel) else wheel
        for wheel, torque in zip(P.wheels, u, strict=True)
    ]
    return P._replace(wheels=tuple(wheels))


@traced
def load(selected, work, lane):
    """Return the `Parameters` of one lane of a whole block's work array, under the torques in the lane."""
    P = load_parameters(selected, work, lane)
    return under_torque(P, restored(selected.wheels, work, TORQUE, lane))


def state_like(selected):
    """Return zeros, as many as a state has numbers: ten, and the spin where the ball pivots."""
    return (0.0,) * (11 if isinstance(selected, Pivoting) else 10)
