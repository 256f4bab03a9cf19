"""One RK4 step of `smooth` for lanes of a block, part by part: attitudes, dry friction, forces, accelerations.

A processor looks a few hundred instructions ahead. Of a short loop these are several turns, which it works on together
while each waits for its own results; of a long one a single turn, and it stands still. So a part is a loop of its own
wherever what it hands on is little.
"""

from ballbot.mechanics.accelerations import accelerated, system_like
from ballbot.mechanics.compiled import called, inlined
from ballbot.mechanics.elementary import power_of_two, sine_cosine, sine_cosine_of_lean
from ballbot.mechanics.equations import attitude_of, rates_of_angles, wheel_speeds
from ballbot.mechanics.friction import decay_exponent, sign, with_decay
from ballbot.mechanics.lanes import (
    MARGIN,
    ROWS,
    SCRATCH,
    STATE,
    STEP,
    TORQUE,
    TRIAL,
    entry,
    put,
    restored,
    stored,
)
from ballbot.mechanics.parameters import load, load_wheel, state_like
from ballbot.mechanics.smooth import (
    assembled,
    ball_velocity,
    body_velocity,
    floor_friction,
    floor_margin,
    loaded,
    moving_margin,
    smallest_margin,
)
from ballbot.mechanics.vector import advanced, each

# Scratch rows: what a stage's loops hand on, the stage's state, and the weighted mean of the slopes
SINES = SCRATCH
SPEEDS = SINES + 6
_DRY = SPEEDS + 4
_SIGNS = _DRY + 4
_STAGE = _SIGNS + 4
_SLOPE = _STAGE + 11
_SYSTEM = _SLOPE + 11
assert _SYSTEM + 27 <= ROWS  # compiled code does not look whether a row is in the array
_SIX = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@called
def begin_steps(selected, work, width):
    """Leave each lane's attitude and wheel speeds, and a margin that says whether all its contacts move."""
    _attitudes(selected, work, width, STATE)
    for lane in range(width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        speeds = restored(selected.wheels, work, SPEEDS, lane)
        put(work, MARGIN, lane, moving_margin(P, ball_velocity(state), speeds, entry(work, STEP, lane)))


@inlined
def _attitudes(selected, work, width, states):
    """Leave the sines and wheel speeds of the states in the rows from `states` on."""
    for lane in range(width):
        stored(work, SINES, lane, sine_cosine_of_lean(entry(work, states + 2, lane)))
    for lane in range(width):
        stored(work, SINES + 2, lane, sine_cosine_of_lean(entry(work, states + 3, lane)))
    for lane in range(width):
        stored(work, SINES + 4, lane, sine_cosine(entry(work, states + 4, lane)))
    for lane in range(width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, states, lane)
        a = attitude_of(restored(_SIX, work, SINES, lane))
        stored(work, SPEEDS, lane, wheel_speeds(selected, P, a, ball_velocity(state), body_velocity(state)))


@inlined
def _begin(selected, work, width):
    for lane in range(width):
        state = restored(state_like(selected), work, STATE, lane)
        stored(work, _STAGE, lane, state)
        stored(work, _SLOPE, lane, state_like(selected))
        stored(work, _SIGNS, lane, each(sign, restored(selected.wheels, work, SPEEDS, lane)))


@inlined
def _dry_friction(selected, work, width):
    for wheel in range(len(selected.wheels)):
        for lane in range(width):
            one = load_wheel(work, wheel, lane)
            put(work, _DRY + wheel, lane, decay_exponent(one, entry(work, SPEEDS + wheel, lane)))
    for wheel in range(len(selected.wheels)):
        for lane in range(width):
            put(work, _DRY + wheel, lane, power_of_two(entry(work, _DRY + wheel, lane)))
    for wheel in range(len(selected.wheels)):
        for lane in range(width):
            one = load_wheel(work, wheel, lane)
            put(work, _DRY + wheel, lane, with_decay(one, entry(work, _DRY + wheel, lane)))


@inlined
def _forces(selected, work, width):
    """Leave the equations to solve."""
    for lane in range(width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, _STAGE, lane)
        u, speeds = (
            restored(selected.wheels, work, TORQUE, lane),
            restored(selected.wheels, work, SPEEDS, lane),
        )
        signs, dry = (
            restored(selected.wheels, work, _SIGNS, lane),
            restored(selected.wheels, work, _DRY, lane),
        )
        a = attitude_of(restored(_SIX, work, SINES, lane))
        v, w = ball_velocity(state), body_velocity(state)
        floor = floor_friction(P, v).force
        stored(work, _SYSTEM, lane, loaded(selected, P, a, v, w, u, speeds, signs, dry, floor))


@inlined
def _accelerations(selected, work, width, ahead, weight):
    """Add a stage's slope with its weight, and put the next stage's state `ahead` steps from the start."""
    for lane in range(width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, _STAGE, lane)
        a, v, w = attitude_of(restored(_SIX, work, SINES, lane)), ball_velocity(state), body_velocity(state)
        system = restored(system_like(selected), work, _SYSTEM, lane)
        v_dot, w_dot = accelerated(system, floor_friction(P, v).holding)
        slope = assembled(v, rates_of_angles(selected, a, w), v_dot, w_dot)

        start = restored(state_like(selected), work, STATE, lane)
        mean = restored(state_like(selected), work, _SLOPE, lane)
        signs, speeds = (
            restored(selected.wheels, work, _SIGNS, lane),
            restored(selected.wheels, work, SPEEDS, lane),
        )
        margin = min(smallest_margin(P, signs, speeds), floor_margin(P, start, state))
        put(work, MARGIN, lane, min(entry(work, MARGIN, lane), margin))
        stored(work, _SLOPE, lane, advanced(mean, slope, weight))
        stored(work, _STAGE, lane, advanced(start, slope, ahead * entry(work, STEP, lane)))


@called
def _stage(selected, work, width, ahead, weight):
    _dry_friction(selected, work, width)
    _forces(selected, work, width)
    _accelerations(selected, work, width, ahead, weight)


@called
def _next_stage(selected, work, width, ahead, weight):
    _attitudes(selected, work, width, _STAGE)
    _stage(selected, work, width, ahead, weight)


@inlined
def _end(selected, work, width):
    for lane in range(width):
        P = load(selected, work, lane)
        start = restored(state_like(selected), work, STATE, lane)
        end = advanced(start, restored(state_like(selected), work, _SLOPE, lane), entry(work, STEP, lane))
        stored(work, TRIAL, lane, end)
        put(work, MARGIN, lane, min(entry(work, MARGIN, lane), floor_margin(P, start, end)))


@called
def smooth_block(selected, work, width):
    """Try an RK4 step of the first lanes, after `begin_steps`; states go to the trial rows, margins to theirs."""
    _begin(selected, work, width)
    _stage(selected, work, width, 0.5, 1.0 / 6.0)
    _next_stage(selected, work, width, 0.5, 1.0 / 3.0)
    _next_stage(selected, work, width, 1.0, 1.0 / 3.0)
    _next_stage(selected, work, width, 0.0, 1.0 / 6.0)
    _end(selected, work, width)
