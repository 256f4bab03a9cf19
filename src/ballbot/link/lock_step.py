"""Firmware in lock-step with a plant: a sample of the sensors goes in, the motors' torques come out.

    with QemuBoard(image) as board:
        estimator = ReadingTap(KalmanFilter(robot, sample_time=0.005))
        controller = FirmwareController(BoardLine(board), estimator, robot=robot, sample_time=0.005)
        log = simulate(Twin(robot, estimator=estimator), controller, reference, duration=60.0)

On the serial line of an emulated robot the messages of its sensors and motors travel between those of the host. The
robot steps once for each `Sensors`, whose time is its clock; it obeys what the host sent before. So a run depends
on the messages alone, not on how fast anything is.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.control.records import MAX_WHEELS
from ballbot.errors import InputError
from ballbot.estimation.interface import Estimator, Reading
from ballbot.firmware.estimators import whole_counts
from ballbot.firmware.qemu import QemuBoard
from ballbot.link.frames import Frame, decode, encode, message_of
from ballbot.link.messages import EMULATED, Motors, Result, Sensors
from ballbot.link.session import Session, reason
from ballbot.link.transport import LinkError, SocketTransport, Transport
from ballbot.robot import Robot

#: a board that does not answer a sample for so long has stopped [s]; a busy computer takes a fraction of it
PATIENCE = 20.0
#: for bytes to gather [s]
_GATHERING = 3e-4
#: samples from one state to the next: the least often that a robot sends it
_STATE_EVERY = 4


class BoardLine:
    """The serial line of a board under QEMU, as a transport; closing it stops the board."""

    def __init__(self, board: QemuBoard) -> None:
        self._board, self._line = board, SocketTransport(board.line, name="board")

    def read(self, timeout: float) -> bytes:
        """Return what has come; wait for it at most `timeout` [s], then return b""."""
        first = self._line.read(timeout)
        if not first:
            return b""
        time.sleep(_GATHERING)  # bytes come one by one; to wake for each would take longer
        return first + self._line.read(0.0)

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._line.write(data)

    def close(self) -> None:
        """Stop the board."""
        self._board.close()


class LockStep:
    """The line of an emulated robot, with its sensors and motors, as a transport of the host.

    `read` takes samples while nothing comes: a host that waits lets the robot's time go on.

    Parameters
    ----------
    line : Transport
        Of the emulated robot.
    sample_time : float
        Of the robot [s].

    Attributes
    ----------
    line : Transport
    sensors : Sensors
        What the sensors show in the samples to come; their time is replaced.
    motors : Motors or None
        What the robot commanded in the last sample.
    samples : int
        How many there were.
    """

    def __init__(self, line: Transport, *, sample_time: float) -> None:
        self.sensors = _no_sensors()
        self.motors: Motors | None = None
        self.samples = 0
        self.line = line
        self._sample_time = sample_time
        self._waiting = b""  # what the host sends with the next sample
        self._rest = b""  # of a frame that is not whole
        self._for_host = b""

    def clock(self) -> float:
        """Return the robot's time [s]."""
        return self.samples * self._sample_time

    def step(self) -> Motors:
        """Let the robot take one sample and return what it commands its motors.

        Raises
        ------
        LinkError
            If it does not answer.
        """
        self.samples += 1
        stamped = replace(self.sensors, time=round(1e6 * self.clock()) % 2**32)
        # whole frames only: a part of one would spoil the sensors' frame after it
        whole, zero, self._waiting = self._waiting.rpartition(b"\0")
        self.line.write(whole + zero + encode(stamped, session=0, sequence=self.samples))
        self.motors = None
        end = time.monotonic() + PATIENCE
        while self.motors is None:
            self._take(self.line.read(PATIENCE / 10.0))
            if time.monotonic() > end:
                raise LinkError(f"The emulated robot does not answer a sample within {PATIENCE:g} s.")
        return self.motors

    def _take(self, data: bytes) -> None:
        """Sort what the robot sent: motors, and frames for the host."""
        *whole, self._rest = (self._rest + data).split(b"\0")
        for coded in whole:
            frame = decode(coded, EMULATED)
            message = message_of(frame) if isinstance(frame, Frame) and frame.session == 0 else None
            if isinstance(message, Motors):
                self.motors = message
            else:
                self._for_host += coded + b"\0"

    def read(self, timeout: float) -> bytes:
        """Return what has come for the host; take samples until something has, for about `timeout` [s] of them.

        A time above zero is one sample at least: a host that waits until its time is over does not wait for ever.
        """
        left = max(1, round(timeout / self._sample_time)) if timeout > 0.0 else 0
        while not self._for_host and left:
            self.step()
            left -= 1
        return self.take()

    def take(self) -> bytes:
        """Return what has come for the host, and take no sample."""
        data, self._for_host = self._for_host, b""
        return data

    def write(self, data: bytes) -> None:
        """Send bytes with the next sample."""
        self._waiting += data

    def close(self) -> None:
        """Close the line."""
        self.line.close()


def _no_sensors() -> Sensors:
    """Return the message of a robot none of whose sensors gives anything."""
    return Sensors(
        time=0,
        imu_valid=0,
        encoders_valid=0,
        gyro=np.zeros(3, np.float32),
        attitude=np.zeros(3, np.float32),
        wheel_counts=np.zeros(MAX_WHEELS, np.int32),
    )


def sensors_of(reading: Reading, *, robot: Robot) -> Sensors:
    """Return a reading as a message; wheel angles become whole counts, modulo 2^32.

    The time is 0. What is missing in the IMU or in the encoders makes all of it invalid, as a checksum would.
    """
    counts = np.zeros(MAX_WHEELS, np.int32)
    counted = bool(np.isfinite(reading.wheel_angles).all())
    if counted:
        counts[: robot.wheel_count] = whole_counts(reading.wheel_angles, robot=robot)
    imu = np.concatenate([reading.gyro, reading.attitude])
    measured = bool(np.isfinite(imu).all())
    gyro, attitude = np.split((imu if measured else np.zeros(6)).astype(np.float32), 2)
    return Sensors(
        time=0,
        imu_valid=int(measured),
        encoders_valid=int(counted),
        gyro=gyro,
        attitude=attitude,
        wheel_counts=counts,
    )


class ReadingTap:
    """An estimator that also keeps the last reading, for the firmware that estimates by itself."""

    def __init__(self, estimator: Estimator) -> None:
        self.reading: Reading | None = None
        self._estimator = estimator

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset the estimator."""
        self.reading = None
        self._estimator.reset(position=position)

    def update(self, reading: Reading) -> NDArray[np.float64]:
        """Keep the reading and return the estimator's state (10,)."""
        self.reading = reading
        return self._estimator.update(reading)


class FirmwareController:
    """Firmware on the line of an emulated robot, as a controller of a plant.

    It sees the readings that the plant's estimator gets, and neither the state nor the truth. Before the first one a
    session is opened and the robot armed, with sensors that show nothing yet, so that estimator and control law begin
    with the plant. Nobody is asked whether to arm, because nothing can move.

    Parameters
    ----------
    line : Transport
        Of an emulated robot whose wiring counts as known, just started.
    tap : ReadingTap
        The estimator of the plant.
    robot : Robot
    sample_time : float
        Of the firmware [s].
    """

    def __init__(self, line: Transport, tap: ReadingTap, *, robot: Robot, sample_time: float) -> None:
        self.sample_time = sample_time
        self.robot_line = LockStep(line, sample_time=sample_time)
        self.session = Session(self.robot_line, clock=self.robot_line.clock)
        self._tap, self._robot = tap, robot
        self._reference: NDArray[np.float64] | None = None

    def reset(self) -> None:
        """Do nothing before the first sample.

        Raises
        ------
        InputError
            If there was one: an estimator on a robot cannot be reset. Start another emulated robot.
        """
        if self.session.connected:
            raise InputError("The firmware has run already; start another emulated robot for another run.")

    def update(
        self,
        t: float,  # noqa: ARG002 (the firmware has its own clock)
        state: ArrayLike,  # noqa: ARG002
        reference: ArrayLike,
    ) -> NDArray[np.float64]:
        """Let the robot take a sample and return the torques (n,) [N m] that it commands.

        Raises
        ------
        InputError
            If the plant has not read its sensors through the tap.
        LinkError
            If the robot does not answer, or refuses to arm.
        """
        if self._tap.reading is None:
            raise InputError("The plant's estimator must be the firmware controller's tap.")
        wanted = np.asarray(reference, dtype=np.float64)
        if self._reference is None:
            self._begin()
        self.robot_line.sensors = sensors_of(self._tap.reading, robot=self._robot)
        if self._reference is None or not np.array_equal(wanted, self._reference):
            self.session.set_reference(wanted)
            self._reference = wanted.copy()
        motors = self.robot_line.step()
        self.session.poll()
        return motors.torques[: self._robot.wheel_count].astype(np.float64)

    def _begin(self) -> None:
        """Open a session and arm; the robot may lack its sensors for two samples after it."""
        self.robot_line.sensors = _no_sensors()
        self.session.connect(state_every=_STATE_EVERY)
        answer = self.session.arm(lambda: True)
        if answer != Result.OK:
            raise LinkError(f"The emulated robot does not arm: {reason(answer)}.")
