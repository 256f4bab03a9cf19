"""What host and robot send each other.

A message is a frozen dataclass whose fields carry unit and shape, as records of the control law do. `Schema.dtype`
gives its bytes: numbers of 4 bytes, little-endian, in order. The structs in C are written from the
same schemas, so that both sides agree; a digest of all messages is exchanged in the handshake.

    host -> robot    Hello Keep SelfTest Arm Disarm Reference Torques Read Write Commit AskCounts Tune StepBack
    robot -> host    Welcome State Answer Parameters Counts

`docs/link.md` describes the protocol.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from hashlib import sha256
from typing import ClassVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from ballbot.control.tuning import MAX_GAINS
from ballbot.firmware.records import DIGEST_WORDS, FIRMWARE, digest_words
from ballbot.records import MAX_WHEELS, Schema, number, schema_of, whole

#: of the protocol, in every frame
VERSION = 1
#: longest time without a valid frame [s]: the robot stops, the host stops sending
WATCHDOG = 0.05
#: for which an answer to the first step of arming is good [s]
CONFIRMATION_TIME = 10.0
#: longest ramp of the torque limit after arming [s]
LONGEST_RAMP = 60.0
#: numbers of 4 bytes that one message of parameters carries
PARAMETER_WORDS = 32
#: longest time between two `State` messages that a host can ask for [s]
LONGEST_STATE_INTERVAL = 0.02


class Layer(IntEnum):
    """The checks that a frame must pass, in order. Each counts the frames that it refuses."""

    FRAMING = 0  #: the bytes between two zeros are COBS
    LENGTH = 1  #: neither shorter than a frame without a body nor longer than the longest
    CHECKSUM = 2  #: CRC-32
    VERSION = 3
    TYPE = 4  #: known, and meant for this side
    BODY = 5  #: the length that the type has
    SESSION = 6  #: of the handshake
    SEQUENCE = 7  #: newer than the last
    VALUES = 8  #: finite and in range


LAYERS = len(Layer)


class AnswerResult(IntEnum):
    """Answers of the robot to a command."""

    OK = 0
    #: first step of arming: `value` must come back within `CONFIRMATION_TIME`, confirmed at the host
    CONFIRM = 1
    SELF_TEST = 2  #: the self-test has not passed
    ACTIVE = 3  #: only while disarmed and without a self-test that runs
    NONCE = 4  #: arming was not asked for, too long ago, or the number is another
    BUTTON = 5  #: this robot needs its own button as well
    RANGE = 6  #: beyond the parameters
    CHECKSUM = 7  #: the parameters that were written have another CRC-32; `value` is that CRC-32
    #: the robot does not accept these parameters; `value` says why (`ballbot.firmware.bounds.refusal_clause`)
    PARAMETERS = 8
    VALUES = 9  #: a value is not finite or out of range
    DISARMED = 10  #: only while the controller on the robot balances
    GAINS = 11  #: the weights are no mixture of the robot's gains
    COMPENSATION = 12  #: more compensation than is certain, or less than none


class ControllerPlace(IntEnum):
    """Which controller an armed robot obeys: its own or the host's."""

    ROBOT = 0
    HOST = 1


class Capability(IntEnum):
    """Bits of `Welcome.capabilities`."""

    EMULATED = 1  #: sensors and motors are emulated
    BUTTON = 2  #: arming needs the robot's own button


#: the messages by the numbers of their types, and the first number of those to the host
MESSAGES: dict[int, type[Message]] = {}
_FIRST_TO_HOST = 64


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False, field_specifiers=(field,))
class Message:
    """A frozen dataclass; it is in `MESSAGES` by the number that its frames have."""

    TYPE: ClassVar[int]

    def __init_subclass__(cls, *, kind: int) -> None:
        cls.TYPE = kind
        MESSAGES[kind] = dataclass(frozen=True, kw_only=True, eq=False)(cls)


class Hello(Message, kind=1):
    """Open a session. The frame's session is a random number of the host; the robot's answer has the session."""

    firmware: NDArray[np.int32] = field(metadata=whole(DIGEST_WORDS))  #: schema of parameters and state
    messages: NDArray[np.int32] = field(metadata=whole(DIGEST_WORDS))  #: schema of the messages
    state_every: int = field(metadata=whole())  #: samples from one `State` to the next


class Keep(Message, kind=2):
    """Show that the host is there."""


class SelfTest(Message, kind=3):
    """Start the self-test."""


class Arm(Message, kind=4):
    """Arm in two steps: ask with the number 0, then return the number that the robot answered."""

    nonce: int = field(metadata=whole())
    controller: int = field(metadata=whole())  #: a `ControllerPlace`
    #: time over which the torque limit rises from zero, as for a first balance; 0 to `LONGEST_RAMP`
    ramp: float = field(metadata=number("s"))


class Disarm(Message, kind=5):
    """Disarm, or end a self-test."""


class Reference(Message, kind=6):
    """Give the controller on the robot a reference; it holds until the next one."""

    reference: NDArray[np.float32] = field(metadata=number("state", 10))


class Torques(Message, kind=7):
    """Give the torques of a controller on the host; they pass the robot's safety layer."""

    torques: NDArray[np.float32] = field(metadata=number("N m", MAX_WHEELS))


class Read(Message, kind=8):
    """Ask for a part of the parameters."""

    offset: int = field(metadata=whole())  #: in words
    count: int = field(metadata=whole())


class Write(Message, kind=9):
    """Write a part of the parameters into a copy that is not in use; only while disarmed."""

    offset: int = field(metadata=whole())  #: in words
    count: int = field(metadata=whole())
    words: NDArray[np.int32] = field(metadata=whole(PARAMETER_WORDS))


class Commit(Message, kind=10):
    """Use the parameters that were written, if their CRC-32 is this one and they are allowed."""

    crc: int = field(metadata=whole())


class AskCounts(Message, kind=11):
    """Ask for the counts of frames."""


class Tune(Message, kind=12):
    """Change the controller on the robot while it balances; it moves there at a limited rate.

    The answer's value is the time of the robot's last sample [us].
    """

    weights: NDArray[np.float32] = field(metadata=number("1", MAX_GAINS))  #: of its gains, with a sum of 1
    #: share of its compensation, 0 to the one that is certain
    compensation: float = field(metadata=number("1"))


class StepBack(Message, kind=13):
    """Return to the setting before the last `Tune`; answered like that one."""


class Welcome(Message, kind=64):
    """Answer a `Hello`; the frame repeats its random number."""

    session: int = field(metadata=whole())  #: of all frames that follow; 0 if the schemas differ
    firmware: NDArray[np.int32] = field(metadata=whole(DIGEST_WORDS))
    messages: NDArray[np.int32] = field(metadata=whole(DIGEST_WORDS))
    wheel_count: int = field(metadata=whole())
    sample_time: float = field(metadata=number("s"))
    capabilities: int = field(metadata=whole())  #: bits of `Capability`


class State(Message, kind=65):
    """A sample: sensors, estimate, torques, and whether the robot is armed or why it is stopped."""

    time: int = field(metadata=whole())  #: of the sample [us], modulo 2^32
    sample: int = field(metadata=whole())  #: from 1
    armed: int = field(metadata=whole())
    stop: int = field(metadata=whole())  #: number of the reason; `stop_reason` has the reason
    stop_wheel: int = field(metadata=whole())  #: from 1; 0 for none
    self_test: int = field(metadata=whole())  #: a `SelfTestOutcome`
    self_test_wheel: int = field(metadata=whole())  #: from 1; 0 for none
    controller: int = field(metadata=whole())  #: a `ControllerPlace`
    imu_valid: int = field(metadata=whole())
    encoders_valid: int = field(metadata=whole())
    estimate_valid: int = field(metadata=whole())  #: a value that is not valid is 0
    gyro: NDArray[np.float32] = field(metadata=number("rad/s", 3))
    attitude: NDArray[np.float32] = field(metadata=number("rad", 3))
    wheel_counts: NDArray[np.int32] = field(metadata=whole(MAX_WHEELS))
    wheel_speeds: NDArray[np.float32] = field(metadata=number("rad/s", MAX_WHEELS))
    estimate: NDArray[np.float32] = field(metadata=number("state", 10))
    reference: NDArray[np.float32] = field(metadata=number("state", 10))  #: that the controller follows
    torques: NDArray[np.float32] = field(metadata=number("N m", MAX_WHEELS))


class Answer(Message, kind=66):
    """Answer a command."""

    command: int = field(metadata=whole())  #: its type
    sequence: int = field(metadata=whole())  #: its sequence number
    result: int = field(metadata=whole())  #: a `AnswerResult`
    value: int = field(metadata=whole())


class Parameters(Message, kind=67):
    """A part of the parameters that are in use."""

    offset: int = field(metadata=whole())  #: in words
    count: int = field(metadata=whole())
    words: NDArray[np.int32] = field(metadata=whole(PARAMETER_WORDS))


class Counts(Message, kind=68):
    """How many frames the robot accepted, how many each layer refused, and how many of its own found no room."""

    accepted: int = field(metadata=whole())
    refused: NDArray[np.int32] = field(metadata=whole(LAYERS))
    dropped: int = field(metadata=whole())


#: those that the robot takes, and those that the host takes
TO_ROBOT = {kind: message for kind, message in MESSAGES.items() if kind < _FIRST_TO_HOST}
TO_HOST = {kind: message for kind, message in MESSAGES.items() if kind >= _FIRST_TO_HOST}

SCHEMAS: dict[int, Schema] = {number: schema_of(kind) for number, kind in MESSAGES.items()}
_DTYPES = {number: schema.dtype("single").newbyteorder("<") for number, schema in SCHEMAS.items()}
#: bytes of each message's body
BODY_LENGTHS = {number: dtype.itemsize for number, dtype in _DTYPES.items()}


_LINES = [f"{number} {item.name} {line}" for number, item in SCHEMAS.items() for line in ["", *item.lines()]]
#: SHA-256 of the types, names, order, shapes and units of all messages
MESSAGE_DIGEST = sha256("\n".join([f"version {VERSION}", *_LINES]).encode()).hexdigest()
#: this digest, and the one of parameters, state and readings, in numbers
MESSAGE_WORDS = np.array(digest_words(MESSAGE_DIGEST), dtype=np.int32)
FIRMWARE_WORDS = np.array(digest_words(FIRMWARE.digest), dtype=np.int32)


def pack_body(message: Message) -> bytes:
    """Return the body of a message: its numbers, little-endian."""
    record = np.zeros((), _DTYPES[message.TYPE])
    for name, member in SCHEMAS[message.TYPE].fields.items():
        value = getattr(message, name)
        is_whole = not isinstance(member, Schema) and member.whole
        record[name] = wrapped(value) if is_whole else value
    return record.tobytes()


def unpack_body(kind: int, body: bytes) -> Message:
    """Return the message of a type from its body, which has the length of that type."""
    values: dict[str, object] = {}
    for name, member in SCHEMAS[kind].fields.items():
        value = np.frombuffer(body, _DTYPES[kind])[0][name]
        values[name] = np.array(value, value.dtype.newbyteorder("=")) if member.shape else value.item()  # type: ignore[union-attr]
    return MESSAGES[kind](**values)


def wrapped(value: object) -> NDArray[np.int32]:
    """Return whole numbers modulo 2^32 as numbers with a sign, as a counter of 32 bits goes on."""
    return np.asarray(value, dtype=np.int64).astype(np.uint32).view(np.int32)


def finite(message: Message) -> bool:
    """Return whether every real number of a message is finite."""
    return all(np.isfinite(getattr(message, name)).all() for name in SCHEMAS[message.TYPE].fields)
