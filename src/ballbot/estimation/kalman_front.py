"""The Kalman filter's front end, compiled: a reading becomes what the filter takes, and its state that of the robot.

A sample of a filter, a lane of a block's work array (`ballbot.estimation.kalman_model`), is `show`, `sample_block` and
`see`. Missing values (NaN) are predicted: the gyro stays as it was, encoders or attitude do not correct that sample.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from ballbot.arrays import Floats
from ballbot.estimation.kalman_model import (
    BIAS,
    COVARIANCE,
    DIAGONAL,
    FIRST,
    GYRO,
    GYRO_BEFORE,
    NUMBERS,
    PIVOTED_SHARE,
    PIVOTING,
    PIVOTING_SEEN,
    PIVOTING_SHARE,
    PIVOTING_VARIANCE,
    RADIUS,
    SHOWN,
    START_COVARIANCES,
    START_VARIANCES,
    STATE,
    TOGETHER,
    VARIANCES,
    WALK,
    G,
    S,
    X,
    lever_in,
    state_in,
)
from ballbot.estimation.known import are_known, is_known
from ballbot.estimation.onboard import ball_rate
from ballbot.estimation.swing import SwingTwist, begin_filter, robot_state, swing_of
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.lanes import LANES
from ballbot.records import MAX_WHEELS, number, schema_of, whole

_SPEED_VARIANCE = VARIANCES + FIRST["wheels"]  # of the ball by the wheels
_WHEELS, _AHRS, _FIX = SHOWN + FIRST["wheels"], SHOWN + FIRST["attitude"], FIRST["fix"]
#: values of `started`: no whole reading yet, the first one, and later
_NOT_STARTED, _BEGUN, _RUNNING = range(3)
#: over their deviations, Omega_z from which the ball pivots or a wheel slips, and the ball's speed beyond that expected
#: from which it is a slip. With 8 and 6, wheels that cross their play are taken to slip, and the heading is worse by a
#: third; with 16 and 8, half of a slip passes
_PIVOTS, _SLIPS = 12.0, 8.0
#: the part of that speed below which it must be without the wheel, and the factor in favour of the one before
_NEARER, _SAME = 0.8, 0.5
#: time over which the speed beyond that expected is averaged [s], and over its deviation that from which it is a push.
#: Without the mean, a robot that crosses its play chatters until it slips
_PUSH_TIME, _PUSHED = 0.02, 6.0
#: variance of Omega_z while a wheel slips [rad^2/s^2]
_UNKNOWN = 1e6


@dataclass(frozen=True, kw_only=True, eq=False)
class FilterMemory:
    """What a filter keeps from sample to sample beside its column of the work array."""

    started: int = field(metadata=whole())
    position: Floats = field(metadata=number("m", 2))  #: at which it starts
    missed: int = field(metadata=whole())  #: samples since the encoders last had all angles
    angles: Floats = field(metadata=number("rad", MAX_WHEELS))  #: of the wheels then
    speeds: Floats = field(metadata=number("rad/s", MAX_WHEELS))  #: their mean since the angles before
    gyro: Floats = field(metadata=number("rad/s", 3))
    #: lately, of the ball on the spot as the wheels have it
    pivoting: float = field(metadata=number("rad/s"))
    pivoted: float = field(metadata=number("rad^2/s^2"))  #: mean of its squares
    faster: Floats = field(metadata=number("m/s", 2))  #: lately, the ball by the wheels than expected
    slipping: int = field(metadata=whole())  #: 1 + the number of the wheel that slips, else 0


FILTER_MEMORY = schema_of(FilterMemory)
FILTER_MEMORY_TYPE = FILTER_MEMORY.dtype()


@inlined
def _place(row, lane):
    """Return where a block's work array has a row of a lane."""
    return row * LANES + lane


@inlined
def _put(filters, row, lane, complete, numbers):
    """Give a filter three numbers of a sensor, NaN if they are missing."""
    first, second, third = numbers
    filters[_place(row, lane)] = first if complete else math.nan
    filters[_place(row + 1, lane)] = second if complete else math.nan
    filters[_place(row + 2, lane)] = third if complete else math.nan


@inlined
def reset_filter(memory, position):
    """Forget the past; the robot stands still at a position x, y [m] when the next reading comes."""
    memory.started = memory.missed = 0
    memory.pivoting = memory.pivoted = 0.0
    memory.slipping = 0
    for k in range(2):
        memory.faster[k] = 0.0
        memory.position[k] = position[k]


@inlined
def _begin(row, filters, lane, memory):
    """Start a filter at the first whole reading, which it was shown."""
    for i in range(GYRO_BEFORE):
        filters[_place(i, lane)] = row[i] if i < VARIANCES + _FIX else 0.0
    for i in range(len(DIAGONAL)):
        filters[_place(COVARIANCE + DIAGONAL[i], lane)] = row[START_VARIANCES + i]
    for i in range(len(TOGETHER)):
        filters[_place(COVARIANCE + TOGETHER[i], lane)] = row[START_COVARIANCES + i]
    x, seen = filters[_place(STATE, lane) :: LANES], filters[_place(_AHRS, lane) :: LANES]
    begin_filter(lever_in(filters, lane), SwingTwist(seen[0], seen[1], seen[2]), memory.gyro, x)
    x[X], x[X + 1] = memory.position[0], memory.position[1]
    for i in range(NUMBERS):
        filters[_place(SHOWN + i, lane)] = math.nan


class Turning(NamedTuple):
    """An angular velocity, or a part of one [rad/s]."""

    x: float
    y: float
    z: float


@inlined
def _levelled(lean, of):
    """Return M(g) of a vector; `lean` has g."""
    g_x, g_y, g_z = lean
    share = (g_x * of[0] + g_y * of[1]) / (1.0 + g_z) + of[2]
    return Turning(of[0] - g_x * share, of[1] - g_y * share, g_x * of[0] + g_y * of[1] + g_z * of[2])


@inlined
def _turned_by(ball_from_wheels, wheel):
    """Return how a wheel's turning turns the ball relative to the body: T_obw e_i."""
    return Turning(ball_from_wheels[0, wheel], ball_from_wheels[1, wheel], ball_from_wheels[2, wheel])


@inlined
def _without_slip(row, filters, lane, memory, ball_from_wheels, n, turned):
    """Return the ball's turning relative to the body without that of a wheel that slips; see a push, too.

    A wheel that slips by sigma seems to turn the ball by T_obw e_i sigma more. A rolling ball does not pivot, so
    Omega_z gives each wheel's sigma, and that wheel slips without which the ball's speed is nearest to the one
    expected. Where the ball pivots, its speed is near that with all of them. A push leaves Omega_z as it is.
    """
    x, lever, radius = state_in(filters, lane), lever_in(filters, lane), row[RADIUS]
    w = (memory.gyro[0] - x[BIAS], memory.gyro[1] - x[BIAS + 1], memory.gyro[2] - x[BIAS + 2])
    lean = (x[G], x[G + 1], math.sqrt(max(1.0 - x[G] * x[G] - x[G + 1] * x[G + 1], 1e-6)))
    ball = _levelled(lean, (turned.x + w[0], turned.y + w[1], turned.z + w[2]))
    # by how much the ball is faster than expected, forward and to the left [m/s]
    forward = radius * ball.y - (x[S] - lever[0][0] * w[0] - lever[0][1] * w[1] - lever[0][2] * w[2])
    left = -radius * ball.x - (x[S + 1] - lever[1][0] * w[0] - lever[1][1] * w[1] - lever[1][2] * w[2])
    deviation = math.sqrt(row[_SPEED_VARIANCE])
    pivots = abs(ball.z) > _PIVOTS * math.sqrt(
        row[VARIANCES + PIVOTING_SEEN] + row[PIVOTING_VARIANCE] * memory.pivoted
    )
    slips = pivots and math.hypot(forward, left) > _SLIPS * deviation
    least, least_forward, least_left, slip = _NEARER * math.hypot(forward, left), forward, left, 0.0
    before, memory.slipping = memory.slipping, 0
    for i in range(n if slips else 0):
        by = _levelled(lean, _turned_by(ball_from_wheels, i))
        speed = ball.z / by.z
        without_x, without_y = forward - radius * speed * by.y, left + radius * speed * by.x
        size = math.hypot(without_x, without_y) * (_SAME if before == i + 1 else 1.0)
        if size < least:
            least, least_forward, least_left, slip, memory.slipping = size, without_x, without_y, speed, i + 1
    share = min(row[0] / _PUSH_TIME, 1.0)
    memory.faster[0] += share * (least_forward - memory.faster[0])
    memory.faster[1] += share * (least_left - memory.faster[1])
    push = math.hypot(memory.faster[0], memory.faster[1])
    if push < _PUSHED * deviation or (pivots and memory.slipping == 0):  # which wheel slips is not yet known
        push = 0.0
    for k in range(2):
        filters[_place(WALK + S + k, lane)] = row[WALK + S + k] + push * push
    by = _turned_by(ball_from_wheels, max(memory.slipping - 1, 0))
    return Turning(turned.x - slip * by.x, turned.y - slip * by.y, turned.z - slip * by.z)


@inlined
def show(row, filters, lane, memory, ball_from_wheels, reading):
    """Give a filter what a reading shows, from the first whole one on; `row` is a record of `KALMAN`."""
    n, leans = len(reading.wheel_angles), are_known(reading.attitude, 3)
    turned = are_known(reading.wheel_angles, n)
    if memory.started == _NOT_STARTED:
        if not (turned and leans and are_known(reading.gyro, 3)):
            return
        memory.started = _BEGUN
    for i in range(3):
        if is_known(reading.gyro[i]):
            memory.gyro[i] = reading.gyro[i]
        filters[_place(GYRO + i, lane)] = memory.gyro[i]
    passed = row[0] * (1 + memory.missed)
    for i in range(n if turned else 0):
        memory.speeds[i] = (reading.wheel_angles[i] - memory.angles[i]) / passed
        memory.angles[i] = reading.wheel_angles[i]
    # the more the ball lately turned on the spot by the wheels, the less they correct the heading
    pivoted = row[PIVOTING_VARIANCE] * memory.pivoted
    rate = ball_rate(ball_from_wheels, n, memory.speeds)
    ball = Turning(rate[0], rate[1], rate[2])
    if turned and memory.started == _RUNNING:
        ball = _without_slip(row, filters, lane, memory, ball_from_wheels, n, ball)
    _put(filters, _WHEELS, lane, turned, ball)
    _put(filters, _AHRS, lane, leans, swing_of(reading.attitude[0], reading.attitude[1], reading.attitude[2]))
    if memory.slipping > 0:
        pivoted = _UNKNOWN
    filters[_place(VARIANCES + PIVOTING_SEEN, lane)] = row[VARIANCES + PIVOTING_SEEN] + pivoted
    memory.missed = 0 if turned else memory.missed + 1


@inlined
def see(row, filters, lane, memory, state):
    """Fill the robot's state (10,) after a sample of the filter, all NaN before a whole reading."""
    if memory.started == _NOT_STARTED:
        for i in range(10):
            state[i] = math.nan
        return
    if memory.started == _BEGUN:
        _begin(row, filters, lane, memory)  # here: `sample_block` moves all filters of a block on
    elif memory.missed == 0 and memory.slipping == 0:
        memory.pivoting += row[PIVOTING_SHARE] * (filters[_place(PIVOTING, lane)] - memory.pivoting)
        memory.pivoted += row[PIVOTED_SHARE] * (memory.pivoting * memory.pivoting - memory.pivoted)
    memory.started = _RUNNING
    for i in range(3):
        filters[_place(GYRO_BEFORE + i, lane)] = memory.gyro[i]
    robot_state(lever_in(filters, lane), state_in(filters, lane), memory.gyro, state)
