"""One robot's numbers out of a block's work array, with their names, in compiled code.

`load` returns the `Parameters` of a lane. `ballbot.mechanics.parameters` has the list of these numbers, which is
followed here. The wheels' further terms are loaded only for a `DirectedLaw`, and are absent otherwise.
"""

import numpy as np

from ballbot.mechanics.engine.compiled import by_types_of, inlined
from ballbot.mechanics.engine.lanes import TORQUE, entry, restored
from ballbot.mechanics.engine.vector import each, each_with, second, written
from ballbot.mechanics.friction import NO_TERMS, DirectedLaw, loaded_coulomb
from ballbot.mechanics.parameters import (
    PLACE_SPEED_SCALE,
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
_DECAY_SHAPE = RIGID_SHAPE[_DECAY]


def row_count(selected) -> int:  # pragma: no cover (compiled form below)
    """Return `row_size` in compiled code."""
    raise NotImplementedError("compiled code only")


@by_types_of(row_count)
def _row_count(selected):
    size = np.int64(RIGID_SIZE + len(selected.types[0]) * (WHEEL_SIZE + TERMS_SIZE * _is_directed(selected)))
    return lambda selected: size


@inlined
def _wheel_of(own, decay):
    return Wheel(own[0], own[1], own[2], own[3], decay[0], decay[1])


@inlined
def _directed_wheel_of(wheel, terms):
    return DirectedWheel(wheel.axle, wheel.b, wheel.c, wheel.s, wheel.inv_vs, wheel.delta, terms)


@inlined
def _loaded_wheel(wheel, torque):
    c = loaded_coulomb(wheel.c, wheel.terms, torque)
    return DirectedWheel(wheel.axle, wheel.b, c, wheel.s, wheel.inv_vs, wheel.delta, wheel.terms)


@inlined
def _load_plain_wheel(work, wheel, lane):
    own = restored(WHEEL_SHAPE, work, RIGID_SIZE + WHEEL_SIZE * wheel, lane)
    return _wheel_of(own, restored(_DECAY_SHAPE, work, PLACE_SPEED_SCALE, lane))


def load_wheel(selected, work, wheel, lane) -> Wheel:  # pragma: no cover (compiled form below)
    """Return the `Wheel` or `DirectedWheel` of that number of one lane, under the torque in the lane."""
    raise NotImplementedError("compiled code only")


@by_types_of(load_wheel)
def _load_wheel(selected, work, wheel, lane):
    if not _is_directed(selected):
        return lambda selected, work, wheel, lane: _load_plain_wheel(work, wheel, lane)

    def directed(selected, work, wheel, lane):
        first = RIGID_SIZE + WHEEL_SIZE * len(selected.wheels)
        terms = restored(NO_TERMS, work, first + TERMS_SIZE * wheel, lane)
        return _loaded_wheel(
            _directed_wheel_of(_load_plain_wheel(work, wheel, lane), terms),
            entry(work, TORQUE + wheel, lane),
        )

    return directed


def _is_directed(selected) -> bool:
    """Return whether the type of a selector selects a `DirectedLaw`."""
    return selected.types[1].instance_class is DirectedLaw


def load_parameters(selected, work, lane) -> Parameters:  # pragma: no cover (compiled form below)
    """Return the `Parameters` of one lane without a motor's load."""
    raise NotImplementedError("compiled code only")


@by_types_of(load_parameters)
def _load_parameters(selected, work, lane):
    if not _is_directed(selected):
        return lambda selected, work, lane: _load_plain(selected, work, lane)

    def directed(selected, work, lane):
        first = RIGID_SIZE + WHEEL_SIZE * len(selected.wheels)
        terms = restored(each_with(second, selected.wheels, NO_TERMS), work, first, lane)
        P = _load_plain(selected, work, lane)
        return _with_wheels(P, each(_directed_wheel_of, P.wheels, terms))

    return directed


def under_torque(selected, P, u) -> Parameters:  # pragma: no cover (compiled form below)
    """Return the `Parameters` with the friction that the drives have under the motors' torques u."""
    raise NotImplementedError("compiled code only")


@by_types_of(under_torque)
def _under_torque(selected, P, u):
    if not _is_directed(selected):
        return lambda selected, P, u: P
    return lambda selected, P, u: _with_wheels(P, each(_loaded_wheel, P.wheels, u))


def load(selected, work, lane) -> Parameters:  # pragma: no cover (compiled form below)
    """Return the `Parameters` of one lane of a whole block's work array, under the torques in the lane."""
    raise NotImplementedError("compiled code only")


@by_types_of(load)
def _load(selected, work, lane):
    if not _is_directed(selected):
        return lambda selected, work, lane: _load_plain(selected, work, lane)
    return lambda selected, work, lane: under_torque(
        selected,
        load_parameters(selected, work, lane),
        restored(selected.wheels, work, TORQUE, lane),
    )


def _with_wheels(P, wheels) -> Parameters:  # pragma: no cover (compiled form below)
    """Return `Parameters` from others, or from their numbers before the wheels, with these wheels."""
    raise NotImplementedError("compiled code only")


@by_types_of(_with_wheels)
def _with_these_wheels(P, wheels):
    numbers = "".join(f"P[{i}], " for i in range(len(RIGID_SHAPE)))
    return written("P, wheels", f"Parameters({numbers}wheels)", Parameters=Parameters)


@inlined
def _load_plain(selected, work, lane):
    rigid = restored(RIGID_SHAPE, work, 0, lane)
    own = restored(each_with(second, selected.wheels, WHEEL_SHAPE), work, RIGID_SIZE, lane)
    return _with_wheels(rigid, each_with(_wheel_of, own, rigid[_DECAY]))


def state_like(selected) -> tuple:  # pragma: no cover (compiled form below)
    """Return zeros, as many as a state has numbers: ten, and the spin where the ball pivots."""
    raise NotImplementedError("compiled code only")


@by_types_of(state_like)
def _state_like(selected):
    size = 11 if selected.instance_class is Pivoting else 10
    return written("selected", "(" + "0.0, " * size + ")")
