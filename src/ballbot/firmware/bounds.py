"""Bounds of the firmware's parameters: one table, which Python evaluates and of which the check in C is written
(`tests.support.firmware_headers`).

`ballbot_refused` of the C library returns 0 for parameters that it takes, a number of `Refusal`, or `FIRST_BOUND` and
the row of the table that is violated. A NaN violates every bound.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.part import MAX_PAST
from ballbot.control.tuning import MAX_GAINS
from ballbot.errors import InputError
from ballbot.records import MAX_WHEELS


class Refusal(IntEnum):
    """Why the firmware refuses parameters, except for a bound."""

    SCHEMA = 1  #: they are records of another version
    POLICY = 2  #: their policy has other weights than the firmware
    ROBOT = 3  #: they have another number of wheels or another sample time than the robot's


#: what `ballbot_refused` returns for the first row of the table
FIRST_BOUND = 4

_SENTENCES: dict[int, str] = {
    Refusal.SCHEMA: "they are of another version; export them again",
    Refusal.POLICY: "a learned policy's need a firmware with its weights, which `ballbot export` writes",
    Refusal.ROBOT: "they are for another number of wheels or another sample time",
}


@dataclass(frozen=True)
class Bound:
    """Least and most value of a parameter; a text is the parameter whose value bounds it."""

    field: str  #: dotted, in `PARAMETERS`
    least: float | str
    most: float | str | None = None  #: none for a limit that may be switched off by an infinite number


#: of every parameter that the C code divides by, counts with, or relies on for a torque to be limited
BOUNDS = (
    Bound("wheel_count", 3, MAX_WHEELS),  # records have room for
    Bound("estimator", 0, 1),  # on-board or Kalman
    Bound("sample_time", 1e-6, 1.0),  # from a tick of the clock [s]
    Bound("encoder_step", 1e-9, 6.2831855),  # a turn has a count or more, [rad]
    Bound("law.torque_limit", 1e-6, 1000.0),  # that of a robot file's motors
    Bound("self_test.torque", 1e-6, 1000.0),
    Bound("self_test.ramp", 1, 100_000),  # twice this fits whatever the sample time
    Bound("self_test.counts", 1, 2**30),  # a difference of counts has 31 bits
    Bound("safety.lean", 1e-3),  # a standing robot leans by its IMU's offset
    Bound("safety.lean", "law.lean_limit.lean"),  # the controller may ask for that lean
    Bound("safety.max_interval", "sample_time"),  # or every sample is late
    Bound("safety.max_missing", 0),
    Bound("safety.max_unchanged", 0),
    Bound("safety.turning_torque", 0.0, "law.torque_limit"),  # or a wheel that is stuck is never found
    Bound("law.tuning.others", 0, MAX_GAINS - 1),
    Bound("law.planner.every", "law.planner.on", 1_000),
    Bound("law.prediction.count", 0, MAX_PAST - 2),
    Bound("law.prediction.samples", 0, MAX_PAST - 2),
)


def _value(record: NDArray[np.void], bound: float | str) -> float:
    """Return a parameter's value, or a bound as the firmware has it."""
    if not isinstance(bound, str):
        return float(np.float32(bound))
    value = record[0]
    for name in bound.split("."):
        value = value[name]
    return float(value)


def violated_bound(record: NDArray[np.void]) -> int | None:
    """Return the first row of `BOUNDS` that parameters (1,) in single precision violate; None without one."""
    for row, bound in enumerate(BOUNDS):
        value = _value(record, bound.field)
        most = bound.most is None or value <= _value(record, bound.most)
        if not (value >= _value(record, bound.least) and most):
            return row
    return None


def bound_clause(record: NDArray[np.void], row: int) -> str:
    """Return which parameter (of a record (1,)) violates a row of `BOUNDS`, its value and its bound."""
    bound = BOUNDS[row]
    value, least = _value(record, bound.field), _value(record, bound.least)
    is_low = not value >= least
    beyond = bound.least if is_low else bound.most
    assert beyond is not None
    limit = f"{_value(record, beyond):.6g}" + (f" ({beyond})" if isinstance(beyond, str) else "")
    return f"{bound.field} is {value:.6g}; it must be at {'least' if is_low else 'most'} {limit}"


def refusal_clause(record: NDArray[np.void], code: int) -> str:
    """Return why a robot refuses parameters (1,), by what `ballbot_refused` gave."""
    if 0 <= code - FIRST_BOUND < len(BOUNDS):
        return bound_clause(record, code - FIRST_BOUND)
    return _SENTENCES.get(code, "it gives no reason")


def check_bounds(record: NDArray[np.void]) -> None:
    """Raise InputError if parameters (1,) in single precision are beyond their bounds."""
    row = violated_bound(record)
    if row is not None:
        raise InputError(f"The firmware would refuse these parameters: {bound_clause(record, row)}.")
