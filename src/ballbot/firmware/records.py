"""The records of the firmware: a controller's parameters, and the state that the application owns.

They consist of the records of the control law, the estimators and the safety layer. `FIRMWARE` holds all of them.
Its digest is compiled into the C library and written into every exported controller.
"""

from dataclasses import asdict, dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats, Ints
from ballbot.control.controller import Controller
from ballbot.control.law import LAW, MEMORY
from ballbot.control.safety import SafetyLimits
from ballbot.estimation.heading import HEADING
from ballbot.estimation.interface import EstimatorName
from ballbot.estimation.kalman import kalman_record
from ballbot.estimation.kalman_model import KALMAN
from ballbot.estimation.onboard import ONBOARD, ONBOARD_MEMORY, onboard_record
from ballbot.firmware.bounds import check_bounds
from ballbot.firmware.estimators import KALMAN_MEMORY, READING
from ballbot.firmware.self_test import SelfTestRecord, self_test_record
from ballbot.records import (
    MAX_WHEELS,
    Number,
    Schema,
    converted,
    fill_record,
    number,
    schema_of,
    whole,
)
from ballbot.robot.derived import encoder_step

#: numbers in which the digest is exported
DIGEST_WORDS = 8


#: number of each estimator in C
ESTIMATORS: dict[EstimatorName, int] = {"onboard": 0, "kalman": 1}


class SelfTestOutcome(IntEnum):
    """The results of the firmware's self-test, with the numbers that they have in C."""

    NOT_RUN = 0
    RUNNING = 1
    PASSED = 2
    DEAD_MOTOR = 3
    TORQUE_ORDER = 4
    TORQUE_SIGN = 5
    STOPPED = 6
    HOLD_UPRIGHT = 7
    TILT_FORWARD = 8
    TILT_LEFT = 9
    TURN_LEFT = 10
    IMU_PASSED = 11
    IMU_AXES = 12
    IMU_GYRO = 13


@dataclass(frozen=True, kw_only=True, eq=False)
class SafetyRecord:
    """What the safety layer lets pass."""

    max_missing: int = field(metadata=whole())
    lean: float = field(metadata=number("rad"))
    max_interval: float = field(metadata=number("s"))
    max_unchanged: int = field(metadata=whole())
    turning_torque: float = field(metadata=number("N m"))


@dataclass(frozen=True, kw_only=True, eq=False)
class SafetyState:
    """Why the torques are zero, and the last samples."""

    stop: int = field(metadata=whole())
    stop_wheel: int = field(metadata=whole())
    missing: int = field(metadata=whole())
    watched: int = field(metadata=whole())
    imu: Floats = field(metadata=number("rad/s, rad", 6))
    imu_unchanged: int = field(metadata=whole())
    counts_valid: int = field(metadata=whole())
    counts: Ints = field(metadata=whole(MAX_WHEELS))
    pushed: Ints = field(metadata=whole(MAX_WHEELS))


@dataclass(frozen=True, kw_only=True, eq=False)
class SelfTestState:
    """How far the self-test is, and its result."""

    result: int = field(metadata=whole())
    #: that the result is about, from 1; 0 for none
    wheel: int = field(metadata=whole())
    #: whose turn it is, from 0
    pushed: int = field(metadata=whole())
    #: of its turn
    sample: int = field(metadata=whole())
    #: samples of its push forward; 0 until that has ended
    forward: int = field(metadata=whole())
    #: of the encoders when the push began
    counts: Ints = field(metadata=whole(MAX_WHEELS))


@dataclass(frozen=True, kw_only=True, eq=False)
class ImuCheckState:
    """How far the check of the IMU's axes is."""

    #: 1 if it has passed since the start, 2 if these parameters do not balance and need none
    passed: int = field(metadata=whole())
    stage: int = field(metadata=whole())
    #: samples in a row in which the robot was still
    still: int = field(metadata=whole())
    moved: int = field(metadata=whole())
    #: of the samples in which it was still
    attitude_sum: Floats = field(metadata=number("rad", 3))
    #: attitude when it was last held upright
    rest: Floats = field(metadata=number("rad", 3))
    #: by the gyro since then, as a quaternion
    turned: Floats = field(metadata=number("1", 4))


@dataclass(frozen=True, kw_only=True, eq=False)
class RunState:
    """Whether torques are given, and the last update."""

    #: whether the parameters are those of the library
    known: int = field(metadata=whole())
    armed: int = field(metadata=whole())
    #: whether there is a reference
    held: int = field(metadata=whole())
    started: int = field(metadata=whole())
    #: of the last update, microseconds modulo 2^32
    time: int = field(metadata=whole())
    #: the state that was estimated
    estimate: Floats = field(metadata=number("state", 10))
    #: the last one that was not refused
    reference: Floats = field(metadata=number("state", 10))
    torques: Floats = field(metadata=number("N m", MAX_WHEELS))


PARAMETERS = Schema(
    name="parameters",
    text="The numbers of one controller.",
    fields={
        "schema": Number(unit="1", shape=(DIGEST_WORDS,), whole=True),
        "wheel_count": Number(unit="1", whole=True),
        "estimator": Number(unit="1", whole=True),
        "sample_time": Number(unit="s"),
        "encoder_step": Number(unit="rad"),
        "self_test": schema_of(SelfTestRecord),
        "law": LAW,
        "safety": schema_of(SafetyRecord),
        "onboard": ONBOARD,
        "kalman": KALMAN,
    },
)
STATE = Schema(
    name="state",
    text="All that changes while the robot runs.",
    fields={
        "run": schema_of(RunState),
        "heading": HEADING,
        "safety": schema_of(SafetyState),
        "self_test": schema_of(SelfTestState),
        "imu_check": schema_of(ImuCheckState),
        "memory": MEMORY,
        "onboard": ONBOARD_MEMORY,
        "kalman": KALMAN_MEMORY,
    },
)
FIRMWARE = Schema(name="firmware", fields={"parameters": PARAMETERS, "state": STATE, "reading": READING})


def digest_words(digest: str) -> tuple[int, ...]:
    """Return a SHA-256 in hexadecimal digits as `DIGEST_WORDS` numbers of 31 bits."""
    return tuple(int(digest[8 * i : 8 * i + 8], 16) & 0x7FFFFFFF for i in range(DIGEST_WORDS))


def parameter_record(controller: Controller, limits: SafetyLimits) -> NDArray[np.void]:
    """Return a controller's parameters (1,) of `PARAMETERS` in single precision.

    InputError if single precision cannot hold a number, a limit is infinite, a number is beyond its bound
    (`ballbot.firmware.bounds`), or the self-test cannot move a wheel.
    """
    robot, sample_time = controller.robot, controller.sample_time
    record = PARAMETERS.zeros()
    record["schema"] = digest_words(FIRMWARE.digest)
    record["wheel_count"] = len(controller.gain)
    record["estimator"] = ESTIMATORS[controller.estimator]
    record["sample_time"] = sample_time
    record["encoder_step"] = encoder_step(robot)
    record["law"] = controller.record
    fill_record(record["self_test"], self_test_record(robot, sample_time=sample_time))
    fill_record(record["safety"], SafetyRecord(**asdict(limits)))
    fill_record(record["onboard"], onboard_record(robot, sample_time=sample_time))
    fill_record(record["kalman"], kalman_record(robot, sample_time=sample_time))
    single = converted(record, PARAMETERS)
    check_bounds(single)
    return single
