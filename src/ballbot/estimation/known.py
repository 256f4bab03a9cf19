"""A reading in compiled code, and what both estimators ask of it."""

import math
from typing import NamedTuple

from ballbot.arrays import Floats
from ballbot.mechanics.engine.compiled import inlined

#: a larger value is not a valid measurement: angles [rad], speeds [rad/s]
LARGEST_READING = 1e6


class Shown(NamedTuple):
    """The parts of a `Reading` that come every sample; a value that is missing is NaN."""

    wheel_angles: Floats
    wheel_speeds: Floats
    gyro: Floats
    attitude: Floats


@inlined
def not_a_number():
    """Return NaN, which stands for what is not known."""
    return math.nan


@inlined
def is_known(value):
    """Return whether a sensor's value is valid: a number, and within a sensor's range."""
    return abs(value) <= LARGEST_READING


@inlined
def are_known(values, count):
    """Return whether all of a sensor's values are valid."""
    for i in range(count):  # noqa: SIM110 (compiled code has no generators)
        if not is_known(values[i]):
            return False
    return True
