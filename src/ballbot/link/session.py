"""A session with a robot: handshake, watchdogs, arming in two steps, parameters.

    session = Session(SerialTransport("/dev/ttyACM0"))
    session.connect()
    session.self_test()
    session.arm(lambda: input("Type yes to arm: ") == "yes")
    while True:
        for message in session.poll(0.01): ...

One thread, no callbacks. Every method raises `LinkError` if the robot does not answer. `poll` must be called at least
every 50 ms: it sends what the robot's watchdog waits for, and notices that the robot is silent. Then it raises
`LinkError`, and nothing is sent until the next `connect`.
"""

import secrets
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from fastcrc import crc32
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import real_array
from ballbot.control.safety import StopReason
from ballbot.control.tuning import MAX_GAINS, Setting
from ballbot.errors import InputError
from ballbot.firmware.bounds import refusal_clause
from ballbot.firmware.records import PARAMETERS, SelfTestOutcome
from ballbot.link.frames import Frame, FrameReader, LayerCounts, encode, is_newer, message_of
from ballbot.link.messages import (
    FIRMWARE_WORDS,
    LONGEST_RAMP,
    MESSAGE_WORDS,
    PARAMETER_WORDS,
    TO_HOST,
    WATCHDOG,
    Answer,
    AnswerResult,
    Arm,
    AskCounts,
    Commit,
    ControllerPlace,
    Counts,
    Disarm,
    Hello,
    Keep,
    Layer,
    Message,
    Parameters,
    Read,
    Reference,
    SelfTest,
    State,
    StepBack,
    Torques,
    Tune,
    Welcome,
    Write,
)
from ballbot.link.operators import MOVEMENTS
from ballbot.link.transport import LinkError, Transport
from ballbot.records import MAX_WHEELS

#: after which the host sends something, if only `Keep` [s]
KEEP_INTERVAL = WATCHDOG / 5.0
#: for which a person may take to bring the robot into a position [s]
MOVING_TIME = 60.0
#: for an answer, after which a command is sent again; for a session; and, by the robot's clock, for motors' tests [s]:
#: three times the longest push of each of four wheels
_ANSWER_TIME, _OPENING_TIME, _TEST_TIME = 0.1, 2.0, 12.0
#: how often a command is sent before it counts as lost
_ATTEMPTS = 5
_WORD = np.dtype("<i4")
M = TypeVar("M", bound=Message)
_REASONS = {
    AnswerResult.SELF_TEST: "the self-test has not passed",
    AnswerResult.ACTIVE: "it is armed or its self-test runs",
    AnswerResult.NONCE: "arming was not asked for, or too long ago",
    AnswerResult.BUTTON: "its own button was not pressed",
    AnswerResult.RANGE: "the place is beyond its parameters",
    AnswerResult.CHECKSUM: "the parameters that it received are not those that were sent",
    AnswerResult.PARAMETERS: "the parameters are not allowed",
    AnswerResult.VALUES: "a value is not finite or out of range",
    AnswerResult.DISARMED: "its own controller does not balance it",
    AnswerResult.GAINS: "the weights are no mixture of its gains",
    AnswerResult.COMPENSATION: "it would be more compensation than is certain, or less than none",
}


def stop_reason(state: State) -> StopReason | None:
    """Return why the robot is stopped, or None."""
    return list(StopReason)[state.stop - 1] if 1 <= state.stop <= len(StopReason) else None


class Session:
    """The host's side of a connection to one robot.

    Parameters
    ----------
    transport : Transport
    clock : callable
        Gives the time [s]; for an emulated robot that runs in its own time, that time.
    """

    def __init__(self, transport: Transport, *, clock: Callable[[], float] = time.monotonic) -> None:
        self.transport = transport
        self.counts = LayerCounts()
        self.welcome: Welcome | None = None  #: of the handshake; None before it and after the link is lost
        self.state: State | None = None  #: the last one
        self.clock = clock
        self._reader = FrameReader(TO_HOST, self.counts)
        self._session = 0
        self._sequence = 0
        self._last: int | None = None  # sequence number of the robot's last frame
        self._queued: list[Message] = []
        self._heard = self._sent = clock()

    def connect(self) -> Welcome:
        """Open a session, in which every sample is sent, and return the robot's answer.

        LinkError if nothing answers, or the robot has firmware of another version.
        """
        hello = Hello(firmware=FIRMWARE_WORDS, messages=MESSAGE_WORDS, state_every=1)
        self.welcome, self.state, self._last, self._queued = None, None, None, []
        self._session = secrets.randbelow(2**32 - 1) + 1
        end = self.clock() + _OPENING_TIME
        while self.clock() < end:
            self._write(hello)
            resend = min(self.clock() + _ANSWER_TIME, end)
            while self.clock() < resend:
                self._queued += self._received(KEEP_INTERVAL)
                if self.welcome is not None:
                    return self.welcome
        raise LinkError(f"No robot answers within {_OPENING_TIME:g} s.")

    def _open(self, welcome: Welcome) -> None:
        """Take the session that the robot has opened; raise LinkError if its firmware is of another version."""
        own, theirs = (MESSAGE_WORDS, FIRMWARE_WORDS), (welcome.messages, welcome.firmware)
        for name, digest, other in zip(("messages", "parameters"), own, theirs, strict=True):
            if not np.array_equal(digest, other):
                raise LinkError(
                    f"The robot's firmware has {name} of another version; export it again and flash it."
                )
        self.welcome, self._session = welcome, welcome.session % 2**32
        self._heard = self.clock()

    @property
    def connected(self) -> bool:
        """Whether there is a session and the robot is not silent."""
        return self.welcome is not None

    def poll(self, timeout: float = 0.0) -> list[Message]:
        """Return the messages that have come; wait for the first one at most `timeout` [s].

        LinkError if there is no session, or the robot has been silent for 50 ms.
        """
        queued, self._queued = self._queued, []
        end = self.clock() + timeout
        messages = queued + self._step(0.0 if queued else min(timeout, KEEP_INTERVAL))
        while not messages and self.clock() < end:
            messages = self._step(min(KEEP_INTERVAL, end - self.clock()))
        return messages

    def _step(self, timeout: float) -> list[Message]:
        """Send what the robot's watchdog waits for, and return what comes within a time."""
        self._opened()
        try:
            if self.clock() - self._sent >= KEEP_INTERVAL:
                self._write(Keep())
            messages = self._received(timeout)
        except LinkError:
            self.welcome = None
            raise
        now = self.clock()
        if messages:
            self._heard = now
        elif now - self._heard > WATCHDOG:
            self.welcome = None
            raise LinkError(
                f"The robot has been silent for {1e3 * (now - self._heard):.0f} ms. It stops by itself; connect "
                "again."
            )
        return messages

    def _received(self, timeout: float) -> list[Message]:
        """Return the messages that come within a time and pass every layer."""
        messages = []
        for frame in self._reader.feed(self.transport.read(timeout)):
            message = self._accepted(frame)
            if isinstance(message, Layer):
                self.counts.refuse(message)
                continue
            self.counts.accepted += 1
            self._last = frame.sequence
            if isinstance(message, Welcome):
                self._open(message)
            else:
                if isinstance(message, State):
                    self.state = message
                messages.append(message)
        return messages

    def _accepted(self, frame: Frame) -> Message | Layer:
        """Return a frame's message, or the layer that refuses it."""
        opening = self.welcome is None
        if frame.session != self._session or (frame.kind == Welcome.TYPE) != opening:
            return Layer.SESSION
        if self._last is not None and not is_newer(frame.sequence, self._last):
            return Layer.SEQUENCE
        return message_of(frame)

    def send(self, message: Message) -> int:
        """Send a message and return its sequence number; LinkError if there is no session."""
        self._opened()
        return self._write(message)

    def _opened(self) -> Welcome:
        if self.welcome is None:
            raise LinkError("There is no session with a robot; connect first.")
        return self.welcome

    def _write(self, message: Message) -> int:
        self._sequence = (self._sequence + 1) % 65536
        self.transport.write(encode(message, session=self._session, sequence=self._sequence))
        self._sent = self.clock()
        return self._sequence

    def _exchange(
        self, message: Message, kind: type[M], wanted: Callable[[M, set[int]], bool]
    ) -> tuple[M, bool]:
        """Send a message until its answer comes; return that, and whether the message was sent again before it came.

        Other messages wait for the next `poll`. `wanted` knows the answer by the sequence numbers that were sent.
        """
        sent: set[int] = set()
        for _ in range(_ATTEMPTS):
            sent.add(self.send(message))
            end = self.clock() + _ANSWER_TIME
            while self.clock() < end:
                answer = None
                for received in self._step(KEEP_INTERVAL):
                    if answer is None and isinstance(received, kind) and wanted(received, sent):
                        answer = received
                    else:
                        self._queued.append(received)
                if answer is not None:
                    return answer, len(sent) > 1
        raise LinkError(f"The robot does not answer {type(message).__name__}.")

    def _request(self, message: Message) -> tuple[Answer, bool]:
        """Return the answer to a command, and whether the command was sent again before it came."""
        return self._exchange(
            message, Answer, lambda reply, sent: reply.command == message.TYPE and reply.sequence in sent
        )

    def _demand(self, message: Message) -> None:
        """Send a command; raise LinkError if the robot refuses it."""
        answer, resent = self._request(message)
        obeyed = resent and answer.result == AnswerResult.ACTIVE and isinstance(message, SelfTest)
        if not obeyed:  # or else the answer to the first was lost
            _check_obeyed(type(message).__name__, answer)

    def self_test(
        self,
        *,
        # asks a person to move the robot into a position; without it the test ends with the request
        move: Callable[[SelfTestOutcome], None] | None = None,
        motors: bool = True,  # whether the motors' test follows that of the IMU's axes
        watch: Callable[[State], None] = lambda _: None,  # takes every state meanwhile
    ) -> SelfTestOutcome:
        """Run the self-test and return its result. States that come meanwhile wait for the next `poll`.

        The first test since the robot was switched on checks the IMU's axes, for which a person moves the robot.

        LinkError if the robot is armed, does not answer, or does not end the test in time.
        """
        self._demand(SelfTest())
        seen, passed, waited_for = self.state, 0.0, None
        while passed < (_TEST_TIME if waited_for is None else MOVING_TIME):
            before = self.state
            messages = self._step(KEEP_INTERVAL)
            self._queued += messages
            for message in messages:
                if isinstance(message, State):
                    watch(message)
            if self.state is seen or self.state is None:
                continue
            passed += 0.0 if before is None else 1e-6 * ((self.state.time - before.time) % 2**32)
            outcome = SelfTestOutcome(self.state.self_test)
            if outcome is SelfTestOutcome.IMU_PASSED and motors:
                self._queued.clear()  # the states of a minute
                self._demand(SelfTest())
                seen, passed, waited_for = self.state, 0.0, None
            elif outcome in MOVEMENTS and move is not None:
                if outcome is not waited_for:
                    waited_for, passed = outcome, 0.0
                    move(outcome)
                    self._heard = self.clock()
            elif outcome not in (SelfTestOutcome.NOT_RUN, SelfTestOutcome.RUNNING):
                return outcome
        if waited_for is not None:
            return waited_for
        raise LinkError(f"The robot's self-test does not end within {_TEST_TIME:g} s.")

    def arm(
        self,
        # asks a person at this computer, and returns the answer. The robot's number is good for 10 s.
        confirm: Callable[[], bool],
        *,
        controller: ControllerPlace = ControllerPlace.ROBOT,  # whose torques the robot obeys
        ramp: float = 0.0,  # time over which the torque limit rises from zero [s]
    ) -> AnswerResult:
        """Arm in two steps: ask the robot, then confirm with the number that it returned.

        InputError if the ramp is negative or longer than a minute. LinkError if the robot does not answer.

        Returns
        -------
        Result
            OK; CONFIRM if the person did not confirm; otherwise why the robot refused.
        """
        if not 0.0 <= ramp <= LONGEST_RAMP:
            raise InputError(f"The torque ramp is {ramp:g} s; it must be from 0 to {LONGEST_RAMP:g} s.")
        asked, _ = self._request(Arm(nonce=0, controller=controller, ramp=ramp))
        if asked.result != AnswerResult.CONFIRM or not confirm():
            return AnswerResult(asked.result)
        self._heard = self.clock()  # the link was not read while the person decided
        answer, resent = self._request(Arm(nonce=asked.value, controller=controller, ramp=ramp))
        armed = resent and answer.result == AnswerResult.ACTIVE  # the answer to the first was lost
        return AnswerResult.OK if armed else AnswerResult(answer.result)

    def disarm(self) -> None:
        """Disarm the robot, or end its self-test."""
        self._demand(Disarm())

    def set_reference(self, reference: ArrayLike) -> int:
        """Send a reference (10,) for the controller on the robot; return its sequence number.

        InputError if it is not ten finite numbers.
        """
        numbers = real_array(reference, (10,), "The reference").astype(np.float32)
        return self.send(Reference(reference=numbers))

    def set_torques(self, torques: ArrayLike) -> int:
        """Send the torques (n,) [N m] of a controller on the host; return their sequence number.

        InputError if they are not as many finite numbers as the robot has wheels.
        """
        count = self._opened().wheel_count
        room = np.zeros(MAX_WHEELS, dtype=np.float32)
        room[:count] = real_array(torques, (count,), "The torques")
        return self.send(Torques(torques=room))

    def tune(self, setting: Setting | None) -> tuple[AnswerResult, int]:
        """Ask the balancing robot for another setting, or for the former one (None).

        Returns
        -------
        result : AnswerResult
        time : int
            Of the robot's last sample before the change [us], modulo 2^32.
        """
        message: Message = StepBack()
        if setting is not None:
            weights = np.zeros(MAX_GAINS, np.float32)
            weights[: len(setting.weights)] = setting.weights
            message = Tune(weights=weights, compensation=setting.compensation)
        answer, _ = self._request(message)
        return AnswerResult(answer.result), answer.value % 2**32

    def ask_counts(self) -> Counts:
        """Return the robot's counts of frames."""
        return self._exchange(AskCounts(), Counts, lambda *_: True)[0]

    def read_parameters(self) -> NDArray[np.void]:
        """Return the robot's parameters (1,), of `PARAMETERS` in single precision."""
        record = np.zeros(1, PARAMETERS.dtype("single"))
        words = record.view(_WORD)
        for first in range(0, len(words), PARAMETER_WORDS):
            asked = Read(offset=first, count=min(PARAMETER_WORDS, len(words) - first))
            span = asked.offset, asked.count
            part, _ = self._exchange(asked, Parameters, lambda p, _, span=span: (p.offset, p.count) == span)
            words[first : first + asked.count] = part.words[: asked.count]
        return record

    def write_parameters(self, record: NDArray[np.void]) -> None:
        """Write parameters (1,), of `PARAMETERS` in single precision; the self-test must then pass again.

        InputError if the record is of another type. LinkError if the robot is armed, does not accept the parameters, or
        does not answer.
        """
        if record.shape != (1,) or record.dtype != PARAMETERS.dtype("single"):
            raise InputError("Parameters of a robot are one record of PARAMETERS in single precision.")
        words = record.view(_WORD)
        for first in range(0, len(words), PARAMETER_WORDS):
            part = np.zeros(PARAMETER_WORDS, dtype=np.int32)
            count = min(PARAMETER_WORDS, len(words) - first)
            part[:count] = words[first : first + count]
            self._demand(Write(offset=first, count=count, words=part))
        answer, _ = self._request(Commit(crc=crc32.iso_hdlc(record.tobytes())))
        if answer.result == AnswerResult.PARAMETERS:
            raise LinkError(f"The robot refuses these parameters: {refusal_clause(record, answer.value)}.")
        _check_obeyed("Commit", answer)

    def close(self) -> None:
        """Close the transport. An armed robot stops 50 ms later; disarm it first."""
        self.welcome = None
        self.transport.close()


def _check_obeyed(command: str, answer: Answer) -> None:
    """Raise LinkError if a robot refuses a command."""
    if answer.result != AnswerResult.OK:
        raise LinkError(f"The robot refuses the command {command}: {reason(answer.result)}.")


def reason(result: int) -> str:
    """Return a clause that says why the robot refused a command."""
    return _REASONS.get(AnswerResult(result), "it gives no reason")
