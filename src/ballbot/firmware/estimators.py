"""The records of the firmware's estimators: the numbers that they read, what they remember, and a sensor reading.

The C sources are `c/estimation/onboard.c` and `kalman.c`. Their numbers come from the same robot, noise and model as
those of `ballbot.estimation`; what they remember is zero at the start, which is a robot at (0, 0).
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import Floats, Ints
from ballbot.control.records import (
    MAX_WHEELS,
    Number,
    Precision,
    Schema,
    converted,
    fill_record,
    number,
    schema_of,
    whole,
)
from ballbot.estimation.interface import Reading
from ballbot.estimation.kalman import filter_model, first_covariance
from ballbot.estimation.kalman_model import DIRECT, FIRST, SHOWN_TOGETHER, STATES, FilterNoise
from ballbot.mechanics.geometry import transforms
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
class OnboardRecord:
    """The numbers of the on-board state, the thesis's way."""

    sample_time: float = field(metadata=number("s"))
    radius: float = field(metadata=number("m"))  #: of the ball
    ball_from_wheels: Floats = field(metadata=number("1", 3, MAX_WHEELS))  #: T_obw


@dataclass(frozen=True, kw_only=True, eq=False)
class OnboardMemory:
    """What the on-board state remembers."""

    started: int = field(metadata=whole())
    position: Floats = field(metadata=number("m", 2))
    position_rest: Floats = field(metadata=number("m", 2))  #: what rounding has taken from it
    velocity: Floats = field(metadata=number("m/s", 2))
    gyro: Floats = field(metadata=number("rad/s", 3))
    attitude: Floats = field(metadata=number("rad", 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class KalmanRecord:
    """The numbers of the Kalman filter."""

    sample_time: float = field(metadata=number("s"))
    radius: float = field(metadata=number("m"))  #: of the ball
    ball_turn: Floats = field(metadata=number("rad", 3, MAX_WHEELS))  #: T_obw of one encoder count
    lever: Floats = field(metadata=number("m", 2, 3))  #: C
    pull: Floats = field(metadata=number("m/s^2", 2, 2))  #: Lambda
    forgotten: float = field(metadata=number("1"))  #: 1 - exp(-h / tau) of the slow lean error
    gyro_variance: float = field(metadata=number("rad^2/s^2"))
    walk: Floats = field(metadata=number("square of the state", STATES))
    #: of what the sensors show every sample
    variances: Floats = field(metadata=number("square of what is shown", FIRST["fix"]))
    start_variances: Floats = field(metadata=number("square of the state", STATES))
    #: of a with g, and of psi with psi_a
    start_covariances: Floats = field(metadata=number("1, rad^2", len(SHOWN_TOGETHER)))
    pivoting_share: float = field(metadata=number("1"))  #: of a new sample in the mean of the pivoting
    pivoting_limit: float = field(metadata=number("rad/s"))


@dataclass(frozen=True, kw_only=True, eq=False)
class KalmanMemory:
    """What the Kalman filter remembers."""

    started: int = field(metadata=whole())  #: 1; 0 before the first whole reading, -1 if the state is lost
    missed: int = field(metadata=whole())  #: samples since the encoders last had all counts
    wheel_counts: Ints = field(metadata=whole(MAX_WHEELS))
    gyro: Floats = field(metadata=number("rad/s", 3))
    pivoting: float = field(metadata=number("rad/s"))
    x: Floats = field(metadata=number("state", STATES))
    rest: Floats = field(metadata=number("state", STATES))  #: what rounding has taken from it
    P: Floats = field(metadata=number("product of two states", STATES, STATES))  #: covariance


def onboard_record(robot: Robot, *, sample_time: float) -> OnboardRecord:
    """Return the numbers of the on-board state for a robot."""
    return OnboardRecord(
        sample_time=sample_time, radius=robot.ball.radius, ball_from_wheels=transforms(robot).T_obw
    )


def kalman_record(
    robot: Robot,
    *,
    sample_time: float,  # [s]
    noise: FilterNoise | None = None,  # `FilterNoise.of(robot)` by default
) -> KalmanRecord:
    """Return the numbers of the Kalman filter for a robot."""
    noise = noise if noise is not None else FilterNoise.of(robot)
    model = filter_model(robot, sample_time=sample_time, noise=noise)
    P = first_covariance(noise)
    return KalmanRecord(
        sample_time=sample_time,
        radius=model.radius,
        ball_turn=transforms(robot).T_obw * encoder_step(robot),
        lever=model.lever,
        pull=model.pull,
        forgotten=model.forgotten,
        gyro_variance=model.gyro_variance,
        walk=model.walk,
        variances=model.variances[: FIRST["fix"]],
        start_variances=np.diagonal(P),
        start_covariances=np.array([P[pair] for pair in SHOWN_TOGETHER]),
        pivoting_share=min(1.0, sample_time / noise.pivoting_time),
        pivoting_limit=noise.pivoting_limit,
    )


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


def single(value: OnboardRecord | KalmanRecord) -> NDArray[np.void]:
    """Return an estimator's numbers as a record (1,) in single precision."""
    schema = schema_of(type(value))
    record = schema.zeros()
    fill_record(record, value)
    return converted(record, schema)
