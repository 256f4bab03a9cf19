"""The Kalman filter's front end, compiled: a reading becomes what the filter takes, and its state that of the robot.

A sample of a filter, a lane of a block's work array (`ballbot.estimation.kalman_model`), is `show`, `sample_block` and
`see`. Missing values (NaN) are predicted: the gyro stays as it was, encoders or attitude do not correct that sample.
"""

import math
from dataclasses import dataclass, field

from ballbot.arrays import Floats
from ballbot.estimation.kalman_model import (
    COVARIANCE,
    DIAGONAL,
    FIRST,
    GYRO,
    GYRO_BEFORE,
    KALMAN_TYPE,
    NUMBERS,
    PIVOTED_SHARE,
    PIVOTING,
    PIVOTING_SEEN,
    PIVOTING_SHARE,
    PIVOTING_VARIANCE,
    SHOWN,
    START_COVARIANCES,
    START_VARIANCES,
    STATE,
    TOGETHER,
    VARIANCES,
    S,
    X,
    lever_in,
    state_in,
)
from ballbot.estimation.known import are_known, is_known
from ballbot.estimation.onboard import ball_rate
from ballbot.estimation.slip import SLIP, without_slip
from ballbot.estimation.swing import SwingTwist, begin_filter, robot_state, swing_of
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.lanes import LANES
from ballbot.records import MAX_WHEELS, Schema, number, schema_of, whole

_WHEELS, _AHRS, _FIX = SHOWN + FIRST["wheels"], SHOWN + FIRST["attitude"], FIRST["fix"]
#: values of `started`: no whole reading yet, the first one, and later
_NOT_STARTED, _BEGUN, _RUNNING = range(3)


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


FILTER_MEMORY = Schema(name="filter_memory", fields={**schema_of(FilterMemory).fields, "slip": SLIP})
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
    memory.slip.left_out = memory.slip.lasting = 0.0
    for k in range(2):
        memory.slip.faster[k] = 0.0
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
    ball = ball_rate(ball_from_wheels, n, memory.speeds)
    if turned and memory.started == _RUNNING:
        record, x = row.view(KALMAN_TYPE)[0], state_in(filters, lane)
        ball = without_slip(record, memory.slip, memory.pivoted, x, memory.gyro, ball)
        for k in range(2):
            filters[_place(COVARIANCE + DIAGONAL[S + k], lane)] += memory.slip.unknown
    _put(filters, _WHEELS, lane, turned, ball)
    _put(filters, _AHRS, lane, leans, swing_of(reading.attitude[0], reading.attitude[1], reading.attitude[2]))
    # the more the ball lately turned on the spot by the wheels, the less they correct the heading
    pivoted = row[PIVOTING_VARIANCE] * memory.pivoted
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
    elif is_known(filters[_place(PIVOTING, lane)]):
        memory.pivoting += row[PIVOTING_SHARE] * (filters[_place(PIVOTING, lane)] - memory.pivoting)
        memory.pivoted += row[PIVOTED_SHARE] * (memory.pivoting * memory.pivoting - memory.pivoted)
    memory.started = _RUNNING
    for i in range(3):
        filters[_place(GYRO_BEFORE + i, lane)] = memory.gyro[i]
    robot_state(lever_in(filters, lane), state_in(filters, lane), memory.gyro, state)
