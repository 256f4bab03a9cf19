"""Shaped references: a jump becomes a smooth motion that the robot can follow without saturating.

For x, y and psi alike, the reference r passes

    a limit of speed      p follows r by no more than the limit a second, x and y together in a straight line
    four equal lags       s_1' = w (p* - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4

so that s has four derivatives, which the feed-forward needs, and never overshoots a step. A reference that moves
within the limit of speed is no jump, and one whose velocity changes within the limit of acceleration has no kink;

    p* = p + (4/w + tau) r' + (6/w^2 + 4 tau/w + tau^2/2) r''

then takes away what the lags, and a delay tau that is predicted over, cost: at constant acceleration all of it. r''
counts in full within the limit of acceleration, ever less up to twice as much, and late by `_BEND_LAG`: the digits of
a reference that was rounded are no bends. With
p* held over a sample of h, d_i = s_i - p* and g = w h, the lags are stepped exactly:

    d_i(h) = exp(-g) (d_i + g d_(i-1) + g^2/2 d_(i-2) + g^3/6 d_(i-3))
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import compiled, inlined

#: numbers of a shaping beyond which its derivatives are lost in rounding or overflow
_LEAST, _MOST = 1e-12, 1e12


@dataclass(frozen=True, kw_only=True)
class ReferenceShaping:
    """How references are smoothed.

    The defaults suit the thesis's robot: a step of 0.5 m is done to 1 mm after 5 s and asks for a lean of 0.05 rad.

    Raises
    ------
    InputError
        If a value is not from 1e-12 to 1e12.
    """

    frequency: float = 3.0  #: w of each of the four lags of x and y [rad/s]
    speed_limit: float = 0.5  #: of a jump's way over the floor [m/s]
    yaw_frequency: float = 3.0  #: w of each of the four lags of psi [rad/s]
    yaw_rate_limit: float = 1.0  #: of a turn [rad/s]
    acceleration_limit: float = 0.2  #: beyond which a change of r' is ever more of a kink [m/s^2]
    yaw_acceleration_limit: float = 0.4  #: the same of a turn [rad/s^2]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not _LEAST <= value <= _MOST:
                raise InputError(
                    f"{field.name} of the reference shaping is {value:g}; it must be from {_LEAST:g} to {_MOST:g}."
                )


#: lag of the bends [s]
_BEND_LAG = 0.05


class Lags(NamedTuple):
    """One axis's lags over a sample, in compiled code."""

    frequency: float  #: w [rad/s]
    decay: float  #: exp(-w h)
    step: float  #: g = w h


class Shaping(NamedTuple):
    """A shaping's numbers, in compiled code."""

    place: Lags
    heading: Lags
    speed: float  #: how far p may go in a sample [m]
    turn: float  #: the same of psi [rad]
    kink: float  #: how much more it may go than in the last [m]
    turning_kink: float  #: the same of psi [rad]
    rate: float  #: samples a second [1/s]
    delay: float  #: that is predicted over [s]
    late: float  #: part of the way that a bend's lag goes in a sample


class Smooth(NamedTuple):
    """One axis's shaped reference, in compiled code."""

    value: float
    rate: float
    second: float
    third: float
    fourth: float


#: numbers that `pack_shaping` returns
SHAPING_SIZE = 11
#: numbers that it remembers: four lags, p and the last r for each of x, y and psi; whether it has started; the last
#: change of r, and of that the change that counts
SHAPING_MEMORY = 25


def pack_shaping(shaping: ReferenceShaping | None, sample_time: float, *, delay: float = 0.0) -> list[float]:
    """Return the numbers that `load_shaping` reads; all zero where there is none. `delay` [s] is predicted over."""
    if shaping is None:
        return [0.0] * SHAPING_SIZE
    return [
        shaping.frequency,
        math.exp(-shaping.frequency * sample_time),
        shaping.yaw_frequency,
        math.exp(-shaping.yaw_frequency * sample_time),
        shaping.speed_limit * sample_time,
        shaping.yaw_rate_limit * sample_time,
        shaping.acceleration_limit * sample_time**2,
        shaping.yaw_acceleration_limit * sample_time**2,
        1.0 / sample_time,
        delay,
        -math.expm1(-sample_time / _BEND_LAG),
    ]


def shape_references(
    shaping: ReferenceShaping, references: ArrayLike, sample_time: float
) -> NDArray[np.float64]:
    """Return x, y and psi of references (N, 10), shaped, each with four derivatives (N, 3, 5), from the first on.

    Raises
    ------
    InputError
        If the references are not rows of ten finite numbers, or the sample time [s] is not above zero.
    """
    rows = real_array(references, ("N", 10), "The array of references")
    smooth = np.empty((len(rows), 3, 5))
    packed = pack_shaping(shaping, positive_number(sample_time, "The sample time"))
    _shape_all(np.array(packed), rows, smooth)
    return smooth


@compiled
def _shape_all(row, references, smooth):
    memory = np.zeros(SHAPING_MEMORY)
    S = load_shaping(row, 0)
    for k in range(len(references)):
        x, y, psi = shaped(S, memory, references[0], references[k])
        for i in range(5):
            smooth[k, 0, i], smooth[k, 1, i], smooth[k, 2, i] = x[i], y[i], psi[i]


@inlined
def load_shaping(row, place):
    """Return the `Shaping` at that place of a row."""
    rate = row[place + 8]
    return Shaping(
        Lags(row[place], row[place + 1], row[place] / rate),
        Lags(row[place + 2], row[place + 3], row[place + 2] / rate),
        row[place + 4],
        row[place + 5],
        row[place + 6],
        row[place + 7],
        rate,
        row[place + 9],
        row[place + 10],
    )


@inlined
def shaped(S, memory, state, reference):
    """Return the shaped x, y and psi as three `Smooth`, and step the memory (25,) on; they start at the pose."""
    if memory[18] == 0.0:
        _start(memory, state, reference)
    x, y, psi = reference[0], reference[1], reference[4]
    d_x, d_y, d_psi = x - memory[15], y - memory[16], psi - memory[17]
    n_x, n_y, n_psi = d_x - memory[19], d_y - memory[20], d_psi - memory[21]
    moves, turns = d_x * d_x + d_y * d_y <= S.speed * S.speed, abs(d_psi) <= S.turn
    bends, veers = _share((n_x * n_x + n_y * n_y) ** 0.5 / S.kink), _share(abs(n_psi) / S.turning_kink)
    memory[22] += S.late * (bends * n_x - memory[22])
    memory[23] += S.late * (bends * n_y - memory[23])
    memory[24] += S.late * (veers * n_psi - memory[24])
    lead_x = _lead(S, S.place, d_x, memory[22], moves)
    lead_y = _lead(S, S.place, d_y, memory[23], moves)
    lead_psi = _lead(S, S.heading, d_psi, memory[24], turns)
    _follow(S, memory, x, y, psi)
    memory[19], memory[20], memory[21] = d_x, d_y, d_psi
    return (
        _lagged(S.place, memory, 0, memory[12] + lead_x),
        _lagged(S.place, memory, 4, memory[13] + lead_y),
        _lagged(S.heading, memory, 8, memory[14] + lead_psi),
    )


@inlined
def _start(memory, state, reference):
    x, y, psi = state[0], state[1], state[4]
    for i in range(4):
        memory[i], memory[4 + i], memory[8 + i] = x, y, psi
    memory[12], memory[13], memory[14] = x, y, psi
    memory[15], memory[16], memory[17] = reference[0], reference[1], reference[4]
    memory[18] = 1.0


@inlined
def _share(size):
    """Return how much of a bend counts, whose size is over the limit's."""
    return max(0.0, min(1.0, 2.0 - size))


@inlined
def _lead(S, lags, change, bend, moves):
    """Return how far p* is ahead of p for the reference's change in a sample, and that change's own, if any counts."""
    w, tau, rate = lags.frequency, S.delay, S.rate
    lead = (4.0 / w + tau) * rate * change
    curve = (6.0 / (w * w) + 4.0 * tau / w + 0.5 * tau * tau) * rate * rate * bend
    return lead + curve if moves else 0.0


@inlined
def _follow(S, memory, x, y, psi):
    """Let p go towards r within the limits, and remember r."""
    d_x, d_y, d_psi = x - memory[12], y - memory[13], psi - memory[14]
    distance = (d_x * d_x + d_y * d_y) ** 0.5
    share = S.speed / distance if distance > S.speed else 1.0
    memory[12] += share * d_x
    memory[13] += share * d_y
    memory[14] += max(-S.turn, min(S.turn, d_psi))
    memory[15], memory[16], memory[17] = x, y, psi


@inlined
def _lagged(lags, memory, first, target):
    """Return an axis's `Smooth` at the sample and step its four lags on to the next."""
    w, a, g = lags.frequency, lags.decay, lags.step
    d_1, d_2 = memory[first] - target, memory[first + 1] - target
    d_3, d_4 = memory[first + 2] - target, memory[first + 3] - target
    half, sixth = 0.5 * g * g, g * g * g / 6.0
    memory[first] = target + a * d_1
    memory[first + 1] = target + a * (d_2 + g * d_1)
    memory[first + 2] = target + a * (d_3 + g * d_2 + half * d_1)
    memory[first + 3] = target + a * (d_4 + g * d_3 + half * d_2 + sixth * d_1)
    w_2 = w * w
    return Smooth(
        target + d_4,
        w * (d_3 - d_4),
        w_2 * (d_2 - 2.0 * d_3 + d_4),
        w_2 * w * (d_1 - 3.0 * d_2 + 3.0 * d_3 - d_4),
        w_2 * w_2 * (-4.0 * d_1 + 6.0 * d_2 - 4.0 * d_3 + d_4),
    )
