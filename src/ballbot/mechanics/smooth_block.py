"""One RK4 step of `smooth` for lanes of a block, each stage in three loops: attitudes, dry friction, accelerations."""

from ballbot.mechanics.compiled import called, inlined
from ballbot.mechanics.equations import attitude_of, sines
from ballbot.mechanics.friction import dry_friction, sign
from ballbot.mechanics.lanes import MARGIN, SCRATCH, STATE, STEP, TORQUE, TRIAL, entry, put, restored, stored
from ballbot.mechanics.parameters import load, load_wheel, state_like
from ballbot.mechanics.smooth import (
    ball_velocity,
    floor_margin,
    moving_margin,
    pose,
    rate_of_change,
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
_SIX = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@called
def begin_steps(selected, work, width):
    """Leave each lane's attitude and wheel speeds, and a margin that says whether all its contacts move."""
    for lane in range(width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        a, speeds = pose(selected, P, state)
        stored(work, SINES, lane, sines(a))
        stored(work, SPEEDS, lane, speeds)
        put(work, MARGIN, lane, moving_margin(P, ball_velocity(state), speeds, entry(work, STEP, lane)))


@inlined
def _begin(selected, work, width):
    for lane in range(width):
        state = restored(state_like(selected), work, STATE, lane)
        stored(work, _STAGE, lane, state)
        stored(work, _SLOPE, lane, state_like(selected))
        stored(work, _SIGNS, lane, each(sign, restored(selected.wheels, work, SPEEDS, lane)))


@inlined
def _attitudes(selected, work, width):
    for lane in range(width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, _STAGE, lane)
        a, speeds = pose(selected, P, state)
        stored(work, SINES, lane, sines(a))
        stored(work, SPEEDS, lane, speeds)


@inlined
def _dry_friction(selected, work, width):
    for wheel in range(len(selected.wheels)):
        for lane in range(width):
            one = load_wheel(work, wheel, lane)
            put(work, _DRY + wheel, lane, dry_friction(one, entry(work, SPEEDS + wheel, lane)))


@inlined
def _accelerations(selected, work, width, ahead, weight):
    """Add a stage's slope with its weight, and put the next stage's state `ahead` steps from the start."""
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
        slope = rate_of_change(selected, P, a, state, u, speeds, signs, dry)

        start = restored(state_like(selected), work, STATE, lane)
        mean = restored(state_like(selected), work, _SLOPE, lane)
        margin = min(smallest_margin(P, signs, speeds), floor_margin(P, start, state))
        put(work, MARGIN, lane, min(entry(work, MARGIN, lane), margin))
        stored(work, _SLOPE, lane, advanced(mean, slope, weight))
        stored(work, _STAGE, lane, advanced(start, slope, ahead * entry(work, STEP, lane)))


@called
def _stage(selected, work, width, ahead, weight):
    _dry_friction(selected, work, width)
    _accelerations(selected, work, width, ahead, weight)


@called
def _next_stage(selected, work, width, ahead, weight):
    _attitudes(selected, work, width)
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
