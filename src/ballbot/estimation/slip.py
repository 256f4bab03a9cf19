"""Wheels that slip, and pushes: what the Kalman filter sees before it takes in what the wheels show.

A wheel that slips on the ball by sigma seems to turn the ball by T_obw e_i sigma more than it turns. The ball rolls
without pivoting, so from Omega_z each wheel has one sigma that it would slip by; the wheel is taken to slip without
which the ball's speed is nearest to the one expected by lean and momentum. If the ball does pivot, its speed is
near that with all wheels. A push changes the speed and leaves Omega_z as it is.

What one wheel slips by is taken off, Omega_z shows nothing then, and a push makes the momentum unknown by so much. Two
wheels that slip, or a ball that slides on the floor, look like one or a push. The firmware's C is written from this
file (`tests.support.firmware_law`).
"""

from dataclasses import dataclass, field

from ballbot.arrays import Floats
from ballbot.estimation.kalman_model import BIAS, PIVOTING_SEEN, G, S
from ballbot.estimation.onboard import AngularVelocity
from ballbot.estimation.swing import lever_speed, root_of
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import number, schema_of, whole

#: over their deviations, Omega_z from which the ball pivots or a wheel slips, and the ball's speed beyond that expected
#: from which it is a slip. With 8 and 6, wheels that cross their play are taken to slip, and the heading is worse by a
#: third on the square; with 16 and 8, a part of a slip passes
_PIVOTS, _SLIPS = 12.0, 8.0
#: the part of that speed below which it must be without the wheel, and a factor in favour of the wheel before
_NEARER, _SAME = 0.8, 0.5
#: time over which the speed beyond that expected is averaged [s], and over its deviation that from which it is a push.
#: Without the mean, a robot chatters through its play after a push until its wheels slip. Wheels with 1.6 degrees of
#: play make it 8 by themselves on ordinary courses; with 6 such a robot chattered until its wheels slipped
_PUSH_TIME, _PUSHED = 0.02, 12.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipMemory:
    """What is known of slip and pushes; zeros at the start."""

    wheel: int = field(metadata=whole())  #: 1 + the number of the wheel that slips, else 0
    push: float = field(metadata=number("m/s"))  #: by which the speed is unknown after a push, else 0
    #: mean speed of the ball, forward and to the left, beyond that expected
    faster: Floats = field(metadata=number("m/s", 2))


SLIP = schema_of(SlipMemory)


@inlined
def _levelled(g_x, g_y, x, y, z):
    """Return M(g) of a vector, level in the heading frame."""
    g_z = root_of(1.0 - g_x * g_x - g_y * g_y)
    share = (g_x * x + g_y * y) / (1.0 + g_z) + z
    return AngularVelocity(x - g_x * share, y - g_y * share, g_x * x + g_y * y + g_z * z)


@inlined
def _size(x, y):
    """Return a speed from its components [m/s]."""
    return (x * x + y * y) ** 0.5


@inlined
def without_slip(record, memory, pivoted, x, gyro, turned, n):
    """Return the ball's turning relative to the body less what a wheel slips by [rad/s]; the memory has what was seen.

    `turned` is that by all n wheels, `pivoted` the mean square of its pivoting lately, x the filter's state before the
    sample, and gyro (3) [rad/s] at its end.
    """
    w_x, w_y, w_z = gyro[0] - x[BIAS], gyro[1] - x[BIAS + 1], gyro[2] - x[BIAS + 2]
    ball = _levelled(x[G], x[G + 1], turned.x + w_x, turned.y + w_y, turned.z + w_z)
    forward = record.radius * ball.y - (x[S] - lever_speed(record.lever, 0, w_x, w_y, w_z))
    left = -record.radius * ball.x - (x[S + 1] - lever_speed(record.lever, 1, w_x, w_y, w_z))
    deviation = record.variances[0] ** 0.5
    of_pivoting = (record.variances[PIVOTING_SEEN] + record.pivoting_variance * pivoted) ** 0.5
    pivots, before = abs(ball.z) > _PIVOTS * of_pivoting, memory.wheel
    least, slip, first, second = _NEARER * _size(forward, left), 0.0, forward, left
    memory.wheel = 0
    candidates = n if pivots and _size(forward, left) > _SLIPS * deviation else 0
    for i in range(candidates):
        by = _levelled(x[G], x[G + 1], record.ball_turn[0][i], record.ball_turn[1][i], record.ball_turn[2][i])
        speed = ball.z / by.z
        others_forward = forward - record.radius * speed * by.y
        others_left = left + record.radius * speed * by.x
        off = _size(others_forward, others_left) * (_SAME if before == i + 1 else 1.0)
        if off < least:
            least, slip, first, second = off, speed, others_forward, others_left
            memory.wheel = i + 1
    share = min(record.sample_time / _PUSH_TIME, 1.0)
    memory.faster[0] += share * (first - memory.faster[0])
    memory.faster[1] += share * (second - memory.faster[1])
    push = _size(memory.faster[0], memory.faster[1])
    unclear = pivots and memory.wheel == 0  # which wheel slips
    memory.push = 0.0 if push < _PUSHED * deviation or unclear else push
    if memory.wheel == 0:
        return turned
    wheel = memory.wheel - 1
    return AngularVelocity(
        turned.x - slip * record.ball_turn[0][wheel],
        turned.y - slip * record.ball_turn[1][wheel],
        turned.z - slip * record.ball_turn[2][wheel],
    )
