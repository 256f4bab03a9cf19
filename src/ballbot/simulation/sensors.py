"""The robot's own sensors, as they err: wheel encoders that count, an AHRS that is noisy and drifts.

Each is asked once a sample, in order of time, and knows nothing of what comes next.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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

    def reset(self, angles: NDArray[np.float64]) -> None:
        """Call the present motor angles (n,) [rad] zero; counts start at a random place only if these do."""
        self._start = angles.copy()
        self._recent[:] = 0.0

    def read(self, angles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the counted angles (n,) [rad] and the speeds (n,) [rad/s] at motor angles (n,) [rad]."""
        counted = np.floor((angles - self._start) / self.resolution) * self.resolution
        self._recent[:-1] = self._recent[1:]
        self._recent[-1] = counted
        return counted, (self._recent[-1] - self._recent[0]) / self._window_time


class AttitudeSensor:
    """An AHRS: angular velocity and attitude with white noise, and a heading that runs away at a steady rate.

    Parameters
    ----------
    sensors : Sensors
        Sizes of the errors.
    random : Generator
        Source of the noise.
    """

    def __init__(self, sensors: Sensors, random: np.random.Generator) -> None:
        self._sensors = sensors
        self._random = random

    def read(
        self, t: float, body_rate: NDArray[np.float64], attitude: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return gyro (3,) [rad/s] and theta, phi, psi (3,) [rad] as the sensor has them.

        Parameters
        ----------
        t : float
            Time since the start [s]; the heading is right at 0.
        body_rate : array (3,)
            True angular velocity, body frame [rad/s].
        attitude : array (3,)
            True theta, phi, psi [rad].
        """
        gyro = body_rate + self._sensors.gyro_noise * self._random.standard_normal(3)
        measured = attitude + self._sensors.attitude_noise * self._random.standard_normal(3)
        measured[2] += self._sensors.heading_drift * t
        return gyro, measured
