"""A robot's side of the link in Python: the firmware's library with a plant in lock-step, behind the transport's seam.

It is written from the protocol's page and not from the C sources, so that both are checked against each other.
"""

from __future__ import annotations

import numpy as np

from ballbot.estimation.interface import Reading
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.host import Firmware, SelfTestOutcome
from ballbot.firmware.records import PARAMETERS
from ballbot.link.frames import Frame, FrameReader, encode, message_of
from ballbot.link.messages import (
    PARAMETER_WORDS,
    TO_ROBOT,
    Answer,
    Arm,
    AskCounts,
    Commit,
    ControllerPlace,
    Counts,
    Disarm,
    Hello,
    Layer,
    Message,
    Parameters,
    Read,
    Reference,
    Result,
    SelfTest,
    State,
    Torques,
    Welcome,
    Write,
    firmware_words,
    message_words,
)

_NONCE, _SESSION = 4711, 99


class FakeRobot:
    """A transport to a robot that exists only here; each read is a sample."""

    def __init__(self, parameters, plant, *, seed=0):
        self.plant, self.mute, self.closed = plant, False, False
        self._use(parameters)
        self._measured = plant.reset(None, seed=seed)
        self._reader = FrameReader(TO_ROBOT)
        self._out: list[bytes] = []
        self._sequence = self._samples = self._session = 0
        self._staged = np.zeros(1, PARAMETERS.dtype("single"))
        self.armed, self._place = False, ControllerPlace.ROBOT
        self._reference, self._host = None, np.zeros(4)
        self.received: list[Message] = []

    def _use(self, parameters):
        self.parameters = parameters.copy()
        self.firmware = Firmware(self.parameters)

    def now(self) -> float:
        """Return the robot's time [s]."""
        return self._samples * float(self.parameters["sample_time"][0])

    def write(self, data: bytes) -> None:
        for frame in self._reader.feed(data):
            message = message_of(frame)
            assert not isinstance(message, Layer)
            self.received.append(message)
            self._take(frame, message)

    def close(self) -> None:
        self.closed = True

    def read(self, timeout: float) -> bytes:  # noqa: ARG002
        self._step()
        if self.mute:
            self._out = []
            return b""
        found, self._out = b"".join(self._out), []
        return found

    def _send(self, message: Message, session: int | None = None) -> None:
        self._sequence += 1
        self._out.append(
            encode(message, session=self._session if session is None else session, sequence=self._sequence)
        )

    def _answer(self, frame: Frame, result: Result, value: int = 0) -> None:
        self._send(Answer(command=frame.kind, sequence=frame.sequence, result=result, value=value))

    def _take(self, frame: Frame, message: Message) -> None:
        if isinstance(message, Hello):
            self._session = _SESSION
            self._send(
                Welcome(
                    session=_SESSION,
                    firmware=firmware_words(),
                    messages=message_words(),
                    wheel_count=int(self.parameters["wheel_count"][0]),
                    sample_time=float(self.parameters["sample_time"][0]),
                    capabilities=2,
                ),
                frame.session,
            )
        elif isinstance(message, Reference):
            self._reference = message.reference.astype(np.float64)
        elif isinstance(message, Torques):
            self._host = message.torques.astype(np.float64)
        elif isinstance(message, Read):
            words = np.zeros(PARAMETER_WORDS, dtype=np.int32)
            part = self.parameters.view(np.int32)[message.offset : message.offset + message.count]
            words[: message.count] = part
            self._send(Parameters(offset=message.offset, count=message.count, words=words))
        elif isinstance(message, AskCounts):
            self._send(Counts(accepted=1, refused=np.zeros(len(Layer), dtype=np.int32), dropped=0))
        else:
            self._command(frame, message)

    def _command(self, frame: Frame, message: Message) -> None:
        if isinstance(message, Write):
            self._staged.view(np.int32)[message.offset : message.offset + message.count] = message.words[
                : message.count
            ]
            self._answer(frame, Result.ACTIVE if self.armed else Result.OK)
        elif isinstance(message, Commit):
            self._use(self._staged)
            self._answer(frame, Result.OK)
        elif isinstance(message, SelfTest):
            self.firmware.start_self_test()
            self._answer(frame, Result.OK)
        elif isinstance(message, Disarm):
            self.firmware.disarm()
            self.armed = False
            self._answer(frame, Result.OK)
        elif isinstance(message, Arm):
            self._answer(frame, *self._arm(message))

    def _arm(self, message: Arm) -> tuple[Result, int]:
        if self.firmware.self_test != SelfTestOutcome.PASSED:
            return Result.SELF_TEST, 0
        if message.nonce == 0:
            return Result.CONFIRM, _NONCE
        if message.nonce != _NONCE:
            return Result.NONCE, 0
        self.armed = self.firmware.arm()
        self._place, self._reference, self._host = ControllerPlace(message.controller), None, np.zeros(4)
        return Result.OK, 0

    def _step(self) -> None:
        robot, one = self.plant.robot, self._measured
        reading = Reading(
            wheel_angles=one.wheel_angles,
            wheel_speeds=one.wheel_speeds,
            gyro=one.gyro,
            attitude=one.state[2:5],
        )
        record = reading_record(reading, robot=robot)
        micros = round(1e6 * self.now())
        torques = self.firmware.update(record, micros, self._reference).astype(np.float64)
        stop = self.firmware.stop
        if self.armed and self._place == ControllerPlace.HOST:
            torques = np.zeros(len(torques)) if stop else self._host[: len(torques)]
        self._samples += 1
        state = self.firmware.state
        room = np.zeros(4)
        room[: len(torques)] = torques
        if self._session:
            self._send(
                State(
                    time=micros,
                    sample=self._samples,
                    armed=int(self.armed),
                    stop=int(state["safety"]["stop"][0]),
                    stop_wheel=int(state["safety"]["stop_wheel"][0]),
                    self_test=int(self.firmware.self_test),
                    self_test_wheel=int(state["self_test"]["wheel"][0]),
                    controller=int(self._place),
                    imu_valid=1,
                    encoders_valid=1,
                    estimate_valid=1,
                    gyro=record["gyro"][0],
                    attitude=record["attitude"][0],
                    wheel_counts=record["wheel_counts"][0],
                    wheel_speeds=record["wheel_speeds"][0],
                    estimate=self.firmware.estimate,
                    reference=state["run"]["reference"][0],
                    torques=room,
                )
            )
        self._measured = self.plant.step(torques, float(self.parameters["sample_time"][0]))
