"""Wheels that slip, and pushes: what the Kalman filter sees before it takes in what the wheels show.

A wheel that slips on the ball seems to turn it about the vertical, about which the ball hardly pivots, and to move it
faster than lean and momentum let expect. From then on the wheels are left out, until the ball has not pivoted for a
while: which of them slip changes from sample to sample, two often slip together, and the ball pivots under them. The
momentum stays known from the lean but for what a push gave it just before or meanwhile, so it becomes unknown by that
much; the filter knows position and momentum together, and once the wheels roll again they correct both. A push changes
the speed and leaves Omega_z as it is: the wheels are then followed at once.

Two wheels that slip such that Omega_z stays zero look like a push, and a ball that slides on the floor is not seen. The
firmware's C is written from this file (`tests.support.firmware_law`).
"""

from dataclasses import dataclass, field

from ballbot.arrays import Floats
from ballbot.estimation.kalman_model import BIAS, PIVOTING_SEEN, G, S
from ballbot.estimation.known import not_a_number
from ballbot.estimation.onboard import AngularVelocity
from ballbot.estimation.swing import lever_speed, root_of
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import number, schema_of

#: over their deviations, Omega_z and the ball's speed beyond that expected from which wheels slip. Play of 2 degrees
#: makes both 12 by itself at times, on ordinary courses; with more of either a part of a slip passes
PIVOTS, SLIPS = 14.0, 14.0
#: time without slip after which the wheels count again, and the longest for which they are left out [s]: after pushes
#: they slip for up to half a second, by turns. With 25 ms a part of a slip passes; 100 ms miss too much of a push
_STEADY, _LONGEST = 0.04, 1.0
#: by which pushes change the momentum while the wheels are left out [m/s/sqrt(s)]
_UNSEEN_PUSH = 0.4
#: time over which the speed beyond that expected is averaged [s], and over its deviation that from which it is a push.
#: Without the mean, a robot chatters through its play after a push until its wheels slip. Wheels with 1.6 degrees of
#: play make it 8 by themselves on ordinary courses; with 6 such a robot chattered until its wheels slipped
_PUSH_TIME, _PUSHED = 0.02, 12.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipMemory:
    """What is known of slip and pushes; zeros at the start."""

    left_out: float = field(metadata=number("s"))  #: for how long the wheels still do not count
    lasting: float = field(metadata=number("s"))  #: for how long they have not
    #: by which the momentum's variance grows
    unknown: float = field(metadata=number("m^2/s^2"))
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
def without_slip(record, memory, pivoted, x, gyro, turned):
    """Return the ball's turning relative to the body [rad/s], NaN while wheels slip; the memory has what was seen.

    `turned` is that by all wheels, `pivoted` the mean square of its pivoting lately, x the filter's state before the
    sample, and gyro (3) [rad/s] at its end.
    """
    h, deviation = record.sample_time, record.variances[0] ** 0.5
    w_x, w_y, w_z = gyro[0] - x[BIAS], gyro[1] - x[BIAS + 1], gyro[2] - x[BIAS + 2]
    ball = _levelled(x[G], x[G + 1], turned.x + w_x, turned.y + w_y, turned.z + w_z)
    forward = record.radius * ball.y - (x[S] - lever_speed(record.lever, 0, w_x, w_y, w_z))
    left = -record.radius * ball.x - (x[S + 1] - lever_speed(record.lever, 1, w_x, w_y, w_z))
    of_pivoting = (record.variances[PIVOTING_SEEN] + record.pivoting_variance * pivoted) ** 0.5
    memory.unknown = 0.0
    slips = memory.lasting > 0.0 or _size(forward, left) > SLIPS * deviation
    if slips and abs(ball.z) > PIVOTS * of_pivoting and memory.lasting < _LONGEST - 0.5 * h:
        if memory.lasting == 0.0:
            # what a push gave that was not one yet, and what of the slip was taken in
            hidden = (_PUSHED + SLIPS) * deviation
            memory.unknown = hidden * hidden
        memory.left_out = _STEADY
    if memory.left_out > 0.5 * h:
        memory.left_out -= h
        memory.lasting += h
        memory.unknown += _UNSEEN_PUSH * _UNSEEN_PUSH * h
        memory.faster[0], memory.faster[1] = 0.0, 0.0
        nothing = not_a_number()
        return AngularVelocity(nothing, nothing, nothing)
    memory.lasting = 0.0
    share = min(h / _PUSH_TIME, 1.0)
    memory.faster[0] += share * (forward - memory.faster[0])
    memory.faster[1] += share * (left - memory.faster[1])
    push = _size(memory.faster[0], memory.faster[1])
    if push > _PUSHED * deviation:
        memory.unknown = push * push
    return turned
