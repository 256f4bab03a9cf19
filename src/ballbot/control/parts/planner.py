"""The planner: the motion of x and y is planned on line, within the limits of the motors, from where the plan is.

s is the flat output (`ballbot.control.parts.feed_forward`). Along each axis the motors give

    a = s'' - s''''/p^2        W = s - s''/p^2        W'' = a        s'' = (b + f)/2        s''' = p (b - f)/2
    f' = -p (f - a)            b' = p (b - a)         the ball's place  y = W + (1/p^2 - c) s''

with c the offset of s from the ball. f runs forward in time, b backward from zero at the horizon's end: where b is now
is one linear condition on a, which takes the place of a long horizon. a is linear between `KNOTS` knots, which stay
where they are in time; every few samples the plan is made again from where it has come to:

    least  h sum (s_k - r_k)^2 + q sum (a_k+1 - a_k)^2      r_k: the reference, extrapolated
    the largest wheel's torque, less friction and what lasting disturbances take, within its limit
    |a_k+1 - a_k| <= a reversal's rate        |W' + s'''/p^2| <= speed limit        (y_k - r) d <= 0

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
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

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
from ballbot.control.parts.reference_shaping import shape_heading
from ballbot.mechanics.engine.compensated_sum import add_to
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole
from ballbot.robot.parameters import parameter, parameter_class

#: knots of the horizon, and plans from one to the next
KNOTS, PHASES = 24, 4
#: unknowns of an axis: the last knot is at rest
_FREE = KNOTS - 1
#: steps of the solver for a plan, shared out among its samples
_STEPS = 12
#: over-relaxation
_OVER = 1.625
# constants that single precision holds exactly, so that the firmware's are these
#: lag of r' and r'' [s]
_LAG = 0.046875
#: time for which the reference is taken to go on bending [s]
_BENDS = 1.0
#: way per speed in which the motion ends beyond the horizon [s]
_TAIL = 0.625
#: time that a motion takes to turn, by which the wall's direction looks ahead [s]
_TURNS = 0.75
#: rounding by which a motion at the limit of speed may exceed it
_ROUNDING = 1e-3
#: part of the way beyond the wall that the next plan is given
_GIVEN = 0.5
#: ratio of the speeds at which a reference is followed as one that may stop, and as one that goes on
_FAST = 1.5
#: fraction of the largest acceleration up to which a reference's bend counts
_BEND = 0.34375
#: lag of disturbances, time to come back from catching itself [s], and the least fraction of the torque meanwhile
_LASTING, _LEAST_LEFT = 1.0, 0.25
#: wheel speed over which friction turns from one sign to the other [rad/s]
_CREEPING = 0.5
#: plan at rest: way [m], speed [m/s], acceleration [m/s^2]
_STILL, _STILL_SPEED, _STILL_FORCE = 2e-6, 1e-5, 1e-4
#: distance over which the wall has a direction [m]
_NEAR = 0.01
#: time in which a reference that was fast counts as slow again [s], and the ratio by which it first does not: until
#: then r' of one that has stopped is gone
_HEDGED, _HELD = 1.0, 1.25
#: rate [rad/s] and angle [rad] from which the heading turns
_TURNING = 0.01
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
    wheels: int = field(metadata=whole())
    rate: float = field(metadata=number("1/s"))
    #: p, 1/p^2, 1/p^2 - c
    falling: float = field(metadata=number("1/s"))
    square: float = field(metadata=number("s^2"))
    ball: float = field(metadata=number("s^2"))
    #: from knot to knot, the first interval of each phase first: h, exp(-p h), and weights of a at its start and end
    interval: NDArray[np.float64] = field(metadata=number("s", PHASES + 1))
    kept: NDArray[np.float64] = field(metadata=number("1", PHASES + 1))
    early: NDArray[np.float64] = field(metadata=number("1", PHASES + 1))
    late: NDArray[np.float64] = field(metadata=number("1", PHASES + 1))
    #: the same from sample to sample
    sample: NDArray[np.float64] = field(metadata=number("1", 3))
    #: a for pulls, and for what b needs; the pulls of W, W', f, a_0, and of r, r', r''
    inverse: NDArray[np.float64] = field(metadata=number("1", PHASES, _FREE, _FREE))
    by_lead: NDArray[np.float64] = field(metadata=number("1", PHASES, _FREE))
    by_start: NDArray[np.float64] = field(metadata=number("1", PHASES, _FREE, 4))
    by_reference: NDArray[np.float64] = field(metadata=number("1", PHASES, _FREE, 3))
    #: torques of the wheels in a tight frame for a, and with it their limit, friction (the wheels' mean: one with
    #: less would have the robot go aside), what turning needs, and its largest
    #: row
    frame: NDArray[np.float64] = field(metadata=number("1", MAX_WHEELS, 2))
    rolling: NDArray[np.float64] = field(metadata=number("rad/m", MAX_WHEELS, 2))
    most: float = field(metadata=number("m/s^2"))
    viscous: float = field(metadata=number("m/(s rad)"))
    dry: float = field(metadata=number("m/s^2"))
    turning: float = field(metadata=number("m/s^2"))
    worst: float = field(metadata=number("1"))
    torque: float = field(metadata=number("1/(kg m)"))
    weight: NDArray[np.float64] = field(metadata=number("1", 4))
    force: NDArray[np.float64] = field(metadata=number("1", 4))
    change: float = field(metadata=number("m/s^2"))
    speed: float = field(metadata=number("m/s"))
    prompt: float = field(metadata=number("m/s"))
    far: float = field(metadata=number("m"))
    delay: float = field(metadata=number("s"))
    late_reference: float = field(metadata=number("1"))


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
    #: t and z of the rows
    torque: NDArray[np.float64] = field(metadata=number("m/s^2", KNOTS, 2))
    torque_z: NDArray[np.float64] = field(metadata=number("m/s^2", KNOTS, 2))
    change: NDArray[np.float64] = field(metadata=number("m/s^2", KNOTS, 2))
    change_z: NDArray[np.float64] = field(metadata=number("m/s^2", KNOTS, 2))
    speed: NDArray[np.float64] = field(metadata=number("m/s", KNOTS, 2))
    speed_z: NDArray[np.float64] = field(metadata=number("m/s", KNOTS, 2))
    way: NDArray[np.float64] = field(metadata=number("m", KNOTS, 2))
    way_z: NDArray[np.float64] = field(metadata=number("m", KNOTS, 2))
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
    #: torque that is left for motions, of the tight frame
    most: float = field(metadata=number("m/s^2"))
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
            heading = memory.shaping
            turn = _Turn(heading.velocity[2], wanted.psi - heading.lags[2, 3])
            moving = abs(turn.rate) > _TURNING or abs(turn.left) > _TURNING
            most = own.most * max(_LEAST_LEFT, 1.0 - state.catching)
            state.most = most - (own.turning * law.shaping.yaw_acceleration if moving else 0.0)
            _begin(own, state, phase, ahead.a, turn, away)
    if state.solving == 1:
        _solve(own, state, phase)
    x, y = _motion(own, state, 0, pose.x), _motion(own, state, 1, pose.y)
    _advance(own, state)
    return FollowedMotion(x, y, shape_heading(law, memory, pose, ahead, wanted))


@inlined
def restart_planner(memory, wanted):
    """Let the planner go on from a pose at rest: a plan, which is followed without it, ends there."""
    own = memory.planner
    _rest(own, wanted.x, wanted.y)
    for j in range(2):
        own.reference[j], own.bend[j] = 0.0, 0.0
    own.hedge = 0.0
    own.last[0], own.last[1] = wanted.x, wanted.y


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
            state.torque[k, j], state.torque_z[k, j] = 0.0, 0.0
            state.change[k, j], state.change_z[k, j] = 0.0, 0.0
            state.speed[k, j], state.speed_z[k, j] = 0.0, 0.0
            state.way[k, j], state.way_z[k, j] = 0.0, 0.0
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
    rate = own.rate if moved <= (1.0 + _ROUNDING) * own.speed else 0.0
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
    """Follow what lasting disturbances take of a, as a slope does, and how the robot catches itself."""
    own, state, sums = law.planner, memory.planner, memory.integral.sums
    share, lost_x, lost_y = 1.0 / (_LASTING * own.rate + 1.0), 0.0, 0.0
    I = turned(a, sums[0], sums[1])  # noqa: E741 (as in `ballbot.control.parts.integral`)
    for i in range(own.wheels):
        gain, more = law.integral.gain[i], memory.tuning.integral[i]
        by_place = (gain[0] + more[0]) * I.x + (gain[1] + more[1]) * I.y
        lost = memory.disturbance_observer.estimate[i] + by_place
        lost_x += own.torque * own.frame[i, 0] * lost
        lost_y += own.torque * own.frame[i, 1] * lost
    world = turned_back(a, lost_x, lost_y)
    state.lost[0] += share * (world.x - state.lost[0])
    state.lost[1] += share * (world.y - state.lost[1])
    state.catching -= share * state.catching


@inlined
def _begin(own, state, phase, a, turn, away):
    """Begin a new plan, from the last one."""
    for j in range(2):
        for k in range(KNOTS):
            state.way[k, j] -= state.moved[j]
            state.way_z[k, j] -= state.moved[j]
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
        lead[k] = own.kept[PHASES] * lead[k + 1] + own.late[PHASES] * a[k] + own.early[PHASES] * a[k + 1]
    W, w, lag, before = state.begun[j, 0], state.begun[j, 1], state.begun[j, 2], state.begun[j, 3]
    for k in range(KNOTS):
        at = phase if k == 0 else PHASES
        h = own.interval[at]
        W += h * (w + h * (2.0 * before + a[k]) / 6.0)
        w += 0.5 * h * (before + a[k])
        lag = own.kept[at] * lag + own.early[at] * before + own.late[at] * a[k]
        before = a[k]
        v[k, j] = w + 0.5 * (lead[k] - lag) / p
        y[k, j] = W + 0.5 * own.ball * (lead[k] + lag)
    y[KNOTS - 1, j] += _TAIL * v[KNOTS - 1, j]


@inlined
def _resist(own, state, phase, a, turn):
    """Fill how large a may be at the knots, in the last plan's direction there, and what friction takes of it."""
    for k in range(_FREE):
        later = own.interval[phase] + own.interval[PHASES] * k
        at = heading_frame_after(a, max(-abs(turn.left), min(abs(turn.left), turn.rate * later)))
        v, force = turned(at, state.v[k, 0], state.v[k, 1]), turned(at, state.a[0, k], state.a[1, k])
        size, largest, drag_x, drag_y = (force.x * force.x + force.y * force.y) ** 0.5, 0.0, 0.0, 0.0
        for i in range(own.wheels):
            speed = own.rolling[i, 0] * v.x + own.rolling[i, 1] * v.y
            dry = own.dry * speed / (speed * speed + _CREEPING * _CREEPING) ** 0.5
            drag_x += own.frame[i, 0] * (own.viscous * speed + dry)
            drag_y += own.frame[i, 1] * (own.viscous * speed + dry)
            share = abs(own.frame[i, 0] * force.x + own.frame[i, 1] * force.y)
            largest = max(largest, share / size if size > _STILL_FORCE else own.worst)
        drag = turned_back(at, drag_x, drag_y)
        state.drag[k, 0], state.drag[k, 1] = drag.x + state.lost[0], drag.y + state.lost[1]
        state.radius[k] = state.most / largest


@inlined
def _aim(own, state, phase, away):
    """Fill the pulls of the start and of the reference, and the wall."""
    now = Pair(state.reference[0] + _LAG * state.bend[0], state.reference[1] + _LAG * state.bend[1])
    speed = (now.x * now.x + now.y * now.y) ** 0.5
    v = Pair(_speed_of(own, state, 0), _speed_of(own, state, 1))
    fast = max(0.0, min(1.0, (speed / own.prompt - 1.0) / (_FAST - 1.0)))
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
        later = own.interval[phase] + own.interval[PHASES] * k + (_TAIL if k == _FREE else 0.0)
        beyond = max(beyond, state.y[k, 0] * d.x + state.y[k, 1] * d.y - place - later * going)
    state.wall[0], state.wall[1] = d.x, d.y
    state.wall[2], state.wall[3] = place + _GIVEN * beyond, going


@inlined
def _speed_of(own, state, j):
    """Return s'."""
    return state.motion[j] + 0.5 * (state.lead[j] - state.lag[j]) / own.falling


@inlined
def _pull(own, state, phase, j):
    """Fill what the rows and the costs pull at an axis's a."""
    p, weight, pull = own.falling, own.weight, state.pull
    for k in range(KNOTS):
        state.force_v[k] = weight[_SPEED] * (
            2.0 * state.speed_z[k, j] - state.speed[k, j] - state.free_v[k, j]
        )
        state.force_y[k] = weight[_WALL] * (2.0 * state.way_z[k, j] - state.way[k, j] - state.free_y[k, j])
    state.force_v[KNOTS - 1] += _TAIL * state.force_y[KNOTS - 1]
    h, W, w, lag = own.interval[PHASES], 0.0, 0.0, 0.0
    for k in range(KNOTS - 1, -1, -1):
        at = phase if k == 0 else PHASES
        first = own.interval[at]
        held = h * (0.5 * w + h * W / 3.0) + own.early[PHASES] * lag
        w += state.force_v[k] + h * W
        W += state.force_y[k]
        lag = own.kept[PHASES] * lag + 0.5 * (own.ball * state.force_y[k] - state.force_v[k] / p)
        pull[k] = held + first * (0.5 * w + first * W / 6.0) + own.late[at] * lag
    lead = 0.0
    for k in range(_FREE):
        before = lead
        lead = own.kept[PHASES] * lead + 0.5 * (own.ball * state.force_y[k] + state.force_v[k] / p)
        pull[k] += own.late[PHASES] * lead + own.early[PHASES] * before - state.start[j, k]
        start = state.begun[j, 3] if k == 0 else 0.0
        changes = 2.0 * state.change_z[k, j] - state.change[k, j] + start
        changes += state.change[k + 1, j] - 2.0 * state.change_z[k + 1, j]
        torques = 2.0 * state.torque_z[k, j] - state.torque[k, j] - state.drag[k, j]
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
    wall = state.wall
    bound = own.force[_TORQUE] / own.weight[_TORQUE]
    for k in range(_FREE):
        torque = Pair(state.a[0, k] + state.drag[k, 0], state.a[1, k] + state.drag[k, 1])
        _limit_length(state.torque, state.torque_z, k, torque, state.radius[k], bound)
    for k in range(KNOTS):
        before_x, before_y = (
            state.begun[0, 3] if k == 0 else state.a[0, k - 1],
            state.begun[1, 3] if k == 0 else state.a[1, k - 1],
        )
        change = own.change * own.interval[phase] / own.interval[PHASES] if k == 0 else own.change
        changed = Pair(state.a[0, k] - before_x, state.a[1, k] - before_y)
        _limit_length(
            state.change, state.change_z, k, changed, change, own.force[_CHANGE] / own.weight[_CHANGE]
        )
        v = Pair(state.v[k, 0], state.v[k, 1])
        _limit_length(state.speed, state.speed_z, k, v, own.speed, own.force[_SPEED] / own.weight[_SPEED])
        t_x = state.way[k, 0] + _OVER * (state.y[k, 0] - state.way_z[k, 0])
        t_y = state.way[k, 1] + _OVER * (state.y[k, 1] - state.way_z[k, 1])
        later = own.interval[phase] + own.interval[PHASES] * k + (_TAIL if k == _FREE else 0.0)
        over = max(0.0, t_x * wall[0] + t_y * wall[1] - wall[2] - later * wall[3])
        over = min(over, own.force[_WALL] / own.weight[_WALL])
        state.way[k, 0], state.way[k, 1] = t_x, t_y
        state.way_z[k, 0], state.way_z[k, 1] = t_x - over * wall[0], t_y - over * wall[1]


@inlined
def _limit_length(row, z, k, given, most, bound):
    """Step a row of vectors whose length is limited."""
    t_x, t_y = row[k, 0] + _OVER * (given.x - z[k, 0]), row[k, 1] + _OVER * (given.y - z[k, 1])
    size = (t_x * t_x + t_y * t_y) ** 0.5
    share = min(size - most, bound) / size if size > most else 0.0
    row[k, 0], row[k, 1] = t_x, t_y
    z[k, 0], z[k, 1] = t_x - share * t_x, t_y - share * t_y


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
        state.lag[j] = own.sample[0] * state.lag[j] + own.sample[1] * before + own.sample[2] * after
        state.lead[j] = (state.lead[j] - own.sample[2] * before - own.sample[1] * after) / own.sample[0]
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
    for k in range(_FREE):
        for j in range(2):
            state.a[j, k] = state.a[j, k + 1]
            state.torque[k, j], state.torque_z[k, j] = state.torque[k + 1, j], state.torque_z[k + 1, j]
            state.change[k, j], state.change_z[k, j] = state.change[k + 1, j], state.change_z[k + 1, j]
            state.speed[k, j], state.speed_z[k, j] = state.speed[k + 1, j], state.speed_z[k + 1, j]
            state.way[k, j], state.way_z[k, j] = state.way[k + 1, j], state.way_z[k + 1, j]
    for j in range(2):
        state.change[_FREE, j], state.change_z[_FREE, j] = 0.0, 0.0


#: weights of the changes of a, and of the rows; found by a search on the preset alten, free of the robot's size
_SMOOTHNESS, _WEIGHTS, _FORCES = 1e-5, (0.004, 0.0015, 0.015, 0.1), (0.7, 0.7, 0.7, 0.035)
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
    v, s = w + third / p**2, W + second / p**2
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


@parameter_class
class Planner(Part):
    """Plan motions on line, within the motors' torque; x and y of the reference are then not shaped, psi still is.

    The motion that is followed ends, or goes on, as the reference does, as soon as torque and speed allow, and the ball
    overshoots no place at which the reference stops. Needs `ReferenceShaping` and `FeedForward`.

    InputError if a value is outside its range, or the robot cannot have feed-forward.
    """

    label = "planner"
    comment = (
        "The motion of x and y is planned on line within torque and speed. A reference up to the prompt speed is\n"
        "# followed without delay, a faster one as far behind as a stop needs."
    )
    record = PlannerRecord
    state = PlannerState
    needs: ClassVar[Mapping[str, str]] = {
        "shaping": "it shapes the heading",
        "feed_forward": "motions as fast as the motors allow need their lean and torques",
    }

    torque_limit: float = parameter("of a wheel, for motions and friction", "N m", least=1e-12, most=1e12)
    speed_limit: float = parameter("over the floor", "m/s", default=2.0, least=1e-12, most=1e12)
    prompt_speed: float = parameter(
        "up to which the reference is followed without delay", "m/s", default=0.3, least=1e-12, most=1e12
    )

    def numbers(self, settings: LawSettings) -> PlannerRecord:
        """Return the sampled planner."""
        needed, robot, dt = FeedForward().numbers(settings), settings.robot, settings.sample_time
        n, offset = robot.wheel_count, float(needed.offset[0, 0])
        p = math.sqrt(np.linalg.norm(needed.by_second) / np.linalg.norm(needed.by_fourth))
        size = float(np.linalg.norm(needed.by_second)) / math.sqrt(2.0)
        every = max(1, round(_EVERY / dt))
        interval = PHASES * every * dt
        intervals = np.array([*(interval - k * every * dt for k in range(PHASES)), interval])
        tables = [_matrices(p, offset, first, interval) for first in intervals[:PHASES]]
        inverse, by_lead, by_start, by_reference = (np.array(one) for one in zip(*tables, strict=True))
        times, sample = _times(p, intervals), _times(p, np.array([dt]))
        largest = self.torque_limit / float(np.linalg.norm(needed.by_second, axis=1).max())
        return PlannerRecord(
            every=every,
            steps=math.ceil(_STEPS / every),
            wheels=n,
            rate=1.0 / dt,
            falling=p,
            square=1.0 / p**2,
            ball=1.0 / p**2 - offset,
            **times._asdict(),
            sample=np.array([sample.kept[0], sample.early[0], sample.late[0]]),
            inverse=inverse,
            by_lead=by_lead,
            by_start=by_start,
            by_reference=by_reference,
            frame=needed.by_second / size,
            rolling=frictionless_model(robot).wheel_jacobian(np.zeros(5))[:, :2],
            most=self.torque_limit / size,
            viscous=float(np.mean(robot.friction.viscous)) / size,
            dry=float(np.mean(robot.friction.coulomb)) / size,
            turning=float(np.abs(needed.by_turning).max()) / size,
            torque=1.0 / size,
            worst=float(np.linalg.norm(needed.by_second, axis=1).max()) / size,
            weight=np.array(_WEIGHTS),
            force=largest * np.array(_FORCES),
            change=2.0 * largest * interval / _REVERSAL,
            speed=self.speed_limit,
            prompt=self.prompt_speed,
            far=_FAR * self.speed_limit,
            delay=settings.delay,
            late_reference=-math.expm1(-dt / _LAG),
        )
