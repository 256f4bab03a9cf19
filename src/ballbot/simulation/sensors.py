"""The robot's own sensors, as they err: wheel encoders that count, an AHRS that is noisy and drifts.

Each is asked once a sample, in order of time, and knows nothing of what comes next. What a robot file says of its
sensors is always there; `SensorFaults` are what a scenario puts upon that.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import real_array
from ballbot.errors import InputError
from ballbot.estimation.swing import turned_about_vertical
from ballbot.robot.derived import encoder_step
from ballbot.robot.robot import Robot, Sensors


class Encoders:
    """Encoders on the motors' shafts, seen at the wheels: whole counts, and speeds differenced from them.

    Parameters
    ----------
    robot : Robot
        Its gear ratio multiplies the counts of a motor turn.
    sensors : Sensors
        Counts a motor turn and sample time.
    window : int
        Samples over which counts are differenced into a speed; more are smoother, and later by half as much.
    """

    def __init__(self, robot: Robot, sensors: Sensors, *, window: int = 1) -> None:
        #: [rad] a count, at the wheel
        self.resolution = encoder_step(
            encoder_counts=sensors.encoder_counts, gear_ratio=robot.drive.gear_ratio
        )
        self._window_time = window * sensors.sample_time
        self._recent = np.zeros((window + 1, robot.wheel_count))
        self._start = np.zeros(robot.wheel_count)

    def reset(self, angles: ArrayLike) -> None:
        """Call the present motor angles (n,) [rad] zero; counts start at a random place only if these do."""
        self._start = real_array(angles, self._start.shape, "The array of motor angles").copy()
        self._recent[:] = 0.0

    def read(self, angles: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the counted angles (n,) [rad] and the speeds (n,) [rad/s] at motor angles (n,) [rad].

        Raises
        ------
        InputError
            If they are not n numbers.
        """
        seen = real_array(angles, self._start.shape, "The array of motor angles", finite=False)
        counted = np.floor((seen - self._start) / self.resolution) * self.resolution
        self._recent[:-1] = self._recent[1:]
        self._recent[-1] = counted
        return counted, (self._recent[-1] - self._recent[0]) / self._window_time


@dataclass(frozen=True, kw_only=True)
class SensorFaults:
    """What an AHRS does besides being noisy; all of it is off at its default.

    Its heading is the integral of its gyro, so the bias about the vertical turns its frame away, in addition to the
    drift that the robot's file says.
    """

    gyro_bias: float = 0.0  #: standard deviation of each axis's bias at the start [rad/s]
    gyro_bias_walk: float = 0.0  #: how the biases wander [rad/s/sqrt(s)]
    lean_error: float = 0.0  #: standard deviation of a slow error of theta and of phi [rad]
    lean_error_time: float = 10.0  #: over which that forgets itself [s]
    latency: float = 0.0  #: gyro and attitude come later by this, in whole samples [s]

    def __post_init__(self) -> None:
        for name in ("gyro_bias", "gyro_bias_walk", "lean_error", "latency"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(f"{name} of the sensor faults is {value}; it must be zero or more.")
        if not (math.isfinite(self.lean_error_time) and self.lean_error_time > 0):
            raise InputError(
                f"lean_error_time of the sensor faults is {self.lean_error_time}; it must be above 0 s."
            )


class AttitudeSensor:
    """An AHRS: angular velocity and attitude with white noise, in a frame that turns away from the world's.

    Gravity tells it which way is up and nothing tells it which way is north, so what runs away is not psi alone: its
    whole frame turns about the vertical, and theta and phi, which are about that frame's axes, with it. So the thesis
    has it (Appendix IV): the drift "does not affect the ability of the BBR to balance", but "the world frame of the BBR
    [...] slowly drifts". A lean that stayed right about the world's axes would be turned away from the wheels by as
    much as psi is wrong, until the robot falls.

    Parameters
    ----------
    sensors : Sensors
        Sizes of the errors.
    random : Generator
        Source of the noise; what the faults draw is a stream of its own.
    faults : SensorFaults, optional
        What it does besides.
    """

    def __init__(
        self, sensors: Sensors, random: np.random.Generator, faults: SensorFaults | None = None
    ) -> None:
        self._sensors = sensors
        self._random = random
        self._errors = _SlowErrors(faults, sensors.sample_time, random.spawn(1)[0]) if faults else None

    def read(
        self, t: float, body_rate: ArrayLike, attitude: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return gyro (3,) [rad/s] and theta, phi, psi (3,) [rad] as the sensor has them.

        Parameters
        ----------
        t : float
            Time since the start [s]; the frame is the world's at 0.
        body_rate : array_like (3,)
            True angular velocity, body frame [rad/s].
        attitude : array_like (3,)
            True theta, phi, psi [rad].

        Raises
        ------
        InputError
            If either is not three numbers.
        """
        rate = real_array(body_rate, (3,), "The body rate", finite=False)
        angles = real_array(attitude, (3,), "The attitude", finite=False)
        gyro = rate + self._sensors.gyro_noise * self._random.standard_normal(3)
        measured = angles + self._sensors.attitude_noise * self._random.standard_normal(3)
        drift = self._sensors.heading_drift * t
        if self._errors is not None:
            return self._errors.upon(gyro, measured, drift)
        return gyro, turned_about_vertical(measured, drift)


class _SlowErrors:
    """The faults of one AHRS in one run."""

    def __init__(self, faults: SensorFaults, sample_time: float, random: np.random.Generator) -> None:
        self._faults = faults
        self._sample_time = sample_time
        self._random = random
        self._bias = faults.gyro_bias * random.standard_normal(3)  # each axis: N(0, gyro_bias)
        self._lean = faults.lean_error * random.standard_normal(
            2
        )  # each angle: N(0, lean_error), and stays so
        self._memory = math.exp(-sample_time / faults.lean_error_time)
        self._heading = 0.0
        self._waiting: deque[tuple[NDArray[np.float64], NDArray[np.float64]]] = deque(
            maxlen=1 + round(faults.latency / sample_time)
        )

    def upon(
        self, gyro: NDArray[np.float64], attitude: NDArray[np.float64], drift: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return gyro (3,) and attitude (3,) with the faults upon them, drift [rad] being that of the robot's file."""
        leaning = attitude + np.append(self._lean, 0.0)
        self._waiting.append((gyro + self._bias, turned_about_vertical(leaning, self._heading + drift)))
        self._wander()
        return self._waiting[0]

    def _wander(self) -> None:
        faults, h = self._faults, self._sample_time
        self._heading += h * float(self._bias[2])
        self._bias = self._bias + faults.gyro_bias_walk * math.sqrt(h) * self._random.standard_normal(3)
        fresh = faults.lean_error * math.sqrt(1.0 - self._memory**2)
        self._lean = self._memory * self._lean + fresh * self._random.standard_normal(2)
