"""The planner: the motion of x and y is planned on line, within the limits of the motors, from where the plan is.

s is the flat output (`ballbot.control.parts.feed_forward`). Along each axis the motors give

    a = s'' - s''''/p^2        W = s - s''/p^2        W'' = a        s'' = (b + f)/2        s''' = p (b - f)/2
    f' = -p (f - a)            b' = p (b - a)         the ball's place  y = W + (1/p^2 - c) s''

with c the offset of s from the ball. f runs forward in time, b backward from zero at the horizon's end: where b is now
is one linear condition on a, which takes the place of a long horizon. a is linear between `KNOTS` knots, which stay
where they are in time; every few samples the plan is made again from where it has come to:

    least  h sum (s_k - r_k)^2 + q sum (a_k+1 - a_k)^2      r_k: the reference, extrapolated
    the largest wheel's torque, less friction and what lasting disturbances take, within its limit
    |a_k+1 - a_k| <= a reversal's rate        |y_k'| <= speed limit        (y_k - r) d <= 0

The last is a wall at the place where a motion in the direction d is to end, so that the ball does not overshoot it.
(What the last plan needs beyond the wall, it is given half of.) A reference that moves faster than the prompt speed may
stop at any time: it is planned to end where it is now. A slower one is followed without delay.

The solver is the alternating direction method of multipliers: a fixed number of steps from the last solution, a few a
sample, each a product with a constant matrix. What is stepped are t = z + u, with z what the limits allow and u the
scaled multipliers. A multiplier's force is bounded (exact penalties), so that limits that cannot be kept, as after a
push, are kept as far as possible, the torques before the wall. The torques' limit is a disc, as large
as the wheels allow in the direction of the last plan: at a corner of the wheels' hexagon a motion would go aside.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import frictionless_model
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.part import (
    FollowedMotion,
    LawSettings,
    Pair,
    Part,
    SmoothReference,
    heading_frame_after,
    turned,
    turned_back,
)
from ballbot.control.parts.turning import FAST, LAG, ROUNDING, start_turning, turn
from ballbot.mechanics.engine.compensated_sum import add_to
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole
from ballbot.robot.parameters import parameter, parameter_class

#: knots of the horizon, and plans from one to the next
KNOTS, PHASES = 24, 4
#: unknowns of an axis: the last knot is at rest
_FREE = KNOTS - 1
#: intervals of the record: of each phase, and these
_KNOT, _SAMPLE, _TIMES = PHASES, PHASES + 1, PHASES + 2
#: steps of the solver for a plan, shared out among its samples
_STEPS = 12
#: over-relaxation
_OVER = 1.625
# constants that single precision holds exactly, so that the firmware's are these
#: time for which the reference is taken to go on bending [s]
_BENDS = 1.0
#: way per speed in which the motion ends beyond the horizon [s]
_TAIL = 0.625
#: time that a motion takes to turn, by which the wall's direction looks ahead [s]
_TURNS = 0.75
#: part of the way beyond the wall that the next plan is given
_GIVEN = 0.5
#: fraction of the largest acceleration up to which a reference's bend counts
_BEND = 0.34375
#: lag of disturbances, time to come back from catching itself [s], and the least fraction of the torque meanwhile
_LASTING, _LEAST_LEFT = 1.0, 0.25
#: part of the torque that they may take: motions without any left would not end
_LARGEST_LOST = 0.4
#: acceleration up to which disturbances are looked at [m/s^2]
_QUIET = 0.125
#: wheel speed over which friction turns from one sign to the other [rad/s]
_CREEPING = 0.5
#: plan at rest: way [m], speed [m/s], acceleration [m/s^2]
_STILL, _STILL_SPEED, _STILL_FORCE = 2e-6, 1e-5, 1e-4
#: distance over which the wall has a direction [m]
_NEAR = 0.01
#: time in which a reference that was fast counts as slow again [s], and the ratio by which it first does not: until
#: then r' of one that has stopped is gone
_HEDGED, _HELD = 1.0, 1.25
#: the rows' weights and largest forces: torque, change, speed, wall
_TORQUE, _CHANGE, _SPEED, _WALL = 0, 1, 2, 3


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannerRecord:
    """The sampled planner."""

    on: int = field(default=1, metadata=whole())
    #: samples from plan to plan
    every: int = field(metadata=whole())
    #: steps of the solver in a sample
    steps: int = field(metadata=whole())
    rate: float = field(metadata=number("1/s"))
    #: p, 1/p^2, 1/p^2 - c
    falling: float = field(metadata=number("1/s"))
    square: float = field(metadata=number("s^2"))
    ball: float = field(metadata=number("s^2"))
    #: intervals: the first one of each phase, from knot to knot, from sample to sample; exp(-p h), and the weights of a
    #: at their start and end
    interval: NDArray[np.float64] = field(metadata=number("s", _TIMES))
    kept: NDArray[np.float64] = field(metadata=number("1", _TIMES))
    early: NDArray[np.float64] = field(metadata=number("1", _TIMES))
    late: NDArray[np.float64] = field(metadata=number("1", _TIMES))
    #: a for pulls, and for what b needs; the pulls of W, W', f, a_0, and of r, r', r''
    inverse: NDArray[np.float64] = field(metadata=number("1", PHASES, _FREE, _FREE))
    by_lead: NDArray[np.float64] = field(metadata=number("1", PHASES, _FREE))
    by_start: NDArray[np.float64] = field(metadata=number("1", PHASES, _FREE, 4))
    by_reference: NDArray[np.float64] = field(metadata=number("1", PHASES, _FREE, 3))
    #: torques of the wheels in a tight frame for a, its largest row, and by it their limit and friction (the wheels'
    #: mean: one with less would have the robot go aside)
    frame: NDArray[np.float64] = field(metadata=number("1", MAX_WHEELS, 2))
    rolling: NDArray[np.float64] = field(metadata=number("rad/m", MAX_WHEELS, 2))
    most: float = field(metadata=number("m/s^2"))
    viscous: float = field(metadata=number("m/(s rad)"))
    dry: float = field(metadata=number("m/s^2"))
    worst: float = field(metadata=number("1"))
    torque: float = field(metadata=number("1/(kg m)"))
    #: of the rows: weights, and largest multipliers
    weight: NDArray[np.float64] = field(metadata=number("1", 4))
    bound: NDArray[np.float64] = field(metadata=number("1", 4))
    change: float = field(metadata=number("m/s^2"))
    speed: float = field(metadata=number("m/s"))
    prompt: float = field(metadata=number("m/s"))
    far: float = field(metadata=number("m"))
    delay: float = field(metadata=number("s"))
    #: fraction of the difference by which the lags of r' and r'', and of disturbances, change in a sample
    late_reference: float = field(metadata=number("1"))
    late_lost: float = field(metadata=number("1"))
    largest_lost: float = field(metadata=number("m/s^2"))
    #: of the heading (`turning`): w, exp(-w h) and 1 less that, which single precision would round; limits
    yaw_frequency: float = field(metadata=number("rad/s"))
    yaw_decay: float = field(metadata=number("1"))
    yaw_gone: float = field(metadata=number("1"))
    yaw_rate: float = field(metadata=number("rad/s"))
    yaw_acceleration: float = field(metadata=number("rad/s^2"))
    yaw_prompt: float = field(metadata=number("rad/s"))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannerState:
    """The plan, its rows and what the solver works with; places are relative to s."""

    started: int = field(metadata=whole())
    #: samples since the last knot
    since: int = field(metadata=whole())
    #: s, W', f, b and a now
    place: NDArray[np.float64] = field(metadata=number("m", 2))
    place_rest: NDArray[np.float64] = field(metadata=number("m", 2))
    motion: NDArray[np.float64] = field(metadata=number("m/s", 2))
    lag: NDArray[np.float64] = field(metadata=number("m/s^2", 2))
    lead: NDArray[np.float64] = field(metadata=number("m/s^2", 2))
    now: NDArray[np.float64] = field(metadata=number("m/s^2", 2))
    #: a at the knots to come
    a: NDArray[np.float64] = field(metadata=number("m/s^2", 2, KNOTS))
    #: t and z of the rows: torque, change, speed, wall
    t: NDArray[np.float64] = field(metadata=number("1", 4, KNOTS, 2))
    z: NDArray[np.float64] = field(metadata=number("1", 4, KNOTS, 2))
    #: the last r, r' and r''
    last: NDArray[np.float64] = field(metadata=number("m", 2))
    reference: NDArray[np.float64] = field(metadata=number("m/s", 2))
    bend: NDArray[np.float64] = field(metadata=number("m/s^2", 2))
    #: what lasting disturbances take of a, and 1 while the robot catches itself
    lost: NDArray[np.float64] = field(metadata=number("m/s^2", 2))
    catching: float = field(metadata=number("1"))
    #: whether a plan is being made, from where: W, W', f, a and what b needs; the way since; the wall: its direction,
    #: place and speed
    solving: int = field(metadata=whole())
    begun: NDArray[np.float64] = field(metadata=number("m", 2, 4))
    needs: NDArray[np.float64] = field(metadata=number("m/s^2", 2))
    moved: NDArray[np.float64] = field(metadata=number("m", 2))
    wall: NDArray[np.float64] = field(metadata=number("m", 4))
    #: how far the reference is taken as one that may stop, from 0 to 1 and a rest
    hedge: float = field(metadata=number("1"))
    #: work: velocities and places of the plan and without it, pulls, b at the knots, friction, frame in the world
    v: NDArray[np.float64] = field(metadata=number("m/s", KNOTS, 2))
    y: NDArray[np.float64] = field(metadata=number("m", KNOTS, 2))
    free_v: NDArray[np.float64] = field(metadata=number("m/s", KNOTS, 2))
    free_y: NDArray[np.float64] = field(metadata=number("m", KNOTS, 2))
    none: NDArray[np.float64] = field(metadata=number("m/s^2", KNOTS))
    start: NDArray[np.float64] = field(metadata=number("1", 2, _FREE))
    pull: NDArray[np.float64] = field(metadata=number("1", KNOTS))
    ahead: NDArray[np.float64] = field(metadata=number("m/s^2", KNOTS))
    force_v: NDArray[np.float64] = field(metadata=number("1", KNOTS))
    force_y: NDArray[np.float64] = field(metadata=number("1", KNOTS))
    drag: NDArray[np.float64] = field(metadata=number("m/s^2", KNOTS, 2))
    radius: NDArray[np.float64] = field(metadata=number("m/s^2", KNOTS))
    #: of the heading: four lags, p, v, the last r, r' and r''
    lags: NDArray[np.float64] = field(metadata=number("rad", 4))
    lags_rest: NDArray[np.float64] = field(metadata=number("rad", 4))
    turned: NDArray[np.float64] = field(metadata=number("rad", 1))
    turned_rest: NDArray[np.float64] = field(metadata=number("rad", 1))
    turning: float = field(metadata=number("rad/s"))
    last_psi: float = field(metadata=number("rad"))
    turn_change: float = field(metadata=number("rad/s"))
    turn_bend: float = field(metadata=number("rad/s^2"))


class _Turn(NamedTuple):
    """How the heading goes on."""

    rate: float  # [rad/s]
    left: float  # [rad]


@inlined
def plan_motion(law, memory, pose, ahead, wanted):
    """Return the motion to a pose, relative to the measured one, and advance the memory."""
    own, state = law.planner, memory.planner
    if state.started == 0:
        _rest(state, pose.x + ahead.state.x, pose.y + ahead.state.y)
        state.last[0], state.last[1] = wanted.x, wanted.y
        start_turning(state, pose.psi + ahead.state.psi, wanted.psi)
    _notice(own, state, wanted)
    _lose(law, memory, ahead.a)
    away = Pair(
        wanted.x - state.place[0] - state.place_rest[0], wanted.y - state.place[1] - state.place_rest[1]
    )
    phase = state.since // own.every
    if phase * own.every == state.since:
        state.solving = 0 if _is_still(state, away) else 1
        if state.solving == 0:
            _rest(state, wanted.x, wanted.y)
        else:
            _begin(own, state, phase, ahead.a, _Turn(state.turning, wanted.psi - state.lags[3]), away)
    if state.solving == 1:
        _solve(own, state, phase)
    x, y = _motion(own, state, 0, pose.x), _motion(own, state, 1, pose.y)
    _advance(own, state)
    return FollowedMotion(x, y, turn(own, state, pose.psi, wanted.psi))


@inlined
def restart_planner(memory, wanted):
    """Let the planner go on from a pose at rest: a plan, which is followed without it, ends there."""
    own = memory.planner
    _rest(own, wanted.x, wanted.y)
    for j in range(2):
        own.reference[j], own.bend[j] = 0.0, 0.0
    own.hedge = 0.0
    own.last[0], own.last[1] = wanted.x, wanted.y
    start_turning(own, wanted.psi, wanted.psi)


@inlined
def plan_gently(memory):
    """Leave motions the least torque: the robot needs its torque to catch itself."""
    memory.planner.catching = 1.0


@inlined
def _rest(state, x, y):
    """Let the plan be at rest at a place."""
    state.place[0], state.place[1] = x, y
    for j in range(2):
        state.place_rest[j], state.moved[j] = 0.0, 0.0
        state.motion[j], state.lag[j], state.lead[j], state.now[j] = 0.0, 0.0, 0.0, 0.0
        for k in range(KNOTS):
            state.a[j, k] = 0.0
            for row in range(4):
                state.t[row, k, j], state.z[row, k, j] = 0.0, 0.0
    state.started, state.since, state.solving = 1, 0, 0


@inlined
def _is_still(state, away):
    """Return whether plan and reference are at rest at one place."""
    still = abs(away.x) < _STILL and abs(away.y) < _STILL
    for j in range(2):
        still = still and abs(state.motion[j]) < _STILL_SPEED and abs(state.lag[j]) < _STILL_FORCE
        still = still and abs(state.lead[j]) < _STILL_FORCE and abs(state.now[j]) < _STILL_FORCE
        still = still and abs(state.reference[j]) < _STILL_SPEED
    return still


@inlined
def _notice(own, state, wanted):
    """Filter r' and r''; a jump has no velocity, and r'' counts up to a part of the limit."""
    d_x, d_y = wanted.x - state.last[0], wanted.y - state.last[1]
    moved = own.rate * (d_x * d_x + d_y * d_y) ** 0.5
    rate = own.rate if moved <= (1.0 + ROUNDING) * own.speed else 0.0
    n = Pair(rate * d_x - state.reference[0], rate * d_y - state.reference[1])
    bent = own.late_reference * own.rate * (n.x * n.x + n.y * n.y) ** 0.5
    counts = max(0.0, min(1.0, 2.0 - 2.0 * bent / (_BEND * own.most)))
    scale = counts * own.late_reference * own.rate
    state.bend[0] += own.late_reference * (scale * n.x - state.bend[0])
    state.bend[1] += own.late_reference * (scale * n.y - state.bend[1])
    state.reference[0] += own.late_reference * n.x
    state.reference[1] += own.late_reference * n.y
    state.last[0], state.last[1] = wanted.x, wanted.y


@inlined
def _lose(law, memory, a):
    """Follow what lasting disturbances take of a, as a slope does, and how the robot catches itself.

    They take what the motors gave besides the motion's torques and the compensation of friction. While a motion speeds
    up or brakes that is what its model lacks, which does not last.
    """
    own, state, past = law.planner, memory.planner, memory.history
    lost_x, lost_y = 0.0, 0.0
    for i in range(MAX_WHEELS):
        torque = past.acting[0, i] - past.friction_compensation[0, i]
        lost_x += own.torque * own.frame[i, 0] * torque
        lost_y += own.torque * own.frame[i, 1] * torque
    given = turned_back(a, lost_x, lost_y)
    second = Pair(0.5 * (state.lead[0] + state.lag[0]), 0.5 * (state.lead[1] + state.lag[1]))
    share = own.late_lost if second.x * second.x + second.y * second.y < _QUIET * _QUIET else 0.0
    x = state.lost[0] + share * (given.x - state.now[0] - state.lost[0])
    y = state.lost[1] + share * (given.y - state.now[1] - state.lost[1])
    size = (x * x + y * y) ** 0.5
    counts = own.largest_lost / size if size > own.largest_lost else 1.0
    state.lost[0], state.lost[1] = counts * x, counts * y
    state.catching -= own.late_lost * state.catching


@inlined
def _begin(own, state, phase, a, turn, away):
    """Begin a new plan, from the last one."""
    for j in range(2):
        for k in range(KNOTS):
            state.t[_WALL, k, j] -= state.moved[j]
            state.z[_WALL, k, j] -= state.moved[j]
        state.moved[j] = 0.0
        state.begun[j, 0] = -0.5 * own.square * (state.lead[j] + state.lag[j])
        state.begun[j, 1], state.begun[j, 2], state.begun[j, 3] = state.motion[j], state.lag[j], state.now[j]
        state.needs[j] = state.lead[j] - own.late[phase] * state.now[j]
        _see(own, state, phase, j, state.a[j], state.v, state.y)
        _see(own, state, phase, j, state.none, state.free_v, state.free_y)
    _resist(own, state, phase, a, turn)
    _aim(own, state, phase, away)


@inlined
def _solve(own, state, phase):
    """Take a sample's share of the steps; the plan's first samples are followed meanwhile."""
    for count in range(own.steps):  # noqa: B007 (C has no loop without a name)
        for j in range(2):
            _pull(own, state, phase, j)
            _step(own, state, phase, j)
            _see(own, state, phase, j, state.a[j], state.v, state.y)
        _limit(own, state, phase)


@inlined
def _see(own, state, phase, j, a, v, y):
    """Fill the velocities and the ball's places at the knots for an axis's a."""
    lead, p = state.ahead, own.falling
    lead[KNOTS - 1] = 0.0
    for k in range(KNOTS - 2, -1, -1):
        lead[k] = own.kept[_KNOT] * lead[k + 1] + own.late[_KNOT] * a[k] + own.early[_KNOT] * a[k + 1]
    W, w, lag, before = state.begun[j, 0], state.begun[j, 1], state.begun[j, 2], state.begun[j, 3]
    for k in range(KNOTS):
        at = phase if k == 0 else _KNOT
        h = own.interval[at]
        W += h * (w + h * (2.0 * before + a[k]) / 6.0)
        w += 0.5 * h * (before + a[k])
        lag = own.kept[at] * lag + own.early[at] * before + own.late[at] * a[k]
        before = a[k]
        v[k, j] = w + 0.5 * own.ball * p * (lead[k] - lag)
        y[k, j] = W + 0.5 * own.ball * (lead[k] + lag)
    y[KNOTS - 1, j] += _TAIL * v[KNOTS - 1, j]


@inlined
def _resist(own, state, phase, a, turn):
    """Fill how large a may be at the knots, in the last plan's direction there, and what friction takes of it."""
    for k in range(_FREE):
        later = own.interval[phase] + own.interval[_KNOT] * k
        at = heading_frame_after(a, max(-abs(turn.left), min(abs(turn.left), turn.rate * later)))
        v, force = turned(at, state.v[k, 0], state.v[k, 1]), turned(at, state.a[0, k], state.a[1, k])
        size, largest, drag_x, drag_y = (force.x * force.x + force.y * force.y) ** 0.5, 0.0, 0.0, 0.0
        for i in range(MAX_WHEELS):
            speed = own.rolling[i, 0] * v.x + own.rolling[i, 1] * v.y
            dry = own.dry * speed / (speed * speed + _CREEPING * _CREEPING) ** 0.5
            drag_x += own.frame[i, 0] * (own.viscous * speed + dry)
            drag_y += own.frame[i, 1] * (own.viscous * speed + dry)
            share = abs(own.frame[i, 0] * force.x + own.frame[i, 1] * force.y)
            largest = max(largest, share / size if size > _STILL_FORCE else own.worst)
        drag = turned_back(at, drag_x, drag_y)
        state.drag[k, 0], state.drag[k, 1] = drag.x + state.lost[0], drag.y + state.lost[1]
        state.radius[k] = own.most * max(_LEAST_LEFT, 1.0 - state.catching) / largest


@inlined
def _aim(own, state, phase, away):
    """Fill the pulls of the start and of the reference, and the wall."""
    now = Pair(state.reference[0] + LAG * state.bend[0], state.reference[1] + LAG * state.bend[1])
    speed = (now.x * now.x + now.y * now.y) ** 0.5
    v = Pair(_speed_of(own, state, 0), _speed_of(own, state, 1))
    fast = max(0.0, min(1.0, (speed / own.prompt - 1.0) / (FAST - 1.0)))
    state.hedge = max(_HELD * fast, state.hedge - own.every / (_HEDGED * own.rate))
    prompt = max(0.0, 1.0 - state.hedge)
    ahead = prompt * own.delay
    r = Pair(away.x + ahead * now.x, away.y + ahead * now.y)
    distance = (r.x * r.x + r.y * r.y) ** 0.5
    near = min(1.0, own.far / max(distance, own.far))
    for j in range(2):
        near_place = near * (r.x if j == 0 else r.y)
        rate, bend = prompt * (now.x if j == 0 else now.y), prompt * state.bend[j]
        begun = state.begun[j]
        for k in range(_FREE):
            by, of = own.by_start[phase, k], own.by_reference[phase, k]
            start = by[0] * begun[0] + by[1] * begun[1] + by[2] * begun[2] + by[3] * begun[3]
            state.start[j, k] = start - of[0] * near_place - of[1] * rate - of[2] * bend
    to = Pair(r.x + _TURNS * (v.x - prompt * now.x), r.y + _TURNS * (v.y - prompt * now.y))
    size = (to.x * to.x + to.y * to.y) ** 0.5
    if size < _NEAR:
        state.wall[0], state.wall[1], state.wall[2], state.wall[3] = 0.0, 0.0, 0.0, 0.0
        return
    d = Pair(to.x / size, to.y / size)
    place, going, beyond = r.x * d.x + r.y * d.y, prompt * (now.x * d.x + now.y * d.y), 0.0
    for k in range(KNOTS):
        over = state.y[k, 0] * d.x + state.y[k, 1] * d.y - place - _until(own, phase, k) * going
        beyond = max(beyond, over)
    state.wall[0], state.wall[1] = d.x, d.y
    state.wall[2], state.wall[3] = place + _GIVEN * beyond, going


@inlined
def _speed_of(own, state, j):
    """Return s'."""
    return state.motion[j] + 0.5 * (state.lead[j] - state.lag[j]) / own.falling


@inlined
def _wanted(state, row, k, j):
    """Return what a row asks for."""
    return 2.0 * state.z[row, k, j] - state.t[row, k, j]


@inlined
def _pull(own, state, phase, j):
    """Fill what the rows and the costs pull at an axis's a."""
    p, weight, pull = own.falling, own.weight, state.pull
    for k in range(KNOTS):
        state.force_v[k] = weight[_SPEED] * (_wanted(state, _SPEED, k, j) - state.free_v[k, j])
        state.force_y[k] = weight[_WALL] * (_wanted(state, _WALL, k, j) - state.free_y[k, j])
    state.force_v[KNOTS - 1] += _TAIL * state.force_y[KNOTS - 1]
    h, W, w, lag = own.interval[_KNOT], 0.0, 0.0, 0.0
    for k in range(KNOTS - 1, -1, -1):
        at = phase if k == 0 else _KNOT
        first = own.interval[at]
        held = h * (0.5 * w + h * W / 3.0) + own.early[_KNOT] * lag
        w += state.force_v[k] + h * W
        W += state.force_y[k]
        lag = own.kept[_KNOT] * lag + 0.5 * own.ball * (state.force_y[k] - p * state.force_v[k])
        pull[k] = held + first * (0.5 * w + first * W / 6.0) + own.late[at] * lag
    lead = 0.0
    for k in range(_FREE):
        before = lead
        lead = own.kept[_KNOT] * lead + 0.5 * own.ball * (state.force_y[k] + p * state.force_v[k])
        pull[k] += own.late[_KNOT] * lead + own.early[_KNOT] * before - state.start[j, k]
        start = state.begun[j, 3] if k == 0 else 0.0
        changes = start + _wanted(state, _CHANGE, k, j) - _wanted(state, _CHANGE, k + 1, j)
        torques = _wanted(state, _TORQUE, k, j) - state.drag[k, j]
        pull[k] += weight[_CHANGE] * changes + weight[_TORQUE] * torques


@inlined
def _step(own, state, phase, j):
    """Solve for an axis's a."""
    needs = state.needs[j]
    for k in range(_FREE):
        row, a = own.inverse[phase, k], own.by_lead[phase, k] * needs
        for m in range(_FREE):
            a += row[m] * state.pull[m]
        state.a[j, k] = a


@inlined
def _limit(own, state, phase):
    """Step the rows, and find what the limits allow of them."""
    wall, before = state.wall, Pair(state.begun[0, 3], state.begun[1, 3])
    for k in range(KNOTS):
        a = Pair(state.a[0, k], state.a[1, k])
        if k < _FREE:
            torque = Pair(a.x + state.drag[k, 0], a.y + state.drag[k, 1])
            _limit_length(own, state, _TORQUE, k, torque, state.radius[k])
        change = own.change * own.interval[phase] / own.interval[_KNOT] if k == 0 else own.change
        _limit_length(own, state, _CHANGE, k, Pair(a.x - before.x, a.y - before.y), change)
        _limit_length(own, state, _SPEED, k, Pair(state.v[k, 0], state.v[k, 1]), own.speed)
        t = _stepped(state, _WALL, k, Pair(state.y[k, 0], state.y[k, 1]))
        over = max(0.0, t.x * wall[0] + t.y * wall[1] - wall[2] - _until(own, phase, k) * wall[3])
        over = min(over, own.bound[_WALL])
        state.z[_WALL, k, 0], state.z[_WALL, k, 1] = t.x - over * wall[0], t.y - over * wall[1]
        before = a


@inlined
def _until(own, phase, k):
    """Return the time until a knot's wall, which for the last one is where the motion ends."""
    return own.interval[phase] + own.interval[_KNOT] * k + (_TAIL if k == _FREE else 0.0)


@inlined
def _stepped(state, row, k, given):
    """Step a row of vectors, and return it."""
    t, z = state.t[row, k], state.z[row, k]
    t[0] += _OVER * (given.x - z[0])
    t[1] += _OVER * (given.y - z[1])
    return Pair(t[0], t[1])


@inlined
def _limit_length(own, state, row, k, given, most):
    """Step a row of vectors whose length is limited."""
    t = _stepped(state, row, k, given)
    size = (t.x * t.x + t.y * t.y) ** 0.5
    share = min(size - most, own.bound[row]) / size if size > most else 0.0
    state.z[row, k, 0], state.z[row, k, 1] = t.x - share * t.x, t.y - share * t.y


@inlined
def _motion(own, state, j, pose):
    """Return an axis's motion now, relative to the pose."""
    p, second = own.falling, 0.5 * (state.lead[j] + state.lag[j])
    third = 0.5 * p * (state.lead[j] - state.lag[j])
    return SmoothReference(
        (state.place[j] - pose) + state.place_rest[j],
        _speed_of(own, state, j),
        second,
        third,
        p * p * (second - state.now[j]),
    )


@inlined
def _advance(own, state):
    """Let a sample pass; after a knot, the next one is the first."""
    dt, left = 1.0 / own.rate, PHASES * own.every - state.since
    for j in range(2):
        before = state.now[j]
        after = before + (state.a[j, 0] - before) / left
        second = 0.5 * (state.lead[j] + state.lag[j])
        moved = dt * (state.motion[j] + dt * (2.0 * before + after) / 6.0)
        state.motion[j] += 0.5 * dt * (before + after)
        kept, early, late = own.kept[_SAMPLE], own.early[_SAMPLE], own.late[_SAMPLE]
        state.lag[j] = kept * state.lag[j] + early * before + late * after
        state.lead[j] = (state.lead[j] - late * before - early * after) / kept
        state.now[j] = after
        moved += own.square * (0.5 * (state.lead[j] + state.lag[j]) - second)
        add_to(state.place, state.place_rest, j, moved)
        state.moved[j] += moved
    state.since += 1
    if left == 1:
        _pass_knot(state)


@inlined
def _pass_knot(state):
    """Begin the interval after the next knot."""
    state.since = 0
    for j in range(2):
        for k in range(_FREE):
            state.a[j, k] = state.a[j, k + 1]
            for row in range(4):
                state.t[row, k, j], state.z[row, k, j] = state.t[row, k + 1, j], state.z[row, k + 1, j]
        state.t[_CHANGE, _FREE, j], state.z[_CHANGE, _FREE, j] = 0.0, 0.0


#: weights of the changes of a, and of the rows; found by a search on the preset alten, free of the robot's size
_SMOOTHNESS, _WEIGHTS, _FORCES = 1e-5, (0.004, 0.0015, 0.015, 0.1), (0.7, 0.7, 0.7, 0.035)
#: torque of motions and friction over the limit: the rest is for the feedback, and for robots heavier than known
MOTION_TORQUE = 0.7
#: time from plan to plan [s]; of a reversal of all torque [s]; way over the speed limit that is looked at [s]
_EVERY, _REVERSAL, _FAR = 0.02, 0.1, 1.0


class _Times(NamedTuple):
    """Intervals from knot to knot and what they do to f: f_k+1 = kept f_k + early a_k + late a_k+1."""

    interval: NDArray[np.float64]
    kept: NDArray[np.float64]
    early: NDArray[np.float64]
    late: NDArray[np.float64]


def _times(p: float, interval: NDArray[np.float64]) -> _Times:
    kept = np.exp(-p * interval)
    late = 1.0 - (1.0 - kept) / (p * interval)
    return _Times(interval, kept, 1.0 - kept - late, late)


def _responses(p: float, offset: float, times: _Times) -> tuple[NDArray[np.float64], ...]:
    """Return b at the start (1, c), and velocities, the ball's places and s (KNOTS, c) for W, W', f, a_0 and each a."""
    columns = 3 + KNOTS
    W, w, lag, lead, a = (np.zeros((KNOTS + 1, columns)) for _ in range(5))
    W[0, 0] = w[0, 1] = lag[0, 2] = 1.0
    a[np.arange(KNOTS), np.arange(3, columns)] = 1.0
    for k, (h, kept, early, late) in enumerate(zip(*times, strict=True)):
        lag[k + 1] = kept * lag[k] + early * a[k] + late * a[k + 1]
        w[k + 1] = w[k] + 0.5 * h * (a[k] + a[k + 1])
        W[k + 1] = W[k] + h * (w[k] + h * (2.0 * a[k] + a[k + 1]) / 6.0)
    for k in range(KNOTS - 1, -1, -1):
        lead[k] = times.kept[k] * lead[k + 1] + times.late[k] * a[k] + times.early[k] * a[k + 1]
    second, third = 0.5 * (lead + lag), 0.5 * p * (lead - lag)
    v, s = w + (1.0 / p**2 - offset) * third, W + second / p**2
    y = s - offset * second
    y[KNOTS] += _TAIL * v[KNOTS]
    return lead[:1], v[1:], y[1:], s[1:]


def _matrices(p: float, offset: float, first: float, interval: float) -> tuple[NDArray[np.float64], ...]:
    """Return a phase's `inverse`, `by_lead`, `by_start` and `by_reference`."""
    intervals = np.full(KNOTS, interval)
    intervals[0] = first
    lead, v, y, s = _responses(p, offset, _times(p, intervals))
    changes = np.zeros((KNOTS, 3 + KNOTS))
    changes[:, 3:] = np.eye(KNOTS, KNOTS, 1) - np.eye(KNOTS)
    rows = np.hstack([np.zeros((_FREE, 4)), np.eye(_FREE)]), changes, v, y
    cost = interval * s[:, 4:].T @ s + _SMOOTHNESS * changes[:, 4:].T @ changes
    split = sum(weight * row[:, 4:].T @ row[:, 4:] for weight, row in zip(_WEIGHTS, rows, strict=True))
    inverse = np.linalg.inv(cost[:, 4:] + split)
    by = inverse @ lead[0, 4:]
    by_lead = by / (lead[0, 4:] @ by)
    t = np.cumsum(intervals)
    bends = np.minimum(t, _BENDS)
    targets = np.column_stack([np.ones(KNOTS), t, bends * t - 0.5 * bends**2 + offset * (t < _BENDS)])
    return inverse - np.outer(by, by_lead), by_lead, cost[:, :4], interval * s[:, 4:].T @ targets


#: range of the settings
_LEAST, _MOST = 1e-12, 1e12


@parameter_class
class Planner(Part):
    """Make whatever the reference does a motion that torques and speed allow, with four derivatives.

    Plans x and y [m] on line, and turns psi [rad] by lags of limited rate and acceleration. The motion ends, or goes
    on, as the reference does, as soon as the limits allow, and the ball overshoots no place at which the reference
    stops. `FeedForward` gives the lean and the torques that it needs.

    InputError if a value is outside its range, or the robot cannot have feed-forward.
    """

    label = "planner"
    comment = (
        "Motions are planned on line within torque and speed. A reference up to the prompt speed is followed without\n"
        "# delay, a faster one as far behind as a stop needs."
    )
    record = PlannerRecord
    state = PlannerState

    torque_limit: float = parameter("of a wheel, for motions and friction", "N m", least=_LEAST, most=_MOST)
    speed_limit: float = parameter("over the floor", "m/s", default=2.0, least=_LEAST, most=_MOST)
    speed_cap: float = parameter("for people's safety", "m/s", default=_MOST, least=_LEAST, most=_MOST)
    prompt_speed: float = parameter(
        "up to which the reference is followed without delay", "m/s", default=0.3, least=_LEAST, most=_MOST
    )
    yaw_frequency: float = parameter(
        "w of each of the four lags of psi", "rad/s", default=12.0, least=_LEAST, most=_MOST
    )
    yaw_rate_limit: float = parameter("of psi", "rad/s", default=2.0, least=_LEAST, most=_MOST)
    yaw_acceleration_limit: float = parameter("of psi", "rad/s^2", default=3.0, least=_LEAST, most=_MOST)
    yaw_prompt_rate: float = parameter(
        "up to which the reference's heading is followed without delay",
        "rad/s",
        default=0.6,
        least=_LEAST,
        most=_MOST,
    )

    def numbers(self, settings: LawSettings) -> PlannerRecord:
        """Return the sampled planner."""
        needed, robot, dt = FeedForward().numbers(settings), settings.robot, settings.sample_time
        offset = float(needed.offset[0, 0])  # along y hardly another
        p = math.sqrt(np.linalg.norm(needed.by_second) / np.linalg.norm(needed.by_fourth))
        size = float(np.linalg.norm(needed.by_second)) / math.sqrt(2.0)
        every = max(1, round(_EVERY / dt))
        interval = PHASES * every * dt
        intervals = np.array([*(interval - k * every * dt for k in range(PHASES)), interval, dt])
        tables = [_matrices(p, offset, first, interval) for first in intervals[:PHASES]]
        inverse, by_lead, by_start, by_reference = (np.array(one) for one in zip(*tables, strict=True))
        worst = float(np.linalg.norm(needed.by_second, axis=1).max())
        largest, speed = MOTION_TORQUE * self.torque_limit / worst, min(self.speed_limit, self.speed_cap)
        return PlannerRecord(
            every=every,
            steps=math.ceil(_STEPS / every),
            rate=1.0 / dt,
            falling=p,
            square=1.0 / p**2,
            ball=1.0 / p**2 - offset,
            **_times(p, intervals)._asdict(),
            inverse=inverse,
            by_lead=by_lead,
            by_start=by_start,
            by_reference=by_reference,
            frame=needed.by_second / size,
            rolling=frictionless_model(robot).wheel_jacobian(np.zeros(5))[:, :2],
            most=MOTION_TORQUE * self.torque_limit / size,
            viscous=float(np.mean(robot.friction.viscous)) / size,
            dry=float(np.mean(robot.friction.coulomb)) / size,
            torque=1.0 / size,
            worst=worst / size,
            weight=np.array(_WEIGHTS),
            bound=largest * np.array(_FORCES) / np.array(_WEIGHTS),
            change=2.0 * largest * interval / _REVERSAL,
            speed=speed,
            prompt=self.prompt_speed,
            far=_FAR * speed,
            delay=settings.delay,
            late_reference=-math.expm1(-dt / LAG),
            late_lost=dt / (_LASTING + dt),
            largest_lost=_LARGEST_LOST * MOTION_TORQUE * self.torque_limit / size,
            yaw_frequency=self.yaw_frequency,
            yaw_decay=math.exp(-self.yaw_frequency * dt),
            yaw_gone=-math.expm1(-self.yaw_frequency * dt),
            yaw_rate=self.yaw_rate_limit,
            yaw_acceleration=self.yaw_acceleration_limit,
            yaw_prompt=self.yaw_prompt_rate,
        )
