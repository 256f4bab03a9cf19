"""The control law, compiled once for the single robot and for robots in lanes.

    u = K S(psi) (r_s - x) + feed-forward + integral action + compensation + what was lost,     clipped to its limit

r_s is the reference, or what `ballbot.control.parts.reference_shaping` and `.feed_forward` make of it; x is the state,
or by `.prediction` the one in which u will act; `.lean_limit` may bound r_s - x. The others are those of `.integral`
with `.floor_adaptation`, `.compensation` with `.driveline_adaptation` and `.load_scaling`, and
`.disturbance_observer`; all of it may pass a `.notch`. S(psi) turns the pairs (x y), (theta phi) of the error and their
rates by -psi into the heading frame: K is designed at psi = 0 and the wheels turn with the body. A
law is one row of numbers, so that every robot in a batch can have one of its own, and what it remembers is another.
"""

from __future__ import annotations

from ballbot.control import law_row as at
from ballbot.control.interface import LARGEST_STATE
from ballbot.control.parts.compensation import (
    load_friction,
    relative_rate,
    rolling_force,
    rolling_torque,
    wheel_friction,
)
from ballbot.control.parts.driveline_adaptation import ROLLING, judge, tells, widen
from ballbot.control.parts.feed_forward import load_flat, motion_torque, times
from ballbot.control.parts.floor_adaptation import direction, tell_apart
from ballbot.control.parts.integral import integrate
from ballbot.control.parts.lean_limit import asks_much, bounded
from ballbot.control.parts.load_scaling import dry_share, specific_force
from ballbot.control.parts.notch import NOTCH_MEMORY, notched
from ballbot.control.parts.past import (
    BEYOND,
    COMPENSATED,
    EFFECTIVE,
    GIVEN,
    JUDGED,
    JUDGED_ROLLING,
    grow_older,
    past,
)
from ballbot.control.parts.prediction import as_it_acted, predict, remembered
from ballbot.control.parts.reference_shaping import Smooth, load_shaping, shaped
from ballbot.control.parts.torque_balance import accelerations, lost_to_force, remember_rates, torque_needed
from ballbot.mechanics.engine.compiled import called, compiled, inlined
from ballbot.mechanics.equations import attitude

#: what `control_law` returns where the reference may be followed
ALLOWED = -1


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
    if row[at.SHAPING] > 0.0:
        return shaped(load_shaping(row, at.SHAPING), memory, state, reference)
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
    d_x, d_y = direction(row, at.FLOOR, x.rate, y.rate)
    I_x, I_y = _turned(
        a, memory[at.SUMS] + memory[at.DRAG] * d_x, memory[at.SUMS + 1] + memory[at.DRAG] * d_y
    )
    I_psi = memory[at.SUMS + 2]
    for i in range(len(torques)):
        place = at.WHEELS + at.PER_WHEEL * i
        own = place + at.OWN_INTEGRAL
        torques[i] = (
            _feedback(row, place, e)
            + motion_torque(row, place + at.OWN_FLAT, second, fourth, psi.second)
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
        place = at.WHEELS + at.PER_WHEEL * i + at.OWN_FRICTION
        agreement += torques[i] * rolling_torque(row, place, force)
    rolls = F.full + (F.partial if agreement > 0.0 else 0.0)
    dry = 1.0  # what the load makes of a wheel's dry friction
    for i in range(len(torques)):
        wheel = at.WHEELS + at.PER_WHEEL * i
        place = wheel + at.OWN_FRICTION
        if row[at.LOAD] > 0.0:
            pressing = specific_force(row, at.LOAD, a, wanted)
            dry = dry_share(row, at.LOAD, wheel + at.OWN_LOAD, memory, at.PAST, pressing, len(torques))
        friction, share, speed = wheel_friction(F, row, place, relative, torques[i], dry)
        added = share * (1.0 + memory[at.SCALES + i]) * friction + rolls * rolling_torque(row, place, force)
        torques[i] += added
        memory[past(at.PAST, 0, COMPENSATED, i)] = added
        if row[at.ADAPTATION] > 0.0:
            told = abs(speed) * F.steepness > 1.0 and tells(row, at.ADAPTATION, speed)
            carried = lost_to_force(row, wheel + at.OWN_BALANCE, force)
            memory[past(at.PAST, 0, JUDGED, i)] = friction if told else 0.0
            memory[past(at.PAST, 0, JUDGED_ROLLING, i)] = carried if told else 0.0


@inlined
def _look_back(row, memory, a, state, n):
    """Find the torque lost in the sample that has passed; adapt the friction's scales, step what is given back."""
    if memory[at.BALANCE + 5] > 0.0:
        changes = accelerations(a, memory, at.BALANCE, state, row[at.RATE])
        lean = (a.cos_psi * state[2] + a.sin_psi * state[3], a.cos_psi * state[3] - a.sin_psi * state[2])
        adapts, moves = row[at.ADAPTATION] > 0.0, False
        for i in range(n):
            if as_it_acted(row, at.PREDICTION, memory, at.PAST, BEYOND, i) > 0.0:
                continue  # a sample at the limit says nothing of what was lost
            needed = torque_needed(row, at.WHEELS + at.PER_WHEEL * i + at.OWN_BALANCE, changes, lean)
            lost = as_it_acted(row, at.PREDICTION, memory, at.PAST, GIVEN, i) - needed
            left = (
                lost - as_it_acted(row, at.PREDICTION, memory, at.PAST, COMPENSATED, i) - memory[at.BACK + i]
            )
            back = memory[at.BACK + i] + row[at.OBSERVER] * left
            memory[at.BACK + i] = _limited(back, row[at.OBSERVER + 1])
            friction = as_it_acted(row, at.PREDICTION, memory, at.PAST, JUDGED, i)
            if adapts and friction != 0.0:
                if not moves:
                    widen(row, at.ADAPTATION, memory, at.SCALES, ROLLING)
                    moves = True
                carried = as_it_acted(row, at.PREDICTION, memory, at.PAST, JUDGED_ROLLING, i)
                widen(row, at.ADAPTATION, memory, at.SCALES, i)
                judge(row, at.ADAPTATION, memory, at.SCALES, i, friction, carried, lost)
    remember_rates(memory, at.BALANCE, state)


@inlined
def _give_back(row, memory, torques):
    """Add what was lost, pass the notch, limit; return whether a torque was beyond the limit."""
    limit = row[0]
    beyond = False
    for i in range(len(torques)):
        torques[i] += memory[at.BACK + i]
        if row[at.NOTCH] > 0.0:
            torques[i] = notched(row, at.NOTCH, memory, at.NOTCHES + NOTCH_MEMORY * i, torques[i])
        beyond = beyond or abs(torques[i]) > limit
        torques[i] = _limited(torques[i], limit)
        memory[past(at.PAST, 0, GIVEN, i)] = torques[i]
        effective = torques[i] - memory[past(at.PAST, 0, COMPENSATED, i)] - memory[at.BACK + i]
        memory[past(at.PAST, 0, EFFECTIVE, i)] = effective
    for i in range(len(torques)):
        memory[past(at.PAST, 0, BEYOND, i)] = 1.0 if beyond else 0.0
    return beyond


@inlined
def _when_it_acts(row, memory, a, measured, n):
    """Return the state in which the torques will act, and make room for them among those of the past."""
    if row[at.PREDICTION] == 0.0:
        return measured
    predict(
        row,
        at.PREDICTION,
        at.WHEELS + at.OWN_PREDICTION,
        at.PER_WHEEL,
        memory,
        at.PAST,
        at.AHEAD,
        a,
        measured,
        n,
    )
    grow_older(memory, at.PAST, remembered(row, at.PREDICTION))
    return memory[at.AHEAD : at.AHEAD + 10]


@inlined
def _is_state(measured):
    """Return whether every number of a measured state is one that a robot can have."""
    for i in range(10):  # noqa: SIM110 (compiled code has no generators)
        if not abs(measured[i]) <= LARGEST_STATE:  # a NaN is not
            return False
    return True


@called
def _decide(row, memory, measured, reference, torques):
    """Fill `torques` (n,) for a state and a reference that are valid; see `control_law`."""
    F = load_friction(row, at.FRICTION)
    a = attitude((measured[2], measured[3], measured[4]))
    if row[at.OBSERVER] + row[at.ADAPTATION] > 0.0:
        _look_back(row, memory, a, measured, len(torques))
    state = _when_it_acts(row, memory, a, measured, len(torques))
    if row[at.PREDICTION] > 0.0:
        a = attitude((state[2], state[3], state[4]))
    wanted = _wanted(row, memory, state, reference)
    e = _heading_error(load_flat(row, at.FLAT), a, state, wanted)
    much = False  # more than the bound lets be asked for
    if row[at.BOUND] > 0.0:
        much = asks_much(row, at.BOUND, e)
        e = bounded(row, at.BOUND, e)
    _drive(row, memory, a, wanted, e, torques)
    if F.full + F.partial > 0.0:
        _compensate(F, row, memory, a, state, wanted, e, torques)
    beyond = _give_back(row, memory, torques)
    if row[at.INTEGRAL] > 0.0:
        e_x, e_y = a.cos_psi * e[0] - a.sin_psi * e[1], a.sin_psi * e[0] + a.cos_psi * e[1]
        integrate(row, at.INTEGRAL, memory, at.SUMS, e_x, e_y, e[4], beyond or much)
        if row[at.FLOOR] > 0.0 and not (beyond or much):
            d_x, d_y = direction(row, at.FLOOR, wanted[0].rate, wanted[1].rate)
            tell_apart(row, at.FLOOR, memory, at.DRAG, at.SUMS, d_x, d_y)


@compiled
def control_law(row, memory, measured, reference, torques):
    """Fill `torques` (n,) and return `ALLOWED`, or the place in the reference at which A r is not 0.

    Without a valid state, or with a reference that is refused, the torques are zero and the memory stays as it is.

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
    refused = _forbidden(reference)
    if refused != ALLOWED or not _is_state(measured):
        for i in range(len(torques)):
            torques[i] = 0.0
        return refused
    _decide(row, memory, measured, reference, torques)
    return ALLOWED
