"""Reference shaping: a jump becomes a smooth motion that the robot can follow without saturation.

For x, y and psi alike, the reference r passes

    a limit of speed      p follows r by no more than the limit a second, x and y together in a straight line
    four equal lags       s_1' = w (p* - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4

so that s has four derivatives, which the feed-forward needs, and does not overshoot a step. If the reference moves
slower than the limit of speed and its velocity changes by less than the limit of acceleration,

    p* = p + (4/w + tau) r' + (6/w^2 + 4 tau/w + tau^2/2) r''

removes the error by the lags and by a delay tau that is predicted over: at constant acceleration all of it. The weight
of r'' is one up to the limit of acceleration and falls to zero at twice the limit; r'' passes a lag `_BEND_LAG`, so
that the steps of a rounded reference do not count as acceleration. With p* held over a sample of h, d_i = s_i - p* and
g = w h, the lags are stepped exactly:

    d_i(h) = exp(-g) (d_i + g d_(i-1) + g^2/2 d_(i-2) + g^3/6 d_(i-3))
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.part import LawSettings, Part, SmoothReference
from ballbot.control.records import number, whole
from ballbot.mechanics.engine.compiled import inlined
from ballbot.robot.parameters import parameter, parameter_class

#: rounding by which a motion at the limit of speed may exceed it
_ROUNDING = 1e-3
#: lag of r'' [s]
_BEND_LAG = 0.05


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
    #: largest change of p in a sample, and of psi
    speed: float = field(metadata=number("m"))
    turn: float = field(metadata=number("rad"))
    #: largest change of these changes from sample to sample
    kink: float = field(metadata=number("m"))
    turning_kink: float = field(metadata=number("rad"))
    rate: float = field(metadata=number("1/s"))
    #: that is predicted over, tau
    delay: float = field(metadata=number("s"))
    #: fraction of the difference by which the lag of r'' changes in a sample
    late: float = field(metadata=number("1"))


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapingState:
    """Of x, y and psi: four lags each, p, the last r, its last change, and the filtered change of that.

    The firmware keeps the rounding errors of the lags and of p for the next sample (compensated sums); double precision
    does not need them and leaves them zero.
    """

    lags: NDArray[np.float64] = field(metadata=number("m", 3, 4))
    followed: NDArray[np.float64] = field(metadata=number("m", 3))
    lags_rest: NDArray[np.float64] = field(metadata=number("m", 3, 4))
    followed_rest: NDArray[np.float64] = field(metadata=number("m", 3))
    last: NDArray[np.float64] = field(metadata=number("m", 3))
    started: int = field(metadata=whole())
    change: NDArray[np.float64] = field(metadata=number("m", 3))
    bend: NDArray[np.float64] = field(metadata=number("m", 3))


class _Lags(NamedTuple):
    """One axis's lags over a sample, in compiled code."""

    frequency: float  #: w [rad/s]
    decay: float  #: exp(-w h)
    step: float  #: g = w h


@inlined
def shape(law, memory, wanted, state):
    """Return the shaped reference, or the reference itself without shaping."""
    if law.shaping.on == 0:
        return wanted
    return _shaped(law.shaping, memory.shaping, state, wanted)


@inlined
def _shaped(own, memory, state, wanted):
    """Return the shaped x, y and psi as three `SmoothReference`, which start at the pose, and advance the memory."""
    x, y, psi = wanted[0].value, wanted[1].value, wanted[2].value
    position = _Lags(own.frequency, own.decay, own.frequency / own.rate)
    heading = _Lags(own.yaw_frequency, own.yaw_decay, own.yaw_frequency / own.rate)
    p, last, change, bend = memory.followed, memory.last, memory.change, memory.bend
    if memory.started == 0:
        _start(memory, state, x, y, psi)
    d_x, d_y, d_psi = x - last[0], y - last[1], psi - last[2]
    n_x, n_y, n_psi = d_x - change[0], d_y - change[1], d_psi - change[2]
    fastest, turn = (1.0 + _ROUNDING) * own.speed, (1.0 + _ROUNDING) * own.turn
    moves, turns = d_x * d_x + d_y * d_y <= fastest * fastest, abs(d_psi) <= turn
    bends, veers = (
        _counted((n_x * n_x + n_y * n_y) ** 0.5 / own.kink),
        _counted(abs(n_psi) / own.turning_kink),
    )
    bend[0] += own.late * (bends * n_x - bend[0])
    bend[1] += own.late * (bends * n_y - bend[1])
    bend[2] += own.late * (veers * n_psi - bend[2])
    lead_x = _lead(own, position, d_x, bend[0], moves)
    lead_y = _lead(own, position, d_y, bend[1], moves)
    lead_psi = _lead(own, heading, d_psi, bend[2], turns)
    _follow(own, p, last, x, y, psi)
    change[0], change[1], change[2] = d_x, d_y, d_psi
    return (
        _lagged(position, memory.lags[0], p[0] + lead_x),
        _lagged(position, memory.lags[1], p[1] + lead_y),
        _lagged(heading, memory.lags[2], p[2] + lead_psi),
    )


@inlined
def restart_shaping(memory, wanted):
    """Let the shaping go on from a pose at rest: a plan, which is followed without it, ends there."""
    x, y, psi = wanted[0].value, wanted[1].value, wanted[2].value
    own = memory.shaping
    _start(own, (x, y, 0.0, 0.0, psi), x, y, psi)
    for i in range(3):
        own.change[i] = 0.0
        own.bend[i] = 0.0


@inlined
def _start(memory, state, r_x, r_y, r_psi):
    x, y, psi = state[0], state[1], state[4]
    for i in range(4):
        memory.lags[0, i], memory.lags[1, i], memory.lags[2, i] = x, y, psi
    memory.followed[0], memory.followed[1], memory.followed[2] = x, y, psi
    memory.last[0], memory.last[1], memory.last[2] = r_x, r_y, r_psi
    memory.started = 1


@inlined
def _counted(size):
    """Return the weight of an acceleration, given its ratio to the limit."""
    return max(0.0, min(1.0, 2.0 - size))


@inlined
def _lead(own, lags, change, bend, moves):
    """Return p* - p by the reference's change in a sample and the change of that; zero for a jump."""
    w, tau, rate = lags.frequency, own.delay, own.rate
    lead = (4.0 / w + tau) * rate * change
    curve = (6.0 / (w * w) + 4.0 * tau / w + 0.5 * tau * tau) * rate * rate * bend
    return lead + curve if moves else 0.0


@inlined
def _follow(own, p, last, x, y, psi):
    """Move p towards r within the limits, and keep r."""
    d_x, d_y, d_psi = x - p[0], y - p[1], psi - p[2]
    distance = (d_x * d_x + d_y * d_y) ** 0.5
    share = own.speed / distance if distance > own.speed else 1.0
    p[0] += share * d_x
    p[1] += share * d_y
    p[2] += max(-own.turn, min(own.turn, d_psi))
    last[0], last[1], last[2] = x, y, psi


@inlined
def _lagged(lags, memory, target):
    """Return an axis's `SmoothReference` at the sample and advance its four lags to the next."""
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
        w_2 * w_2 * (-4.0 * d_1 + 6.0 * d_2 - 4.0 * d_3 + d_4),
    )


#: range of the settings: beyond it derivatives vanish in rounding or overflow
_LEAST, _MOST = 1e-12, 1e12


@parameter_class
class ReferenceShaping(Part):
    """Make a jump of the reference a motion of limited speed without overshoot.

    Replaces x, y [m] and psi [rad] of the reference, world frame, and their rates by smooth ones with four
    derivatives, which `FeedForward` uses. The defaults suit the thesis's robot: a step of 0.5 m is done to 1 mm after
    5 s and asks for a lean of 0.05 rad.

    InputError if a value is not from 1e-12 to 1e12.
    """

    label = "reference shaping"
    comment = (
        "References are made smooth: four lags for x, y and psi each, jumps limited in speed. A steady motion is not\n"
        "# lagged, nor one that bends within the acceleration limits."
    )
    record = ShapingRecord
    state = ShapingState

    frequency: float = parameter(
        "w of each of the four lags of x and y", "rad/s", default=3.0, least=_LEAST, most=_MOST
    )
    speed_limit: float = parameter(
        "speed of a jump over the floor", "m/s", default=0.5, least=_LEAST, most=_MOST
    )
    yaw_frequency: float = parameter(
        "w of each of the four lags of psi", "rad/s", default=3.0, least=_LEAST, most=_MOST
    )
    yaw_rate_limit: float = parameter("rate of a turn", "rad/s", default=1.0, least=_LEAST, most=_MOST)
    acceleration_limit: float = parameter(
        "beyond which a change of the reference's speed counts ever less as a bend",
        "m/s^2",
        default=0.2,
        least=_LEAST,
        most=_MOST,
    )
    yaw_acceleration_limit: float = parameter(
        "the same of a turn", "rad/s^2", default=0.4, least=_LEAST, most=_MOST
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
            speed=self.speed_limit * sample_time,
            turn=self.yaw_rate_limit * sample_time,
            kink=self.acceleration_limit * sample_time**2,
            turning_kink=self.yaw_acceleration_limit * sample_time**2,
            rate=1.0 / sample_time,
            delay=settings.delay,
            late=-math.expm1(-sample_time / _BEND_LAG),
        )
