"""Reference shaping: whatever the reference does becomes a motion that the robot can follow.

For x and y together and for psi alike, a point p with velocity v follows a target, and four lags follow p:

    target = r + (1 - l) (t r' + c r'') - l (r'^2/(2 b) + t_0 r')    t = 4/w + tau,  c = 6/w^2 + 4 tau/w + tau^2/2
    p' = v,  |v'| <= a,  |v| <= the speed limit
    s_1' = w (p - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4

so that s has four derivatives, which the feed-forward needs. Far from its target p moves as fast as a deceleration of b
can still stop it, near it at the rate `_APPROACH`; b is somewhat below a. What torque a wheel needs against lasting
disturbances, as on a slope, takes its share of a, so that the motors are left what a motion needs. While errors command
more than the lean limit, as after a push, the robot needs its torque to catch itself: a is least then, and comes back
within a second. (Without this, a jump of the reference soon after a push let robots fall that stand both with it.)

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

from ballbot.control.parts.part import LawSettings, Part, SmoothReference, row_times, turned
from ballbot.control.records import MAX_WHEELS, number, whole
from ballbot.mechanics.engine.compiled import inlined
from ballbot.robot.parameters import parameter, parameter_class

#: rounding by which a motion at the limit of speed may exceed it
_ROUNDING = 1e-3
# constants that single precision holds exactly, so that the firmware's are these
#: lag of r' and r'' [s]
_LAG = 0.046875
#: t_0 [s]: by then most of r' is gone after a stop
_NOTICED = 2.0 * _LAG
#: deceleration b that p expects of itself, over the limit a
_BRAKING = 0.875
#: rate at which p approaches a target that is near [1/s], and the largest in a sample
_APPROACH, _LARGEST_APPROACH = 4.0, 0.5
#: weight of the torque against disturbances: a motion that changes needs more than its acceleration does
_RESERVE = 1.5
#: lag of the torque against disturbances [s]
_LASTING = 1.0
#: least fraction of the limit of acceleration that disturbances leave
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

    The firmware keeps the rounding errors of the lags and of p for the next sample (compensated sums); double precision
    does not need them and leaves them zero.
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
    """Lags and limits of the position or of the heading, in compiled code."""

    frequency: float  #: w [rad/s]
    decay: float  #: exp(-w h)
    step: float  #: g = w h
    speed: float
    acceleration: float
    prompt: float


class _Motion(NamedTuple):
    """What `ShapingState` has of the position or of the heading, whose second numbers are zero; in compiled code."""

    followed: tuple
    velocity: tuple
    last: tuple
    change: tuple
    bend: tuple


@inlined
def shape(law, memory, wanted, now):
    """Return the shaped reference, or the reference itself without shaping."""
    if law.shaping.on == 0:
        return wanted
    return _shaped(law.shaping, memory.shaping, _left(law, memory, now.a), now.state, wanted)


@inlined
def _left(law, memory, a):
    """Return the fraction of the limit of acceleration that lasting disturbances leave, and follow them."""
    sums, most = memory.integral.sums, 0.0
    lasting = (*turned(a, sums[0], sums[1]), sums[2])
    for i in range(MAX_WHEELS):
        lost = row_times(law.integral.gain[i], lasting) + row_times(memory.tuning.integral[i], lasting)
        most = max(most, abs(memory.disturbance_observer.estimate[i] + lost))
    own = memory.shaping
    own.lost += (most - own.lost) / (_LASTING * law.shaping.rate + 1.0)
    return max(_LEAST_LEFT, 1.0 - _RESERVE * own.lost / law.torque_limit)


@inlined
def slow_motion(law, memory):
    """Leave motions the least acceleration: the robot needs its torque to catch itself."""
    memory.shaping.lost = law.torque_limit


@inlined
def _shaped(own, memory, left, state, wanted):
    """Return the shaped x, y and psi as three `SmoothReference`, which start at the pose, and advance the memory."""
    x, y, psi = wanted[0].value, wanted[1].value, wanted[2].value
    h = 1.0 / own.rate
    position = _Limits(
        own.frequency, own.decay, own.frequency * h, own.speed, left * own.acceleration, own.prompt
    )
    heading = _Limits(
        own.yaw_frequency,
        own.yaw_decay,
        own.yaw_frequency * h,
        own.yaw_rate,
        own.yaw_acceleration,
        own.yaw_prompt,
    )
    if memory.started == 0:
        _start(memory, state, x, y, psi)
    place, turn = _motions(memory)
    place, turn = _moved(own, position, place, (x, y)), _moved(own, heading, turn, (psi, 0.0))
    _keep(memory, place, turn)
    p, v = memory.followed, memory.velocity
    return (
        _lagged(position, memory.lags[0], p[0], h * v[0]),
        _lagged(position, memory.lags[1], p[1], h * v[1]),
        _lagged(heading, memory.lags[2], p[2], h * v[2]),
    )


@inlined
def restart_shaping(memory, wanted):
    """Let the shaping go on from a pose at rest: a plan, which is followed without it, ends there."""
    x, y, psi = wanted[0].value, wanted[1].value, wanted[2].value
    own = memory.shaping
    _start(own, (x, y, 0.0, 0.0, psi), x, y, psi)
    for i in range(3):
        own.velocity[i], own.change[i], own.bend[i] = 0.0, 0.0, 0.0


@inlined
def _start(memory, state, r_x, r_y, r_psi):
    x, y, psi = state[0], state[1], state[4]
    for i in range(4):
        memory.lags[0, i], memory.lags[1, i], memory.lags[2, i] = x, y, psi
    memory.followed[0], memory.followed[1], memory.followed[2] = x, y, psi
    memory.last[0], memory.last[1], memory.last[2] = r_x, r_y, r_psi
    memory.started = 1


@inlined
def _motions(memory):
    """Return the motions of the position and of the heading that the memory holds."""
    p, v, r, change, bend = memory.followed, memory.velocity, memory.last, memory.change, memory.bend
    place = _Motion((p[0], p[1]), (v[0], v[1]), (r[0], r[1]), (change[0], change[1]), (bend[0], bend[1]))
    turn = _Motion((p[2], 0.0), (v[2], 0.0), (r[2], 0.0), (change[2], 0.0), (bend[2], 0.0))
    return place, turn


@inlined
def _keep(memory, place, turn):
    """Put both motions into the memory."""
    for i in range(3):
        at, of = (i, place) if i < 2 else (0, turn)
        memory.followed[i], memory.velocity[i], memory.last[i] = of.followed[at], of.velocity[at], of.last[at]
        memory.change[i], memory.bend[i] = of.change[at], of.bend[at]


@inlined
def _moved(own, limits, motion, r):
    """Return a motion after a sample with the reference r."""
    h = 1.0 / own.rate
    change, bend = _noticed(own, limits, motion, r)
    asked = _asked(own, limits, motion, r, change, bend)
    faster = _limited(_plus(asked, -1.0, motion.velocity), limits.acceleration * h)
    v = _plus(motion.velocity, 1.0, faster)
    return _Motion(_plus(motion.followed, h, v), v, r, change, bend)


@inlined
def _noticed(own, limits, motion, r):
    """Return r' and r'', filtered; a jump has no velocity, and a change of velocity counts up to the limit."""
    d = _plus(r, -1.0, motion.last)
    moves = own.rate * _length(d) <= (1.0 + _ROUNDING) * limits.speed
    velocity = (own.rate * d[0], own.rate * d[1]) if moves else (0.0, 0.0)
    n = _plus(velocity, -1.0, motion.change)
    counts = max(0.0, min(1.0, 2.0 - 2.0 * own.late * own.rate * _length(n) / limits.acceleration))
    wanted = counts * own.late * own.rate
    bend = (
        motion.bend[0] + own.late * (wanted * n[0] - motion.bend[0]),
        motion.bend[1] + own.late * (wanted * n[1] - motion.bend[1]),
    )
    return _plus(motion.change, own.late, n), bend


@inlined
def _asked(own, limits, motion, r, change, bend):
    """Return the velocity that is asked of p: that of its target, and what takes it there."""
    w, tau, braking = limits.frequency, own.delay, _BRAKING * limits.acceleration
    now = _plus(change, _LAG, bend)
    speed = _length(now)
    prompt = max(0.0, min(1.0, (_FAST - speed / limits.prompt) / (_FAST - 1.0)))
    t, c = prompt * (4.0 / w + tau), prompt * (6.0 / (w * w) + 4.0 * tau / w + 0.5 * tau * tau)
    target = _plus(_plus(r, t - (1.0 - prompt) * (0.5 * speed / braking + _NOTICED), now), c, bend)
    e = _plus(target, -1.0, motion.followed)
    near = braking / own.approach
    pull = 2.0 * braking / (near + (near * near + 2.0 * braking * _length(e)) ** 0.5)
    return _limited(_plus(_plus(now, t, bend), pull, e), limits.speed)


@inlined
def _length(v):
    return (v[0] * v[0] + v[1] * v[1]) ** 0.5


@inlined
def _plus(v, factor, other):
    return v[0] + factor * other[0], v[1] + factor * other[1]


@inlined
def _limited(v, most):
    size = _length(v)
    share = most / size if size > most else 1.0
    return share * v[0], share * v[1]


@inlined
def _lagged(lags, memory, target, step):
    """Return an axis's `SmoothReference` at the sample, where p has made a step, and advance its four lags."""
    w, a, g = lags.frequency, lags.decay, lags.step
    d_1, d_2 = memory[0] - target, memory[1] - target
    d_3, d_4 = memory[2] - target, memory[3] - target
    half, sixth = 0.5 * g * g, g * g * g / 6.0
    memory[0] = target + a * d_1
    memory[1] = target + a * (d_2 + g * d_1)
    memory[2] = target + a * (d_3 + g * d_2 + half * d_1)
    memory[3] = target + a * (d_4 + g * d_3 + half * d_2 + sixth * d_1)
    w_2 = w * w
    return SmoothReference(
        target + d_4,
        w * (d_3 - d_4),
        w_2 * (d_2 - 2.0 * d_3 + d_4),
        w_2 * w * (d_1 - 3.0 * d_2 + 3.0 * d_3 - d_4),
        w_2 * w_2 * (-4.0 * d_1 + 6.0 * d_2 - 4.0 * d_3 + d_4 - 0.5 * step),
    )


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
    acceleration_limit: float = parameter("over the floor", "m/s^2", default=1.2, least=_LEAST, most=_MOST)
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
            speed=self.speed_limit,
            acceleration=self.acceleration_limit,
            prompt=self.prompt_speed,
            yaw_rate=self.yaw_rate_limit,
            yaw_acceleration=self.yaw_acceleration_limit,
            yaw_prompt=self.yaw_prompt_rate,
            rate=1.0 / sample_time,
            approach=min(_APPROACH, _LARGEST_APPROACH / sample_time),
            delay=settings.delay,
            late=-math.expm1(-sample_time / _LAG),
        )
