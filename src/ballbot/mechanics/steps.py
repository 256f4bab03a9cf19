"""Steps of a block of robots: RK4 for those whose contacts all move, the convex step for the others.

The lanes are kept sorted, moving robots first, so that neither method is spent on the other's robots. But for
rounding, a robot's step depends on nothing but the robot.
"""

import numpy as np

from ballbot.mechanics.accelerations import solve
from ballbot.mechanics.compiled import by_types_of, called, inlined, shared
from ballbot.mechanics.convex_block import convex_block
from ballbot.mechanics.equations import (
    LARGEST_LEAN,
    attitude,
    balancing_attitude,
    rates_from_angles,
    rates_of_angles,
)
from ballbot.mechanics.free_motion import finished, free_motion
from ballbot.mechanics.lanes import (
    GROUP,
    MARGIN,
    MOST_PARAMETERS,
    ROBOT,
    STATE,
    STEP,
    TORQUE,
    TRIAL,
    entry,
    put,
    restored,
    stored,
    swap,
)
from ballbot.mechanics.parameters import load, state_like
from ballbot.mechanics.rows import box_rows, in_order, mass_matrix
from ballbot.mechanics.smooth_block import SINES, SPEEDS, begin_steps, smooth_block
from ballbot.mechanics.stick_slip import minimiser
from ballbot.mechanics.vector import each, each_with


@inlined
def load_state(selected, work, lane):
    """Return a lane's state: ten numbers, and the spin where the ball pivots."""
    return restored(state_like(selected), work, STATE, lane)


@inlined
def load_torques(selected, work, lane):
    """Return the wheel torques of one lane."""
    return restored(selected.wheels, work, TORQUE, lane)


@called
def robust_lane(selected, work, lane):
    """Take the convex step of one lane by `stick_slip.minimiser`, which always finds the minimiser."""
    P = load(selected, work, lane)
    state, u = load_state(selected, work, lane), load_torques(selected, work, lane)
    h = entry(work, STEP, lane)
    a = balancing_attitude((state[2], state[3], state[4]))
    free = free_motion(selected, P, a, state, u)
    v_dot, w_dot = solve(free.system, free.f_v, free.f_w)
    start = in_order(free.v, free.w)
    C, limits = box_rows(selected, P, a), np.array(free.limits)
    end = minimiser(
        mass_matrix(free.system), start + h * in_order(v_dot, w_dot), C, limits, P.rolling, h, start
    )
    stored(
        work, TRIAL, lane, finished(selected, state, a, velocity_in(free.v, end), (end[2], end[3], end[4]), h)
    )


def velocity_in(like, nu) -> tuple:  # pragma: no cover (compiled form below)
    """Return v out of velocities in the order of `rows`."""
    raise NotImplementedError("compiled code only")


@by_types_of(velocity_in)
def _velocity_in(like, nu):
    if len(like) == 2:
        return lambda like, nu: (nu[0], nu[1])
    return lambda like, nu: (nu[0], nu[1], nu[5])


@shared
def take_steps(selected, work, width, steps):
    """Advance every lane of a block by `steps` steps with torques held."""
    for _ in range(steps):
        begin_steps(selected, work, width)
        resting = _count_open(work, 0, width)
        if resting > 0:
            _sort(work, width)
        if resting < width:
            smooth_block(selected, work, _whole_groups(width - resting, width))
        _take_open_steps(selected, work, width)
        _accept(selected, work, width)


@inlined
def _count_open(work, first, last):
    count = 0.0
    for lane in range(first, last):
        count += _open(work, lane)
    return int(count)


@inlined
def _open(work, lane):
    """Return 1 where a lane's step still has to be taken, in a form that vector code has."""
    counts = 1.0 if entry(work, MARGIN, lane) > 0.0 else 0.0
    moves = 0.0 if entry(work, STEP, lane) == 0.0 else 1.0
    return moves - moves * counts


@inlined
def _is_open(work, lane):
    return _open(work, lane) > 0.0


@called
def _sort(work, width):
    """Bring the open lanes to the end."""
    last = width
    for lane in range(width):
        if lane < last and _is_open(work, lane):
            last -= 1
            while lane < last and _is_open(work, last):
                last -= 1
            if lane < last:
                _swap_lanes(work, lane, last)


@inlined
def _swap_lanes(work, first, second):
    for row in range(MOST_PARAMETERS):
        swap(work, row, first, second)
    for row in range(STATE, STATE + 11):
        swap(work, row, first, second)
    for row in range(TORQUE, ROBOT + 1):
        swap(work, row, first, second)
    for row in range(SINES, SPEEDS + 4):
        swap(work, row, first, second)


@inlined
def _whole_groups(lanes, width):
    return min((lanes + GROUP - 1) // GROUP * GROUP, width)


@inlined
def _take_open_steps(selected, work, width):
    """Take the convex step of open lanes, group by group; what does not settle there, by the robust method."""
    for first in range(0, width, GROUP):
        last = min(first + GROUP, width)
        if _count_open(work, first, last) > 0:
            convex_block(selected, work, first, last)
            for lane in range(first, last):
                if _is_open(work, lane):
                    robust_lane(selected, work, lane)


@inlined
def _accept(selected, work, width):
    """Make the trials the states; past the largest lean a lane takes steps of zero: it stays where it is."""
    for lane in range(width):
        h = entry(work, STEP, lane)
        both = each(
            _pair, load_state(selected, work, lane), restored(state_like(selected), work, TRIAL, lane)
        )
        end = each_with(_later, both, h)
        stored(work, STATE, lane, end)
        upright = abs(end[2]) <= LARGEST_LEAN and abs(end[3]) <= LARGEST_LEAN
        put(work, STEP, lane, h if upright else 0.0)


@inlined
def _pair(a, b):
    return (a, b)


@inlined
def _later(states, h):
    return states[0] if h == 0.0 else states[1]


@inlined
def start_lane(selected, work, lane, x, h):
    """Give a lane the robot of its number: state x (10,), (11,) where the ball pivots, with Euler rates, and step h."""
    put(work, STEP, lane, h)
    put(work, ROBOT, lane, float(lane))
    for i in range(len(x)):
        put(work, STATE + i, lane, x[i])
    w = rates_from_angles(selected, attitude((x[2], x[3], x[4])), (x[7], x[8], x[9]))
    for axis in range(3):
        put(work, STATE + 7 + axis, lane, w[axis])


@inlined
def write_state(selected, work, lane, out):
    """Write a lane's state, with Euler-angle rates, to `out`."""
    for i in range(len(out)):
        out[i] = entry(work, STATE + i, lane)
    rates = rates_of_angles(selected, attitude((out[2], out[3], out[4])), (out[7], out[8], out[9]))
    for axis in range(3):
        out[7 + axis] = rates[axis]
