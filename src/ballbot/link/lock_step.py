"""Firmware in lock-step with a plant: a sample of the sensors goes in, the motors' torques come out.

On the serial line of an emulated robot the messages of its sensors and motors travel between those of the host. The
robot steps once for each `Sensors`, whose time is its clock; it obeys what the host sent before. So a run depends
on the messages alone, not on how fast anything is.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from ballbot.control.records import MAX_WHEELS
from ballbot.estimation.interface import Reading
from ballbot.firmware.estimators import whole_counts
from ballbot.link.frames import Frame, decode, encode, message_of
from ballbot.link.messages import EMULATED, Motors, Sensors
from ballbot.link.transport import LinkError, Transport
from ballbot.robot import Robot

#: a board that does not answer a sample for so long has stopped [s]; a busy computer takes a fraction of it
PATIENCE = 20.0


class LockStep:
    """The line of an emulated robot, with its sensors and motors, as a transport of the host.

    `read` takes samples while nothing comes: a host that waits lets the robot's time go on.

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

    def __init__(
        self,
        line: Transport,  # of the emulated robot
        *,
        sample_time: float,  # of the robot [s]
    ) -> None:
        self.sensors = no_sensors()
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
        """Let the robot take one sample and return what it commands its motors; LinkError if it does not answer."""
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


def no_sensors() -> Sensors:
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
