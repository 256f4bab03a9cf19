"""The readings that the firmware takes, as records, and what its Kalman filter remembers.

The numbers of both estimators, and the memory of the on-board state, are the records of `ballbot.estimation`. A memory
is zero at the start, which is a robot at (0, 0).
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import Floats, Ints
from ballbot.estimation.interface import Reading
from ballbot.estimation.kalman_model import DIRECT, STATES
from ballbot.estimation.slip import SLIP
from ballbot.records import MAX_WHEELS, Number, Precision, Schema, number, schema_of, whole
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadingRecord:
    """The readings of all sensors at one instant; a value that is missing is NaN."""

    encoders_valid: int = field(metadata=whole())  #: whether the counts are there
    wheel_counts: Ints = field(metadata=whole(MAX_WHEELS))  #: of the encoders; may wrap around
    wheel_speeds: Floats = field(metadata=number("rad/s", MAX_WHEELS))
    gyro: Floats = field(metadata=number("rad/s", 3))  #: body frame
    attitude: Floats = field(metadata=number("rad", 3))  #: theta, phi, psi; psi may begin again after a turn
    fix_position: Floats = field(metadata=number("m", 2))  #: world frame
    fix_heading: float = field(metadata=number("rad"))
    fix_position_deviation: float = field(metadata=number("m"))  #: standard deviation
    fix_heading_deviation: float = field(metadata=number("rad"))  #: standard deviation


_READING = schema_of(ReadingRecord)
_SHOWN: dict[str, Number | Schema] = {
    sensor.name: Number(unit=sensor.units, shape=(len(sensor.states),)) for sensor in DIRECT
}
#: with what the Kalman filter's further sensors show
READING = replace(_READING, fields={**_READING.fields, **_SHOWN})


@dataclass(frozen=True, kw_only=True, eq=False)
class KalmanMemory:
    """What the Kalman filter remembers."""

    started: int = field(metadata=whole())  #: 1; 0 before the first whole reading, -1 if the state is lost
    missed: int = field(metadata=whole())  #: samples since the encoders last had all counts
    wheel_counts: Ints = field(metadata=whole(MAX_WHEELS))
    gyro: Floats = field(metadata=number("rad/s", 3))
    pivoting: float = field(metadata=number("rad/s"))
    pivoted: float = field(metadata=number("rad^2/s^2"))
    x: Floats = field(metadata=number("state", STATES))
    rest: Floats = field(metadata=number("state", STATES))  #: what rounding has taken from it
    P: Floats = field(metadata=number("product of two states", STATES, STATES))  #: covariance


_KALMAN_MEMORY = schema_of(KalmanMemory)
KALMAN_MEMORY = replace(_KALMAN_MEMORY, fields={**_KALMAN_MEMORY.fields, "slip": SLIP})


def whole_counts(angles: ArrayLike, *, robot: Robot) -> NDArray[np.int32]:
    """Return the counts of encoders at wheel angles (n,) [rad], modulo 2^32; the angle zero is count zero."""
    counts = np.round(np.asarray(angles, dtype=np.float64) / encoder_step(robot)).astype(np.int64)
    return counts.astype(np.uint64).astype(np.uint32).view(np.int32)


def reading_record(reading: Reading, *, robot: Robot, precision: Precision = "single") -> NDArray[np.void]:
    """Return a reading as a record (1,); wheel angles become whole counts (`whole_counts`)."""
    record = np.zeros(1, READING.dtype(precision))
    n = robot.wheel_count
    if np.isfinite(reading.wheel_angles).all():
        record["wheel_counts"][0, :n] = whole_counts(reading.wheel_angles, robot=robot)
        record["encoders_valid"] = 1
    record["wheel_speeds"][0, :n] = reading.wheel_speeds
    record["gyro"], record["attitude"] = reading.gyro, reading.attitude
    for sensor in DIRECT:
        record[sensor.name] = getattr(reading, sensor.name)
    record["fix_position"], record["fix_heading"] = np.nan, np.nan
    if (fix := reading.fix) is not None:
        if fix.position is not None:
            record["fix_position"] = fix.position
        record["fix_heading"] = np.nan if fix.heading is None else fix.heading
        record["fix_position_deviation"] = fix.position_deviation
        record["fix_heading_deviation"] = fix.heading_deviation
    return record
