"""The motion between two changes of sign: friction is a smooth force there, and RK4 has order four.

A trial step is taken with the signs of its start. It counts only if no wheel nor the rolling ball was at rest at its
start, and no speed whose friction matters has crossed zero at any stage; otherwise `ballbot.mechanics.engine.convex`
takes the step. (A sign that changes between the last stage and the end, which differ by h^5, is found by the next
step.) A ball that does not spin stays so while pivoting friction can hold it, and that is smooth as well.

`smooth_block` takes the step for the lanes of a block, part by part: attitudes, dry friction, forces, accelerations. A
processor looks a few hundred instructions ahead. In a short loop these are several iterations, which overlap
while each waits for its own results; in a long one they are a single iteration, and the processor stalls. So a part is
a loop of its own wherever it passes on few numbers.
"""

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.elementary import power_of_two, sine_cosine, sine_cosine_of_lean
from ballbot.mechanics.engine.lanes import (
    MARGIN,
    ROWS,
    SCRATCH,
    STATE,
    STEP,
    TORQUE,
    TRIAL,
    entry,
    load,
    put,
    restored,
    state_like,
    stored,
)
from ballbot.mechanics.engine.tracing import both, greatest, lanes, least, traced, where
from ballbot.mechanics.engine.vector import add, advanced, each, smallest
from ballbot.mechanics.equations import (
    LARGEST_LEAN,
    accelerated,
    attitude_of,
    balancing_attitude,
    ball_torque,
    forces_in,
    rates_of_angles,
    system_like,
    terms,
    wheel_force,
    wheel_speeds,
    with_forces,
)
from ballbot.mechanics.floor import floor_friction, floor_margin, rolling_margin
from ballbot.mechanics.friction import breakaway, decay_exponent, directed_friction, sign, with_decay

_MOMENT = 0.01  # of a step: a wheel that friction stops in so short a time is at rest

# A state here is the tuple (x, y, theta, phi, psi, v_x, v_y, w_1, w_2, w_3), and the ball's spin where it pivots.


@traced
def ball_velocity(state):
    """Return v of a state: (v_x, v_y), and the spin where the ball pivots."""
    return state[5:7] + state[10:]


@traced
def body_velocity(state):
    """Return w of a state."""
    return (state[7], state[8], state[9])


def is_upright(state):
    """Return whether a state leans by no more than the largest lean."""
    return both(abs(state[2]) <= LARGEST_LEAN, abs(state[3]) <= LARGEST_LEAN)


@traced
def in_state_order(position, angles, v, w):
    """Return a state from its parts, or its rate of change from theirs."""
    return position + angles + v[:2] + w + v[2:]


def speed_margin(wheel, sign_at_start, speed):
    """Return a number that stays positive while a wheel's speed keeps its sign, or has no dry friction."""
    return greatest(sign_at_start * speed, where(breakaway(wheel) == 0.0, 1.0, -1.0))


def smallest_margin(P, signs, speeds):
    """Return a number that is positive while every wheel's speed has its sign of the start."""
    return smallest(each(speed_margin, P.wheels, signs, speeds))


def rest_speeds(P, h):
    """Return the speed of each wheel below which it is at rest [rad/s]: its step is taken by the convex method.

    A wheel that sticks does not stay at a speed of zero to the last digit, since the robot turns within the step.
    """
    per_torque = _MOMENT * h / P.d1
    return tuple(per_torque * breakaway(wheel) for wheel in P.wheels)


def moving_margin(P, v, speeds, h):
    """Return a number that is positive if no contact with dry friction is at rest: its sign is then known."""
    faster = (
        where(rest > 0.0, abs(speed) - rest, 1.0)
        for speed, rest in zip(speeds, rest_speeds(P, h), strict=True)
    )
    return least(rolling_margin(P, v), smallest(tuple(faster)))


@traced
def net_torques(P, u, speeds, signs, dry):
    """Return u - tau(w) of each wheel, for the dry friction's sizes and signs."""
    return tuple(
        torque - wheel.b * speed - sign_at_start * size
        for wheel, torque, speed, sign_at_start, size in zip(P.wheels, u, speeds, signs, dry, strict=True)
    )


def loaded(selected, P, a, v, w, torques, floor_force):
    """Return the `Terms` or `SpinTerms` with all forces in them: the wheels' net torques and the floor's force."""
    system = terms(selected, P, a, v, w)
    F, L = wheel_force(selected, P, a, ball_torque(P, torques))
    f_v, f_w = forces_in(system)
    return with_forces(system, add(add(f_v, F), floor_force), add(f_w, L))


@traced
def acceleration(selected, P, a, v, w, torques, floor):
    """Return (v_dot, w_dot) under the wheels' net torques and the floor's friction."""
    return accelerated(loaded(selected, P, a, v, w, torques, floor.force), floor.holding)


@traced
def pose(selected, P, state):
    """Return the attitude and the wheel speeds of a state."""
    a = balancing_attitude((state[2], state[3], state[4]))
    return a, wheel_speeds(selected, P, a, ball_velocity(state), body_velocity(state))


# Scratch rows: results of a stage's loops, the stage's state, and the weighted mean of the slopes
SINES = SCRATCH
SPEEDS = SINES + 6
_DRY = SPEEDS + 4
_SIGNS = _DRY + 4
_STAGE = _SIGNS + 4
_SLOPE = _STAGE + 11
_SYSTEM = _SLOPE + 11
assert _SYSTEM + 27 <= ROWS  # compiled code does not look whether a row is in the array
_SIX = (0.0,) * 6


@traced
def begin_steps(selected, work, width):
    """Leave each lane's attitude and wheel speeds, and a margin that says whether all its contacts move."""
    _attitudes(selected, work, width, STATE)
    for lane in lanes(0, width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        speeds = restored(selected.wheels, work, SPEEDS, lane)
        put(work, MARGIN, lane, moving_margin(P, ball_velocity(state), speeds, entry(work, STEP, lane)))


@traced
def _attitudes(selected, work, width, states):
    """Leave the sines and wheel speeds of the states in the rows from `states` on."""
    for row, function in ((2, sine_cosine_of_lean), (3, sine_cosine_of_lean), (4, sine_cosine)):
        for lane in lanes(0, width):
            stored(work, SINES + 2 * (row - 2), lane, function(entry(work, states + row, lane)))
    for lane in lanes(0, width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, states, lane)
        a = attitude_of(restored(_SIX, work, SINES, lane))
        stored(work, SPEEDS, lane, wheel_speeds(selected, P, a, ball_velocity(state), body_velocity(state)))


@traced
def _begin(selected, work, width):
    for lane in lanes(0, width):
        state = restored(state_like(selected), work, STATE, lane)
        stored(work, _STAGE, lane, state)
        stored(work, _SLOPE, lane, state_like(selected))
        stored(work, _SIGNS, lane, each(sign, restored(selected.wheels, work, SPEEDS, lane)))


def _dry_friction(selected, work, width):
    if selected.own_wheel:
        for wheel in range(len(selected.wheels)):
            for lane in lanes(0, width):
                driveline = load(selected, work, lane).wheels[wheel]
                speed, direction = entry(work, SPEEDS + wheel, lane), entry(work, _SIGNS + wheel, lane)
                put(work, _DRY + wheel, lane, directed_friction(driveline, speed, direction))
        return
    for wheel in range(len(selected.wheels)):
        for lane in lanes(0, width):
            driveline = load(selected, work, lane).wheels[wheel]
            put(work, _DRY + wheel, lane, decay_exponent(driveline, entry(work, SPEEDS + wheel, lane)))
    for wheel in range(len(selected.wheels)):
        for lane in lanes(0, width):
            put(work, _DRY + wheel, lane, power_of_two(entry(work, _DRY + wheel, lane)))
    for wheel in range(len(selected.wheels)):
        for lane in lanes(0, width):
            driveline = load(selected, work, lane).wheels[wheel]
            power, direction = entry(work, _DRY + wheel, lane), entry(work, _SIGNS + wheel, lane)
            put(work, _DRY + wheel, lane, with_decay(driveline, power, direction))


def _forces(selected, work, width):
    """Leave the equations to solve."""
    for lane in lanes(0, width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, _STAGE, lane)
        u, speeds, signs, dry = (
            restored(selected.wheels, work, row, lane) for row in (TORQUE, SPEEDS, _SIGNS, _DRY)
        )
        a = attitude_of(restored(_SIX, work, SINES, lane))
        v, w = ball_velocity(state), body_velocity(state)
        torques = net_torques(P, u, speeds, signs, dry)
        stored(work, _SYSTEM, lane, loaded(selected, P, a, v, w, torques, floor_friction(P, v).force))


def _accelerations(selected, work, width, ahead, weight):
    """Add a stage's slope with its weight, and put the next stage's state `ahead` steps from the start."""
    for lane in lanes(0, width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, _STAGE, lane)
        a, v, w = attitude_of(restored(_SIX, work, SINES, lane)), ball_velocity(state), body_velocity(state)
        system = restored(system_like(selected), work, _SYSTEM, lane)
        v_dot, w_dot = accelerated(system, floor_friction(P, v).holding)
        slope = in_state_order((v[0], v[1]), rates_of_angles(selected, a, w), v_dot, w_dot)

        start, mean = (restored(state_like(selected), work, row, lane) for row in (STATE, _SLOPE))
        signs, speeds = (restored(selected.wheels, work, row, lane) for row in (_SIGNS, SPEEDS))
        margin = least(smallest_margin(P, signs, speeds), floor_margin(P, start, state))
        put(work, MARGIN, lane, least(entry(work, MARGIN, lane), margin))
        stored(work, _SLOPE, lane, advanced(mean, slope, weight))
        stored(work, _STAGE, lane, advanced(start, slope, ahead * entry(work, STEP, lane)))


@traced
def _stage(selected, work, width, ahead, weight):
    _dry_friction(selected, work, width)
    _forces(selected, work, width)
    _accelerations(selected, work, width, ahead, weight)


@traced
def _end(selected, work, width):
    for lane in lanes(0, width):
        P = load(selected, work, lane)
        start, slope = (restored(state_like(selected), work, row, lane) for row in (STATE, _SLOPE))
        end = advanced(start, slope, entry(work, STEP, lane))
        stored(work, TRIAL, lane, end)
        put(work, MARGIN, lane, least(entry(work, MARGIN, lane), floor_margin(P, start, end)))


@inlined
def smooth_block(selected, work, width):
    """Try an RK4 step of the first lanes, after `begin_steps`; states go to the trial rows, margins to theirs."""
    _begin(selected, work, width)
    for stage in range(4):
        if stage > 0:
            _attitudes(selected, work, width, _STAGE)
        ahead = 1.0 if stage == 2 else 0.5
        _stage(selected, work, width, ahead, 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0)
    _end(selected, work, width)
