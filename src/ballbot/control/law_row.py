"""Where each number of a control law stands: in the row that is packed once, and in what the law remembers.

A row is one controller's numbers, so that every robot in a batch can have a law of its own: what the wheels share of
each part, then each wheel's own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array
from ballbot.control.parts.compensation import FRICTION_PER_WHEEL, FRICTION_SIZE, pack_friction
from ballbot.control.parts.disturbance_observer import pack_observer
from ballbot.control.parts.driveline_adaptation import (
    ADAPTATION_MEMORY,
    ADAPTATION_SIZE,
    ROLLING,
    pack_adaptation,
)
from ballbot.control.parts.feed_forward import FLAT_PER_WHEEL, FLAT_SIZE, pack_feed_forward
from ballbot.control.parts.floor_adaptation import FLOOR_MEMORY, FLOOR_SIZE, pack_floor
from ballbot.control.parts.integral import INTEGRAL_MEMORY, INTEGRAL_PER_WHEEL, INTEGRAL_SIZE, pack_integral
from ballbot.control.parts.lean_limit import BOUND_SIZE, pack_bound
from ballbot.control.parts.load_scaling import LOAD_PER_WHEEL, LOAD_SIZE, pack_load
from ballbot.control.parts.notch import NOTCH_MEMORY, NOTCH_SIZE, pack_notch
from ballbot.control.parts.past import PAST_MEMORY
from ballbot.control.parts.prediction import (
    PREDICTION_MEMORY,
    PREDICTION_PER_WHEEL,
    PREDICTION_SIZE,
    pack_prediction,
)
from ballbot.control.parts.reference_shaping import SHAPING_MEMORY, SHAPING_SIZE, pack_shaping
from ballbot.control.parts.torque_balance import BALANCE_MEMORY, BALANCE_PER_WHEEL, MAX_WHEELS, pack_balance

if TYPE_CHECKING:
    from ballbot.control.controller import Controller

# places in a row: the torque limit, then what the wheels share of each part, then the wheels
FRICTION = 1
SHAPING = FRICTION + FRICTION_SIZE
FLAT = SHAPING + SHAPING_SIZE
INTEGRAL = FLAT + FLAT_SIZE
OBSERVER = INTEGRAL + INTEGRAL_SIZE
ADAPTATION = OBSERVER + 2
RATE = ADAPTATION + ADAPTATION_SIZE  # samples a second
BOUND = RATE + 1
NOTCH = BOUND + BOUND_SIZE
FLOOR = NOTCH + NOTCH_SIZE
LOAD = FLOOR + FLOOR_SIZE
PREDICTION = LOAD + LOAD_SIZE
WHEELS = PREDICTION + PREDICTION_SIZE
# places in a wheel's part: gain (10), then each part's own
OWN_FRICTION = 10
OWN_FLAT = OWN_FRICTION + FRICTION_PER_WHEEL
OWN_INTEGRAL = OWN_FLAT + FLAT_PER_WHEEL
OWN_BALANCE = OWN_INTEGRAL + INTEGRAL_PER_WHEEL
OWN_LOAD = OWN_BALANCE + BALANCE_PER_WHEEL
OWN_PREDICTION = OWN_LOAD + LOAD_PER_WHEEL
PER_WHEEL = OWN_PREDICTION + PREDICTION_PER_WHEEL
# places in the memory: shaping, integrals, what floor adaptation remembers, rates, torque given back, what driveline
# adaptation and each wheel's notch remember, the past, and the state predicted
SUMS = SHAPING_MEMORY
DRAG = SUMS + INTEGRAL_MEMORY
BALANCE = DRAG + FLOOR_MEMORY
BACK = BALANCE + BALANCE_MEMORY
SCALES = BACK + MAX_WHEELS
NOTCHES = SCALES + ADAPTATION_MEMORY
PAST = NOTCHES + NOTCH_MEMORY * MAX_WHEELS
AHEAD = PAST + PAST_MEMORY

#: how many numbers a law remembers from update to update; all zero at the start of a run
MEMORY = AHEAD + PREDICTION_MEMORY


def pack_law(controller: Controller) -> NDArray[np.float64]:
    """Return a controller's numbers as the row that compiled code reads."""
    n, parts = len(controller.gain), controller.parts
    friction, own_friction = pack_friction(controller)
    flat, own_flat = pack_feed_forward(parts.feed_forward, n)
    integral, own_integral = pack_integral(parts.integral, n, controller.sample_time)
    delay = parts.prediction.delay if parts.prediction else 0.0
    shaping = pack_shaping(parts.shaping, controller.sample_time, delay=delay)
    observer, adaptation = parts.observer, parts.driveline_adaptation
    judge = observer or adaptation
    load, own_load = pack_load(controller)
    prediction, own_prediction = pack_prediction(parts.prediction, n)
    balance = pack_balance(judge and judge.balance, n)
    own = [controller.gain, own_friction, own_flat, own_integral, balance, own_load, own_prediction]
    shared = [controller.torque_limit, *friction, *shaping, *flat, *integral]
    shared += pack_observer(observer, controller.sample_time)
    shared += pack_adaptation(adaptation, controller.sample_time)
    shared += [1.0 / controller.sample_time, *pack_bound(controller)]
    shared += pack_notch(parts.notch, controller.sample_time)
    shared += [*pack_floor(parts.floor_adaptation, controller.sample_time), *load, *prediction]
    row = np.concatenate([shared, np.column_stack(own).ravel()])
    return real_array(row, (WHEELS + PER_WHEEL * n,), "The array of a controller's numbers")


def scales(memory: NDArray[np.float64], wheel_count: int) -> NDArray[np.float64]:
    """Return by what each wheel's friction is multiplied, and the rolling friction that is told from it (n + 1,)."""
    return 1.0 + memory[[*range(SCALES, SCALES + wheel_count), SCALES + ROLLING]]


def drag(memory: NDArray[np.float64]) -> float:
    """Return the part of the integral [m s] that turns with the motion."""
    return float(memory[DRAG])


def given_back(memory: NDArray[np.float64], wheel_count: int) -> NDArray[np.float64]:
    """Return the torque of each wheel that the disturbance observer gives back (n,) [N m]."""
    return memory[BACK : BACK + wheel_count].copy()
