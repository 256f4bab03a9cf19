"""The check of the IMU's axes against gravity and motion, before a robot's first self-test.

Somebody moves the robot by hand, and nothing is driven. Each position is held for half a second:

    upright and still      gravity: theta and phi are within 5 degrees of zero
    top tilted forward     the attitude turns about +y from there, and the gyro's integral is the same turn
    upright, tilted left   about -x
    upright, turned left   about +z

An IMU that is mounted turned, has an exchanged or a negated axis, or a gyro in another unit would make the balance push
the robot over. The C source is `firmware/c/imu_check.c`, with the same logic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.control.interface import LARGEST_STATE

#: time for which a position is held [s]
STILL_TIME = 0.5
#: angular velocity that counts as still, by hand [rad/s]
STILL = 0.08
#: largest theta and phi that count as upright [rad]
LEVEL = 0.0873
#: share of a turn that must be about its axis: 0.8 is 37 degrees off, half the way to the next axis is 45
ABOUT_AXIS = 0.8
#: of the gyro's turn over the attitude's: another unit is a wrong scale; a hand and a gyro's bias make less
SCALE = (0.75, 1.33)
#: sine of half the smallest turn that counts as a movement, 6 degrees, and of half of that
_LEAST_TURN, _NO_TURN = 0.0523, 0.0262
#: axis and sign of each movement: forward, to the left, turned to the left
_MOVEMENTS = ((1, 1.0), (0, -1.0), (2, 1.0))


class ImuStage(IntEnum):
    """What the check waits for, or its result; an odd stage below `DONE` waits for the robot to be upright."""

    UPRIGHT = 1
    FORWARD = 2
    UPRIGHT_BEFORE_LEFT = 3
    LEFT = 4
    UPRIGHT_BEFORE_TURN = 5
    TURN = 6
    DONE = 7
    WRONG_AXES = 8  #: the attitude turned about another axis or the other way, or not at all
    WRONG_GYRO = 9  #: the gyro's turn is not the attitude's


class ImuCheck:
    """The check, a sample at a time.

    Parameters
    ----------
    sample_time : float
        [s]
    """

    def __init__(self, sample_time: float) -> None:
        self.stage = ImuStage.UPRIGHT
        self.movement = 1  #: the present or the last one, from 1
        self._step = sample_time
        self._rest = Rotation.identity()
        self._enter(ImuStage.UPRIGHT)

    def update(self, gyro: Sequence[float], attitude: Sequence[float]) -> ImuStage:
        """Take a sample and return the stage.

        Parameters
        ----------
        gyro : sequence of three floats
            Angular velocity, body frame [rad/s].
        attitude : sequence of three floats
            theta, phi, psi [rad]. A sample with a value that is missing is passed over.
        """
        sizes = [abs(value) for value in (*gyro, *attitude)]
        if self.stage >= ImuStage.DONE or not all(size <= LARGEST_STATE for size in sizes):
            return self.stage
        upright = self.stage % 2 == 1
        if upright:
            there = abs(attitude[0]) <= LEVEL and abs(attitude[1]) <= LEVEL
        else:
            self._turned = self._turned * _small_turn(self._step * np.asarray(gyro))
            turns = (_vector(self._turned), _vector(self._rest.inv() * _rotation(attitude)))
            self._moved = self._moved or max(map(_length, turns)) > _LEAST_TURN
            there = self._moved
        still = there and _length(gyro) < STILL
        self._held = [*self._held, np.asarray(attitude, dtype=np.float64)] if still else []
        if not self._held or (len(self._held) + 0.5) * self._step < STILL_TIME:
            return self.stage
        found = _rotation(np.mean(self._held, axis=0))
        if upright:
            self._rest = found
            self._enter(ImuStage(self.stage + 1))
        else:
            self._enter(self._judged(_vector(self._rest.inv() * found)))
        return self.stage

    def _enter(self, stage: ImuStage) -> None:
        self.stage = stage
        self.movement = (stage + 1) // 2 if stage < ImuStage.DONE else self.movement
        self._held: list[NDArray[np.float64]] = []
        self._moved = False
        self._turned = Rotation.identity()

    def _judged(self, made: NDArray[np.float64]) -> ImuStage:
        """Return the stage that follows a movement, given as the vector of its quaternion."""
        axis, sign = _MOVEMENTS[self.stage // 2 - 1]
        gyro = _vector(self._turned)
        size, gyro_size = _length(made), _length(gyro)
        if size < _NO_TURN or sign * made[axis] < ABOUT_AXIS * size:
            return ImuStage.WRONG_AXES
        agrees = float(made @ gyro) >= ABOUT_AXIS * size * gyro_size
        if not agrees or not SCALE[0] * size <= gyro_size <= SCALE[1] * size:
            return ImuStage.WRONG_GYRO
        return ImuStage(self.stage + 1)


def _rotation(attitude: Sequence[float] | NDArray[np.float64]) -> Rotation:
    """Return R = Rx(theta) Ry(phi) Rz(psi)."""
    return Rotation.from_euler("XYZ", attitude)


def _small_turn(vector: NDArray[np.float64]) -> Rotation:
    """Return the turn of a sample: to first order, as the firmware has it."""
    return Rotation.from_quat([*(0.5 * vector), 1.0])


def _vector(turn: Rotation) -> NDArray[np.float64]:
    """Return axis times sine of half the angle, of the shorter way."""
    x, y, z, w = turn.as_quat().tolist()
    return np.array([x, y, z]) * (-1.0 if w < 0.0 else 1.0)


def _length(vector: Sequence[float] | NDArray[np.float64]) -> float:
    return math.sqrt(sum(value * value for value in vector))
