"""The control law, compiled once for the single robot and for robots in lanes.

    u = K S(psi) (r_s - x) + feed-forward + integral action + compensation + what was lost,     clipped to its limit

r_s is the reference, or what `ballbot.control.reference_shaping` and `.feed_forward` make of it; x is the state, or by
`.prediction` the one in which u will act; `.lean_bound` may bound r_s - x. The other parts are those of `.integral`
with `.floor_adaptation`, `.compensation` with `.driveline_adaptation` and `.load_scaling`, and
`.disturbance_observer`; all of it may pass a `.notch`. S(psi) turns the pairs (x y), (theta phi) of the error and their
rates by -psi into the heading frame: K is designed at psi = 0 and the wheels turn with the body (design section 8). A
law is one row of numbers, so that every robot in a batch can have one of its own, and what it remembers is another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.control.compensation import (
    FRICTION_PER_WHEEL,
    FRICTION_SIZE,
    load_friction,
    pack_friction,
    relative_rate,
    rolling_force,
    rolling_torque,
    wheel_friction,
)
from ballbot.control.disturbance_observer import pack_observer
from ballbot.control.driveline_adaptation import (
    ADAPTATION_MEMORY,
    ADAPTATION_SIZE,
    ROLLING,
    judge,
    pack_adaptation,
    tells,
    widen,
)
from ballbot.control.feed_forward import (
    FLAT_PER_WHEEL,
    FLAT_SIZE,
    load_flat,
    motion_torque,
    pack_feed_forward,
    times,
)
from ballbot.control.floor_adaptation import (
    FLOOR_MEMORY,
    FLOOR_SIZE,
    direction,
    pack_floor,
    tell_apart,
)
from ballbot.control.integral import (
    INTEGRAL_MEMORY,
    INTEGRAL_PER_WHEEL,
    INTEGRAL_SIZE,
    integrate,
    pack_integral,
)
from ballbot.control.lean_bound import BOUND_SIZE, asks_much, bounded, pack_bound
from ballbot.control.load_scaling import LOAD_PER_WHEEL, LOAD_SIZE, dry_share, pack_load, specific_force
from ballbot.control.notch import NOTCH_MEMORY, NOTCH_SIZE, notched, pack_notch
from ballbot.control.past import (
    BEYOND,
    COMPENSATED,
    EFFECTIVE,
    GIVEN,
    JUDGED,
    JUDGED_ROLLING,
    PAST_MEMORY,
    grow_older,
    past,
)
from ballbot.control.prediction import (
    PREDICTION_MEMORY,
    PREDICTION_PER_WHEEL,
    PREDICTION_SIZE,
    as_it_acted,
    pack_prediction,
    predict,
    remembered,
)
from ballbot.control.reference_shaping import (
    SHAPING_MEMORY,
    SHAPING_SIZE,
    Smooth,
    load_shaping,
    pack_shaping,
    shaped,
)
from ballbot.control.torque_balance import (
    BALANCE_MEMORY,
    BALANCE_PER_WHEEL,
    MOST_WHEELS,
    accelerations,
    lost_to_force,
    pack_balance,
    remember_rates,
    torque_needed,
)
from ballbot.mechanics.compiled import compiled, inlined
from ballbot.mechanics.equations import attitude

if TYPE_CHECKING:
    from ballbot.control.controller import Controller

# places in a row: the torque limit, then what the wheels share of each part, then the wheels
_FRICTION = 1
_SHAPING = _FRICTION + FRICTION_SIZE
_FLAT = _SHAPING + SHAPING_SIZE
_INTEGRAL = _FLAT + FLAT_SIZE
_OBSERVER = _INTEGRAL + INTEGRAL_SIZE
_ADAPTATION = _OBSERVER + 2
_RATE = _ADAPTATION + ADAPTATION_SIZE  # samples a second
_BOUND = _RATE + 1
_NOTCH = _BOUND + BOUND_SIZE
_FLOOR = _NOTCH + NOTCH_SIZE
_LOAD = _FLOOR + FLOOR_SIZE
_PREDICTION = _LOAD + LOAD_SIZE
_WHEELS = _PREDICTION + PREDICTION_SIZE
# places in a wheel's part: gain (10), then each part's own
_OWN_FRICTION = 10
_OWN_FLAT = _OWN_FRICTION + FRICTION_PER_WHEEL
_OWN_INTEGRAL = _OWN_FLAT + FLAT_PER_WHEEL
_OWN_BALANCE = _OWN_INTEGRAL + INTEGRAL_PER_WHEEL
_OWN_LOAD = _OWN_BALANCE + BALANCE_PER_WHEEL
_OWN_PREDICTION = _OWN_LOAD + LOAD_PER_WHEEL
_PER_WHEEL = _OWN_PREDICTION + PREDICTION_PER_WHEEL
# places in the memory: shaping, integrals, what floor adaptation remembers, rates, torque given back, what driveline
# adaptation and each wheel's notch remember, the past, and the state predicted
_SUMS = SHAPING_MEMORY
_DRAG = _SUMS + INTEGRAL_MEMORY
_BALANCE = _DRAG + FLOOR_MEMORY
_BACK = _BALANCE + BALANCE_MEMORY
_SCALES = _BACK + MOST_WHEELS
_NOTCHES = _SCALES + ADAPTATION_MEMORY
_PAST = _NOTCHES + NOTCH_MEMORY * MOST_WHEELS
_AHEAD = _PAST + PAST_MEMORY

#: how many numbers a law remembers from update to update; all zero at the start of a run
MEMORY = _AHEAD + PREDICTION_MEMORY

#: what `control_law` returns where the reference may be followed
ALLOWED = -1


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
    return np.concatenate([shared, np.column_stack(own).ravel()])


def scales(memory: NDArray[np.float64], wheel_count: int) -> NDArray[np.float64]:
    """Return by what each wheel's friction is multiplied, and the rolling friction that is told from it (n + 1,)."""
    return 1.0 + memory[[*range(_SCALES, _SCALES + wheel_count), _SCALES + ROLLING]]


def drag(memory: NDArray[np.float64]) -> float:
    """Return the part of the integral [m s] that turns with the motion."""
    return float(memory[_DRAG])


@inlined
def _limited(torque, limit):
    """Clip so that a NaN stays one."""
    return limit if torque > limit else (-limit if torque < -limit else torque)


@inlined
def _forbidden(reference):
    """Return the first place at which A r is not 0 (lean or a rate), else `ALLOWED`."""
    for i in (2, 3, 5, 6, 7, 8, 9):
        if reference[i] != 0.0:
            return i
    return ALLOWED


@inlined
def _turned(a, v_x, v_y):
    """Return a vector of the world in the heading frame."""
    return a.cos_psi * v_x + a.sin_psi * v_y, a.cos_psi * v_y - a.sin_psi * v_x


@inlined
def _wanted(row, memory, state, reference):
    """Return x, y and psi asked for, each a `Smooth`: shaped, or as they are."""
    if row[_SHAPING] > 0.0:
        return shaped(load_shaping(row, _SHAPING), memory, state, reference)
    return (
        Smooth(reference[0], 0.0, 0.0, 0.0, 0.0),
        Smooth(reference[1], 0.0, 0.0, 0.0, 0.0),
        Smooth(reference[4], 0.0, 0.0, 0.0, 0.0),
    )


@inlined
def _heading_error(flat, a, state, wanted):
    """Return S(psi) (r_s - x), r_s with the lean that the motion needs."""
    x, y, psi = wanted
    second, third = _turned(a, x.second, y.second), _turned(a, x.third, y.third)
    lean, lean_rate = times(flat.lean, second), times(flat.lean, third)
    ahead, ahead_rate = times(flat.offset, second), times(flat.offset, third)
    place = _turned(a, x.value - state[0], y.value - state[1])
    leaned = _turned(a, state[2], state[3])
    speed = _turned(a, x.rate - state[5], y.rate - state[6])
    leaning = _turned(a, state[7], state[8])
    return (
        place[0] - ahead[0],
        place[1] - ahead[1],
        lean[0] - leaned[0],
        lean[1] - leaned[1],
        psi.value - state[4],
        speed[0] - ahead_rate[0],
        speed[1] - ahead_rate[1],
        lean_rate[0] - leaning[0],
        lean_rate[1] - leaning[1],
        psi.rate - state[9],
    )


@inlined
def _feedback(row, place, e):
    return (
        row[place] * e[0]
        + row[place + 1] * e[1]
        + row[place + 2] * e[2]
        + row[place + 3] * e[3]
        + row[place + 4] * e[4]
        + row[place + 5] * e[5]
        + row[place + 6] * e[6]
        + row[place + 7] * e[7]
        + row[place + 8] * e[8]
        + row[place + 9] * e[9]
    )


@inlined
def _drive(row, memory, a, wanted, e, torques):
    """Fill in feedback, feed-forward, and integral action with what turns with the motion."""
    x, y, psi = wanted
    second, fourth = _turned(a, x.second, y.second), _turned(a, x.fourth, y.fourth)
    d_x, d_y = direction(row, _FLOOR, x.rate, y.rate)
    I_x, I_y = _turned(a, memory[_SUMS] + memory[_DRAG] * d_x, memory[_SUMS + 1] + memory[_DRAG] * d_y)
    I_psi = memory[_SUMS + 2]
    for i in range(len(torques)):
        place = _WHEELS + _PER_WHEEL * i
        own = place + _OWN_INTEGRAL
        torques[i] = (
            _feedback(row, place, e)
            + motion_torque(row, place + _OWN_FLAT, second, fourth, psi.second)
            + (row[own] * I_x + row[own + 1] * I_y + row[own + 2] * I_psi)
        )


@inlined
def _compensate(F, row, memory, a, state, wanted, e, torques):
    """Add the friction's compensation to the law's torques, and keep what adaptation judges."""
    d_x, d_y = a.cos_psi * e[5] - a.sin_psi * e[6], a.sin_psi * e[5] + a.cos_psi * e[6]
    d_t, d_p = a.cos_psi * e[7] - a.sin_psi * e[8], a.sin_psi * e[7] + a.cos_psi * e[8]
    rates = (
        state[5] + F.ahead * d_x,
        state[6] + F.ahead * d_y,
        state[7] + F.ahead * d_t,
        state[8] + F.ahead * d_p,
        state[9] + F.ahead * e[9],
    )
    relative, force = relative_rate(F, a, rates), rolling_force(F, a, rates)
    agreement = 0.0  # u . rolling
    for i in range(len(torques)):
        place = _WHEELS + _PER_WHEEL * i + _OWN_FRICTION
        agreement += torques[i] * rolling_torque(row, place, force)
    rolls = F.full + (F.partial if agreement > 0.0 else 0.0)
    pressing, dry = specific_force(row, _LOAD, a, wanted), 1.0
    for i in range(len(torques)):
        place = _WHEELS + _PER_WHEEL * i + _OWN_FRICTION
        if row[_LOAD] > 0.0:
            own = place - _OWN_FRICTION + _OWN_LOAD
            dry = dry_share(row, _LOAD, own, memory, _PAST, pressing, len(torques))
        friction, share, speed = wheel_friction(F, row, place, relative, torques[i], dry)
        added = share * (1.0 + memory[_SCALES + i]) * friction + rolls * rolling_torque(row, place, force)
        torques[i] += added
        memory[past(_PAST, 0, COMPENSATED, i)] = added
        if row[_ADAPTATION] > 0.0:
            told = abs(speed) * F.steepness > 1.0 and tells(row, _ADAPTATION, speed)
            balance = place - _OWN_FRICTION + _OWN_BALANCE
            memory[past(_PAST, 0, JUDGED, i)] = friction if told else 0.0
            memory[past(_PAST, 0, JUDGED_ROLLING, i)] = lost_to_force(row, balance, force) if told else 0.0


@inlined
def _look_back(row, memory, a, state, n):
    """Find the torque lost in the sample that has passed; adapt the friction's scales, step what is given back."""
    if memory[_BALANCE + 5] > 0.0:
        changes = accelerations(a, memory, _BALANCE, state, row[_RATE])
        lean = (a.cos_psi * state[2] + a.sin_psi * state[3], a.cos_psi * state[3] - a.sin_psi * state[2])
        adapts, moves = row[_ADAPTATION] > 0.0, False
        for i in range(n):
            if as_it_acted(row, _PREDICTION, memory, _PAST, BEYOND, i) > 0.0:
                continue  # a sample at the limit says nothing of what was lost
            needed = torque_needed(row, _WHEELS + _PER_WHEEL * i + _OWN_BALANCE, changes, lean)
            lost = as_it_acted(row, _PREDICTION, memory, _PAST, GIVEN, i) - needed
            left = lost - as_it_acted(row, _PREDICTION, memory, _PAST, COMPENSATED, i) - memory[_BACK + i]
            back = memory[_BACK + i] + row[_OBSERVER] * left
            memory[_BACK + i] = _limited(back, row[_OBSERVER + 1])
            friction = as_it_acted(row, _PREDICTION, memory, _PAST, JUDGED, i)
            if adapts and friction != 0.0:
                if not moves:
                    widen(row, _ADAPTATION, memory, _SCALES, ROLLING)
                    moves = True
                carried = as_it_acted(row, _PREDICTION, memory, _PAST, JUDGED_ROLLING, i)
                widen(row, _ADAPTATION, memory, _SCALES, i)
                judge(row, _ADAPTATION, memory, _SCALES, i, friction, carried, lost)
    remember_rates(memory, _BALANCE, state)


@inlined
def _give_back(row, memory, torques):
    """Add what was lost, pass the notch, limit; return whether a torque was beyond the limit."""
    limit = row[0]
    beyond = False
    for i in range(len(torques)):
        torques[i] += memory[_BACK + i]
        if row[_NOTCH] > 0.0:
            torques[i] = notched(row, _NOTCH, memory, _NOTCHES + NOTCH_MEMORY * i, torques[i])
        beyond = beyond or abs(torques[i]) > limit
        torques[i] = _limited(torques[i], limit)
        memory[past(_PAST, 0, GIVEN, i)] = torques[i]
        taken = memory[past(_PAST, 0, COMPENSATED, i)] + memory[_BACK + i]
        memory[past(_PAST, 0, EFFECTIVE, i)] = torques[i] - taken
    for i in range(len(torques)):
        memory[past(_PAST, 0, BEYOND, i)] = 1.0 if beyond else 0.0
    return beyond


@inlined
def _when_it_acts(row, memory, a, measured, n):
    """Return the state in which the torques will act, and make room for them among those of the past."""
    if row[_PREDICTION] == 0.0:
        return measured
    predict(row, _PREDICTION, _WHEELS + _OWN_PREDICTION, _PER_WHEEL, memory, _PAST, _AHEAD, a, measured, n)
    grow_older(memory, _PAST, remembered(row, _PREDICTION))
    return memory[_AHEAD : _AHEAD + 10]


@compiled
def control_law(row, memory, measured, reference, torques):
    """Fill `torques` (n,) and return `ALLOWED`, or the place in the reference at which A r is not 0.

    Parameters
    ----------
    row : ndarray
        From `pack_law`.
    memory : ndarray (`MEMORY`,)
        What the law remembers; changed. All zero at the start of a run.
    measured, reference : ndarray (10,)
    torques : ndarray (n,)
        [N m]
    """
    F = load_friction(row, _FRICTION)
    a = attitude((measured[2], measured[3], measured[4]))
    if row[_OBSERVER] + row[_ADAPTATION] > 0.0:
        _look_back(row, memory, a, measured, len(torques))
    state = _when_it_acts(row, memory, a, measured, len(torques))
    wanted = _wanted(row, memory, state, reference)
    e = _heading_error(load_flat(row, _FLAT), a, state, wanted)
    much = False  # more than the bound lets be asked for
    if row[_BOUND] > 0.0:
        much = asks_much(row, _BOUND, e)
        e = bounded(row, _BOUND, e)
    _drive(row, memory, a, wanted, e, torques)
    if F.full + F.partial > 0.0:
        _compensate(F, row, memory, a, state, wanted, e, torques)
    beyond = _give_back(row, memory, torques)
    if row[_INTEGRAL] > 0.0:
        e_x, e_y = a.cos_psi * e[0] - a.sin_psi * e[1], a.sin_psi * e[0] + a.cos_psi * e[1]
        integrate(row, _INTEGRAL, memory, _SUMS, e_x, e_y, e[4], beyond or much)
        if row[_FLOOR] > 0.0 and not (beyond or much):
            d_x, d_y = direction(row, _FLOOR, wanted[0].rate, wanted[1].rate)
            tell_apart(row, _FLOOR, memory, _DRAG, _SUMS, d_x, d_y)
    return _forbidden(reference)
