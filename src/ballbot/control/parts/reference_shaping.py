"""Reference shaping: whatever the reference does becomes a motion that the robot can follow.

For x and y together and for psi alike, a point p with velocity v follows a target, and four lags follow p:

    target = r + (1 - l) (t r' + c r'') - l (r'^2/(2 b) + t_0 r')    t = 4/w + tau,  c = 6/w^2 + 4 tau/w + tau^2/2
    p' = v,  v' = w (asked - v),  |v'| <= a,  |v| <= the speed limit
    s_1' = w (p - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4

so that s has four derivatives, which the feed-forward needs. Far from its target p moves as fast as a deceleration of b
can still stop it, near it at the approach rate; b is somewhat below a. v follows what is asked of it by a fifth lag, so
that a change from accelerating to braking is no jump of v'. What torque a wheel needs against lasting
disturbances, as on a slope, takes its share of a, so that the motors are left what a motion needs; so does the viscous
friction of a motion that speeds up (drag). While errors command more than the lean limit, as after a push, the robot
needs its torque to catch itself: a is least then, and comes back within a second. (Without this, a jump of the
reference soon after a push let robots fall that stand both with it.)

A reference that moves slowly, such as a figure of eight, is followed without delay: then l is zero, and the target is
ahead of r by what the lags and a delay tau cost, which is predicted over. One that moves fast may stop at any time, and
a robot that is not to overshoot must brake first: then l is one, and s is behind r by what it needs to stop, with t_0
to notice it.

r' and r'' are the reference's changes from sample to sample through lags of `_LAG`, in which the steps of a rounded
reference vanish. A change faster than the speed limit is a jump, which has no velocity; a change of velocity counts in
full as r'' up to half of a, and not at all from a on.

With p held over a sample of h, d_i = s_i - p and g = w h, the lags are stepped exactly:

    d_i(h) = exp(-g) (d_i + g d_(i-1) + g^2/2 d_(i-2) + g^3/6 d_(i-3))

and s'''' is that of the mean of p before and after its step.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.part import (
    FollowedMotion,
    LawSettings,
    Pair,
    Part,
    Pose,
    SmoothReference,
    turned,
)
from ballbot.mechanics.engine.compensated_sum import add_to
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole
from ballbot.robot.parameters import parameter, parameter_class

#: rounding by which a motion at the limit of speed may exceed it
_ROUNDING = 1e-3
# constants that single precision holds exactly, so that the firmware's are these
#: lag of r' and r'' [s]
_LAG = 0.046875
#: t_0 [s]: by then most of r' is gone after a stop
_NOTICED = 2.0 * _LAG
#: deceleration b that p expects of itself, over the limit a
BRAKING = 0.875
#: the largest share of its way to a target that p goes in a sample
_LARGEST_APPROACH = 0.5
#: weight of the torque against disturbances: a motion that changes needs more than its acceleration does
_RESERVE = 1.5
#: lag of the torque against disturbances [s]
_LASTING = 1.0
#: least fraction of the limit of acceleration that disturbances leave, and of these the drag
_LEAST_LEFT = 0.25
#: ratio of the speeds at which l is one and zero
_FAST = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapingRecord:
    """The sampled shaping."""

    on: int = field(default=1, metadata=whole())
    frequency: float = field(metadata=number("rad/s"))
    decay: float = field(metadata=number("1"))
    #: 1 - decay, which single precision would round
    gone: float = field(metadata=number("1"))
    yaw_frequency: float = field(metadata=number("rad/s"))
    yaw_decay: float = field(metadata=number("1"))
    yaw_gone: float = field(metadata=number("1"))
    #: limits of v and v', and the speed up to which a motion is followed without delay; the same of psi
    speed: float = field(metadata=number("m/s"))
    acceleration: float = field(metadata=number("m/s^2"))
    #: v' that each m/s of v takes
    drag: float = field(metadata=number("1/s"))
    prompt: float = field(metadata=number("m/s"))
    yaw_rate: float = field(metadata=number("rad/s"))
    yaw_acceleration: float = field(metadata=number("rad/s^2"))
    yaw_prompt: float = field(metadata=number("rad/s"))
    rate: float = field(metadata=number("1/s"))
    approach: float = field(metadata=number("1/s"))
    #: that is predicted over, tau
    delay: float = field(metadata=number("s"))
    #: fraction of the difference by which the lags of r' and r'' change in a sample
    late: float = field(metadata=number("1"))


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapingState:
    """Of x, y and psi: four lags each, p, v, the last r, r' and r''.

    Single precision keeps the rounding errors of the lags and of p for the next sample (`add_to`).
    """

    lags: NDArray[np.float64] = field(metadata=number("m", 3, 4))
    followed: NDArray[np.float64] = field(metadata=number("m", 3))
    lags_rest: NDArray[np.float64] = field(metadata=number("m", 3, 4))
    followed_rest: NDArray[np.float64] = field(metadata=number("m", 3))
    velocity: NDArray[np.float64] = field(metadata=number("m/s", 3))
    last: NDArray[np.float64] = field(metadata=number("m", 3))
    started: int = field(metadata=whole())
    change: NDArray[np.float64] = field(metadata=number("m/s", 3))
    bend: NDArray[np.float64] = field(metadata=number("m/s^2", 3))
    #: largest torque of a wheel against lasting disturbances, or all of it while the robot catches itself
    lost: float = field(metadata=number("N m"))


class _Limits(NamedTuple):
    """Lags and limits of the position or of the heading."""

    frequency: float  # w [rad/s]
    decay: float  # exp(-w h)
    gone: float  # 1 - exp(-w h), which a difference would round
    step: float  # g = w h
    speed: float
    acceleration: float
    drag: float
    prompt: float
    offset: float  # of the flat output from the position, over the acceleration [s^2]


class _Motion(NamedTuple):
    """The motion of the position or of the heading, whose second numbers are zero."""

    velocity: Pair
    last: Pair
    change: Pair
    bend: Pair


@inlined
def shape(law, memory, pose, ahead, wanted):
    """Return the shaped motion to a pose, relative to the measured one, and advance the memory."""
    own, state = law.shaping, memory.shaping
    h = 1.0 / own.rate
    acceleration = _left(law, memory, ahead.a) * own.acceleration
    offset = law.feed_forward.offset[0, 0]  # along y hardly another
    w, g, drag = own.frequency, own.frequency * h, own.drag
    place = _Limits(w, own.decay, own.gone, g, own.speed, acceleration, drag, own.prompt, offset)
    heading = _Limits(
        own.yaw_frequency,
        own.yaw_decay,
        own.yaw_gone,
        own.yaw_frequency * h,
        own.yaw_rate,
        own.yaw_acceleration,
        0.0,
        own.yaw_prompt,
        0.0,
    )
    if state.started == 0:
        begun = Pose(pose.x + ahead.state.x, pose.y + ahead.state.y, pose.psi + ahead.state.psi)
        _start(state, begun, wanted)
    p, rest = state.followed, state.followed_rest
    away = Pair(wanted.x - p[0] - rest[0], wanted.y - p[1] - rest[1])
    turn = Pair(wanted.psi - p[2] - rest[2], 0.0)
    place_before, turn_before = _place_of(state), _turn_of(state)
    place_after = _moved(own, place, place_before, Pair(wanted.x, wanted.y), away)
    turn_after = _moved(own, heading, turn_before, Pair(wanted.psi, 0.0), turn)
    _keep(state, place_after, turn_after)
    return FollowedMotion(
        _lagged(place, state, 0, h * state.velocity[0], pose.x),
        _lagged(place, state, 1, h * state.velocity[1], pose.y),
        _lagged(heading, state, 2, h * state.velocity[2], pose.psi),
    )


@inlined
def shape_heading(law, memory, pose, ahead, wanted):
    """Return the shaped heading, relative to the measured one, and advance the memory."""
    own, state = law.shaping, memory.shaping
    if state.started == 0:
        _start(state, Pose(pose.x, pose.y, pose.psi + ahead.state.psi), wanted)
    heading = _Limits(
        own.yaw_frequency,
        own.yaw_decay,
        own.yaw_gone,
        own.yaw_frequency / own.rate,
        own.yaw_rate,
        own.yaw_acceleration,
        0.0,
        own.yaw_prompt,
        0.0,
    )
    turn = Pair(wanted.psi - state.followed[2] - state.followed_rest[2], 0.0)
    place, turn_before = _place_of(state), _turn_of(state)
    turn_after = _moved(own, heading, turn_before, Pair(wanted.psi, 0.0), turn)
    _keep(state, place, turn_after)
    return _lagged(heading, state, 2, state.velocity[2] / own.rate, pose.psi)


@inlined
def _left(law, memory, a):
    """Return the fraction of the limit of acceleration that lasting disturbances leave, and follow them."""
    own, sums, most = memory.shaping, memory.integral.sums, 0.0
    I = turned(a, sums[0], sums[1])  # noqa: E741 (as in `ballbot.control.parts.integral`)
    for i in range(MAX_WHEELS):
        gain, more = law.integral.gain[i], memory.tuning.integral[i]
        by_place = (gain[0] + more[0]) * I.x + (gain[1] + more[1]) * I.y
        lost = memory.disturbance_observer.estimate[i] + by_place + (gain[2] + more[2]) * sums[2]
        most = max(most, abs(lost))
    own.lost += (most - own.lost) / (_LASTING * law.shaping.rate + 1.0)
    return max(_LEAST_LEFT, 1.0 - _RESERVE * own.lost / law.torque_limit)


@inlined
def slow_motion(law, memory):
    """Leave motions the least acceleration: the robot needs its torque to catch itself."""
    memory.shaping.lost = law.torque_limit


@inlined
def restart_shaping(memory, wanted):
    """Let the shaping go on from a pose at rest: a plan, which is followed without it, ends there."""
    own = memory.shaping
    _start(own, wanted, wanted)
    for axis in range(3):
        own.velocity[axis], own.change[axis], own.bend[axis] = 0.0, 0.0, 0.0


@inlined
def _start(state, pose, wanted):
    """Let the motion start at rest at a pose."""
    for i in range(4):
        state.lags[0, i], state.lags[1, i], state.lags[2, i] = pose.x, pose.y, pose.psi
        state.lags_rest[0, i], state.lags_rest[1, i], state.lags_rest[2, i] = 0.0, 0.0, 0.0
    state.followed[0], state.followed[1], state.followed[2] = pose.x, pose.y, pose.psi
    state.followed_rest[0], state.followed_rest[1], state.followed_rest[2] = 0.0, 0.0, 0.0
    state.last[0], state.last[1], state.last[2] = wanted.x, wanted.y, wanted.psi
    state.started = 1


@inlined
def _place_of(state):
    """Return the motion of the position that the memory holds."""
    v, r, change, bend = state.velocity, state.last, state.change, state.bend
    return _Motion(Pair(v[0], v[1]), Pair(r[0], r[1]), Pair(change[0], change[1]), Pair(bend[0], bend[1]))


@inlined
def _turn_of(state):
    """Return the motion of the heading that the memory holds."""
    return _Motion(
        Pair(state.velocity[2], 0.0),
        Pair(state.last[2], 0.0),
        Pair(state.change[2], 0.0),
        Pair(state.bend[2], 0.0),
    )


@inlined
def _keep(state, place, turn):
    """Put both motions into the memory."""
    v, r, change, bend = state.velocity, state.last, state.change, state.bend
    v[0], v[1], v[2] = place.velocity.x, place.velocity.y, turn.velocity.x
    r[0], r[1], r[2] = place.last.x, place.last.y, turn.last.x
    change[0], change[1], change[2] = place.change.x, place.change.y, turn.change.x
    bend[0], bend[1], bend[2] = place.bend.x, place.bend.y, turn.bend.x


@inlined
def _moved(own, limits, motion, r, away):
    """Return a motion after a sample with the reference r, which is `away` from p."""
    noticed = _notice(own, limits, motion, r)
    asked = _ask(own, limits, noticed, away)
    share = min(1.0, limits.step)
    missing = _plus(asked, -1.0, motion.velocity)
    along = missing.x * motion.velocity.x + missing.y * motion.velocity.y
    dragged = limits.drag * max(0.0, along) / max(_length(missing), _ROUNDING * limits.speed)
    most = max(limits.acceleration - dragged, _LEAST_LEFT * limits.acceleration)
    change = _limited(Pair(share * missing.x, share * missing.y), most / own.rate)
    return _Motion(_plus(motion.velocity, 1.0, change), r, noticed.change, noticed.bend)


@inlined
def _notice(own, limits, motion, r):
    """Return a motion with r' and r'' filtered; a jump has no velocity, and r'' counts up to the limit."""
    d = _plus(r, -1.0, motion.last)
    rate = own.rate if own.rate * _length(d) <= (1.0 + _ROUNDING) * limits.speed else 0.0
    n = Pair(rate * d.x - motion.change.x, rate * d.y - motion.change.y)
    counts = max(0.0, min(1.0, 2.0 - 2.0 * own.late * own.rate * _length(n) / limits.acceleration))
    wanted = counts * own.late * own.rate
    bend = Pair(
        motion.bend.x + own.late * (wanted * n.x - motion.bend.x),
        motion.bend.y + own.late * (wanted * n.y - motion.bend.y),
    )
    return _Motion(motion.velocity, motion.last, _plus(motion.change, own.late, n), bend)


@inlined
def _ask(own, limits, motion, away):
    """Return the velocity that is asked of p once its lag has passed: that of its target, and what takes it there."""
    w, tau, braking = limits.frequency, own.delay, BRAKING * limits.acceleration
    lag = max(1.0 / w, 1.0 / own.rate)
    now = _plus(motion.change, _LAG, motion.bend)
    speed = _length(now)
    prompt = max(0.0, min(1.0, (_FAST - speed / limits.prompt) / (_FAST - 1.0)))
    t = prompt * (4.0 / w + tau)
    c = prompt * (6.0 / (w * w) + 4.0 * tau / w + 0.5 * tau * tau + limits.offset)
    ahead = t - (1.0 - prompt) * (0.5 * speed / braking + _NOTICED)
    # how far p is from its target once the lag has passed
    closing = _plus(_plus(now, t, motion.bend), -1.0, motion.velocity)
    e = _plus(_plus(_plus(away, ahead, now), c, motion.bend), lag, closing)
    near = braking / own.approach
    pull = 2.0 * braking / (near + (near * near + 2.0 * braking * _length(e)) ** 0.5)
    return _limited(_plus(_plus(now, t + lag, motion.bend), pull, e), limits.speed)


@inlined
def _length(v):
    """Return the length of a vector."""
    return (v.x * v.x + v.y * v.y) ** 0.5


@inlined
def _plus(v, factor, other):
    """Return v and a multiple of another vector."""
    return Pair(v.x + factor * other.x, v.y + factor * other.y)


@inlined
def _limited(v, most):
    """Return a vector that is no longer than a limit."""
    size = _length(v)
    share = most / size if size > most else 1.0
    return Pair(share * v.x, share * v.y)


@inlined
def _lagged(lags, state, axis, step, pose):
    """Return an axis's motion at the sample, relative to the pose; let p make a step, and its four lags follow.

    Only differences of neighbouring places are taken, which are exact in floating point, so that it does not matter
    how far from the origin the motion is.
    """
    s, rest = state.lags[axis], state.lags_rest[axis]
    w, a, g, gone = lags.frequency, lags.decay, lags.step, lags.gone
    half, sixth = 0.5 * g * g, g * g * g / 6.0
    first = (s[0] - s[1]) + (rest[0] - rest[1])
    second = (s[1] - s[2]) + (rest[1] - rest[2])
    third = (s[2] - s[3]) + (rest[2] - rest[3])
    d_1 = ((s[0] - state.followed[axis]) + (rest[0] - state.followed_rest[axis])) - step
    d_2 = d_1 - first
    d_3 = d_2 - second
    d_4 = d_3 - third
    w_2 = w * w
    motion = SmoothReference(
        (s[3] - pose) + rest[3],
        w * third,
        w_2 * (second - third),
        w_2 * w * (first - 2.0 * second + third),
        w_2 * w_2 * (3.0 * (second - first) - third - d_1 - 0.5 * step),
    )
    add_to(state.followed, state.followed_rest, axis, step)
    add_to(s, rest, 0, -gone * d_1)
    add_to(s, rest, 1, a * g * d_1 - gone * d_2)
    add_to(s, rest, 2, a * (g * d_2 + half * d_1) - gone * d_3)
    add_to(s, rest, 3, a * (g * d_3 + half * d_2 + sixth * d_1) - gone * d_4)
    return motion


#: range of the settings: beyond it derivatives vanish in rounding or overflow
_LEAST, _MOST = 1e-12, 1e12


@parameter_class
class ReferenceShaping(Part):
    """Make whatever the reference does a motion of limited speed and acceleration.

    Replaces x, y [m] and psi [rad] of the reference, world frame, and their rates by smooth ones with four
    derivatives, which `FeedForward` uses. Motions up to `prompt_speed` are followed without delay, faster ones by as
    much behind as a stop needs, so that the robot does not overshoot where they end.

    InputError if a value is not from 1e-12 to 1e12.
    """

    label = "reference shaping"
    comment = (
        "References are made smooth: their speed and acceleration are limited, and four lags follow for x, y and psi\n"
        "# each. A slow motion is followed without delay, a fast one as far behind as a stop needs."
    )
    record = ShapingRecord
    state = ShapingState

    frequency: float = parameter(
        "w of each of the four lags of x and y", "rad/s", default=12.0, least=_LEAST, most=_MOST
    )
    speed_limit: float = parameter("over the floor", "m/s", default=2.0, least=_LEAST, most=_MOST)
    speed_cap: float = parameter("for people's safety", "m/s", default=_MOST, least=_LEAST, most=_MOST)
    acceleration_limit: float = parameter("over the floor", "m/s^2", default=1.2, least=_LEAST, most=_MOST)
    drag: float = parameter("part of it that each m/s takes", "s/m", default=0.0, least=0.0, most=_MOST)
    approach_rate: float = parameter(
        "at which x, y and psi come to a pose that is near", "1/s", default=4.0, least=_LEAST, most=_MOST
    )
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

    def numbers(self, settings: LawSettings) -> ShapingRecord:
        """Return the sampled shaping; the lead makes up for a delay that is predicted over."""
        sample_time = settings.sample_time
        return ShapingRecord(
            frequency=self.frequency,
            decay=math.exp(-self.frequency * sample_time),
            gone=-math.expm1(-self.frequency * sample_time),
            yaw_frequency=self.yaw_frequency,
            yaw_decay=math.exp(-self.yaw_frequency * sample_time),
            yaw_gone=-math.expm1(-self.yaw_frequency * sample_time),
            speed=min(self.speed_limit, self.speed_cap),
            acceleration=self.acceleration_limit,
            drag=self.drag * self.acceleration_limit,
            prompt=self.prompt_speed,
            yaw_rate=self.yaw_rate_limit,
            yaw_acceleration=self.yaw_acceleration_limit,
            yaw_prompt=self.yaw_prompt_rate,
            rate=1.0 / sample_time,
            approach=min(self.approach_rate, _LARGEST_APPROACH / sample_time),
            delay=settings.delay,
            late=-math.expm1(-sample_time / _LAG),
        )
