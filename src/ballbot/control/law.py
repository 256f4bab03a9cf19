"""The control law, compiled once for the single robot and for robots in lanes.

    u = K S(psi) (r_s - x) + feed-forward + integral action + compensation + what was lost,     clipped to its limit

r_s is the reference, or what `ballbot.control.reference_shaping` and `.feed_forward` make of it; `.lean_bound` may
bound r_s - x. The other parts are those of `.integral`, `.compensation` with `.adaptation`, and
`.disturbance_observer`; all of it may pass a `.notch`. S(psi) turns the pairs (x y), (theta phi) of the error and their
rates by -psi into the heading frame: K is designed at psi = 0 and the wheels turn with the body (design section 8). A
law is one row of numbers, so that every robot in a batch can have one of its own, and what it remembers is another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.control.adaptation import (
    ADAPTATION_MEMORY,
    ADAPTATION_SIZE,
    ROLLING,
    floor_change,
    judge,
    pack_adaptation,
    tells,
    widen,
)
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
from ballbot.control.feed_forward import (
    FLAT_PER_WHEEL,
    FLAT_SIZE,
    load_flat,
    motion_torque,
    pack_feed_forward,
    times,
)
from ballbot.control.integral import (
    INTEGRAL_MEMORY,
    INTEGRAL_PER_WHEEL,
    INTEGRAL_SIZE,
    integrate,
    pack_integral,
)
from ballbot.control.lean_bound import BOUND_SIZE, asks_much, bounded, pack_bound
from ballbot.control.notch import NOTCH_MEMORY, NOTCH_SIZE, notched, pack_notch
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
_WHEELS = _NOTCH + NOTCH_SIZE
# places in a wheel's part: gain (10), then each part's own
_OWN_FRICTION = 10
_OWN_FLAT = _OWN_FRICTION + FRICTION_PER_WHEEL
_OWN_INTEGRAL = _OWN_FLAT + FLAT_PER_WHEEL
_OWN_BALANCE = _OWN_INTEGRAL + INTEGRAL_PER_WHEEL
_PER_WHEEL = _OWN_BALANCE + BALANCE_PER_WHEEL
# places in the memory: shaping, integrals, torque balance (rates, then torque given and compensation of each wheel),
# torque given back, friction that adaptation judges, rolling part of it, and what adaptation remembers
_SUMS = SHAPING_MEMORY
_BALANCE = _SUMS + INTEGRAL_MEMORY
_GIVEN = _BALANCE + 6
_COMPENSATED = _GIVEN + MOST_WHEELS
_BACK = _BALANCE + BALANCE_MEMORY
_JUDGED = _BACK + MOST_WHEELS
_JUDGED_ROLLING = _JUDGED + MOST_WHEELS
_SCALES = _JUDGED_ROLLING + MOST_WHEELS
_ROLLING_SCALE = _SCALES + ROLLING

# what each wheel's notch remembers
_NOTCHES = _SCALES + ADAPTATION_MEMORY

#: how many numbers a law remembers from update to update; all zero at the start of a run
MEMORY = _NOTCHES + NOTCH_MEMORY * MOST_WHEELS

#: what `control_law` returns where the reference may be followed
ALLOWED = -1


def pack_law(controller: Controller) -> NDArray[np.float64]:
    """Return a controller's numbers as the row that compiled code reads."""
    n, parts = len(controller.gain), controller.parts
    friction, own_friction = pack_friction(controller)
    flat, own_flat = pack_feed_forward(parts.feed_forward, n)
    integral, own_integral = pack_integral(parts.integral, n, controller.sample_time)
    shaping = pack_shaping(parts.shaping, controller.sample_time)
    observer, adaptation = parts.observer, parts.adaptation
    judge = observer or adaptation
    own = [controller.gain, own_friction, own_flat, own_integral, pack_balance(judge and judge.balance, n)]
    shared = [controller.torque_limit, *friction, *shaping, *flat, *integral]
    shared += pack_observer(observer, controller.sample_time)
    shared += pack_adaptation(adaptation, controller.sample_time)
    shared += [1.0 / controller.sample_time, *pack_bound(controller)]
    shared += pack_notch(parts.notch, controller.sample_time)
    return np.concatenate([shared, np.column_stack(own).ravel()])


def scales(memory: NDArray[np.float64], wheel_count: int) -> NDArray[np.float64]:
    """Return by what adaptation multiplies each wheel's friction and the rolling friction (n + 1,)."""
    return 1.0 + memory[[*range(_SCALES, _SCALES + wheel_count), _ROLLING_SCALE]]


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
def _rolling_lean(F, flat, scale, a, wanted):
    """Return the lean (2,) into the rolling friction of the motion asked for, heading frame."""
    asked = (wanted[0].rate, wanted[1].rate)
    force_x, force_y = rolling_force(F, a, asked)
    per_force = flat.rolling_lean * scale
    return -per_force * force_y, per_force * force_x


@inlined
def _heading_error(flat, a, state, wanted, into):
    """Return S(psi) (r_s - x), r_s with the lean that the motion needs, and the lean `into` its rolling friction."""
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
        lean[0] + into[0] - leaned[0],
        lean[1] + into[1] - leaned[1],
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
    """Fill in feedback, feed-forward and integral action."""
    x, y, psi = wanted
    second, fourth = _turned(a, x.second, y.second), _turned(a, x.fourth, y.fourth)
    I_x, I_y = _turned(a, memory[_SUMS], memory[_SUMS + 1])
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
    """Add the friction's compensation to the law's torques, and keep what adaptation judges.

    Rolling friction beyond what was identified is carried by the speed asked for: that cannot feed the motion.
    """
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
    rolling, adapts = force, row[_ADAPTATION] > 0.0
    if adapts:
        change = floor_change(row, _ADAPTATION, memory, _SCALES)
        known, more = 1.0 + min(0.0, change), max(0.0, change)
        asked = rolling_force(F, a, (wanted[0].rate, wanted[1].rate))
        rolling = known * force[0] + more * asked[0], known * force[1] + more * asked[1]
    agreement = 0.0  # u . rolling
    for i in range(len(torques)):
        place = _WHEELS + _PER_WHEEL * i + _OWN_FRICTION
        agreement += torques[i] * rolling_torque(row, place, rolling)
    rolls = F.full + (F.partial if agreement > 0.0 else 0.0)
    for i in range(len(torques)):
        place = _WHEELS + _PER_WHEEL * i + _OWN_FRICTION
        carried = rolling_torque(row, place, rolling)
        friction, share, speed = wheel_friction(F, row, place, relative, torques[i])
        added = share * (1.0 + memory[_SCALES + i]) * friction + rolls * carried
        torques[i] += added
        memory[_COMPENSATED + i] = added
        if adapts:
            told = abs(speed) * F.steepness > 1.0 and tells(row, _ADAPTATION, speed)
            memory[_JUDGED + i] = friction if told else 0.0
            balance = place - _OWN_FRICTION + _OWN_BALANCE
            memory[_JUDGED_ROLLING + i] = lost_to_force(row, balance, force) if told else 0.0


@inlined
def _look_back(row, memory, a, state, n):
    """Find the torque lost in the sample that has passed; adapt the friction's scales, step what is given back."""
    if memory[_BALANCE + 5] > 0.0:
        changes = accelerations(a, memory, _BALANCE, state, row[_RATE])
        lean = (a.cos_psi * state[2] + a.sin_psi * state[3], a.cos_psi * state[3] - a.sin_psi * state[2])
        adapts, moves = row[_ADAPTATION] > 0.0, False
        for i in range(n):
            needed = torque_needed(row, _WHEELS + _PER_WHEEL * i + _OWN_BALANCE, changes, lean)
            lost = memory[_GIVEN + i] - needed
            left = lost - memory[_COMPENSATED + i] - memory[_BACK + i]
            back = memory[_BACK + i] + row[_OBSERVER] * left
            memory[_BACK + i] = _limited(back, row[_OBSERVER + 1])
            friction, carried = memory[_JUDGED + i], memory[_JUDGED_ROLLING + i]
            if adapts and friction != 0.0:
                if not moves:
                    widen(row, _ADAPTATION, memory, _SCALES, ROLLING)
                    moves = True
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
        memory[_GIVEN + i] = torques[i]
    return beyond


@compiled
def control_law(row, memory, state, reference, torques):
    """Fill `torques` (n,) and return `ALLOWED`, or the place in the reference at which A r is not 0.

    Parameters
    ----------
    row : ndarray
        From `pack_law`.
    memory : ndarray (`MEMORY`,)
        What the law remembers; changed. All zero at the start of a run.
    state, reference : ndarray (10,)
    torques : ndarray (n,)
        [N m]
    """
    F = load_friction(row, _FRICTION)
    a = attitude((state[2], state[3], state[4]))
    if row[_OBSERVER] + row[_ADAPTATION] > 0.0:
        _look_back(row, memory, a, state, len(torques))
    wanted = _wanted(row, memory, state, reference)
    flat, compensates = load_flat(row, _FLAT), F.full + F.partial
    into = (0.0, 0.0)
    if flat.rolling_lean != 0.0:
        change = floor_change(row, _ADAPTATION, memory, _SCALES)
        into = _rolling_lean(F, flat, compensates * (1.0 + change), a, wanted)
    e = _heading_error(flat, a, state, wanted, into)
    much = False  # more than the bound lets be asked for
    if row[_BOUND] > 0.0:
        much = asks_much(row, _BOUND, e)
        e = bounded(row, _BOUND, e)
    _drive(row, memory, a, wanted, e, torques)
    if compensates > 0.0:
        _compensate(F, row, memory, a, state, wanted, e, torques)
    beyond = _give_back(row, memory, torques)
    if beyond:  # a sample at the limit says nothing of what was lost
        memory[_BALANCE + 5] = 0.0
    if row[_INTEGRAL] > 0.0:
        e_x, e_y = a.cos_psi * e[0] - a.sin_psi * e[1], a.sin_psi * e[0] + a.cos_psi * e[1]
        integrate(row, _INTEGRAL, memory, _SUMS, e_x, e_y, e[4], beyond or much)
    return _forbidden(reference)
