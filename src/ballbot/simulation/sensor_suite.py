"""All sensors of one robot, read together once a sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.estimation.interface import Reading
from ballbot.mechanics.geometry import rotation
from ballbot.robot.robot import Robot, Sensors
from ballbot.simulation.accelerometer import AccelerationSensor, Accelerometer
from ballbot.simulation.fixes import FixSensor, FixSource
from ballbot.simulation.sensors import AttitudeSensor, Encoders, SensorFaults


def sensor_samples(duration: float, sample_time: float) -> int:
    """Return how many samples of the sensors [s] a controller holds its torques for.

    Raises
    ------
    InputError
        If the duration [s] is not a whole multiple of the sample time, at least one.
    """
    samples = round(duration / sample_time)
    if samples < 1 or abs(duration - samples * sample_time) > 1e-6 * sample_time:
        raise InputError(
            f"The sensors are sampled every {sample_time:g} s, so a controller's sample time must be a whole number of "
            f"these samples, not {duration:g} s."
        )
    return samples


class SensorSuite:
    """Encoders and AHRS, and an accelerometer and fixes where there are any.

    Parameters
    ----------
    robot : Robot
        Gear ratio and gravity; its own sensors are not looked at.
    sensors : Sensors
        What the sensors are.
    window : int
        Samples over which encoder counts are differenced into a speed.
    faults : SensorFaults, optional
        What the AHRS does besides being noisy.
    accelerometer : Accelerometer, optional
    fix : FixSource, optional
    """

    def __init__(
        self,
        robot: Robot,
        sensors: Sensors,
        *,
        window: int = 1,
        faults: SensorFaults | None = None,
        accelerometer: Accelerometer | None = None,
        fix: FixSource | None = None,
    ) -> None:
        self._sensors, self._faults = sensors, faults
        self._accelerometer, self._fix = accelerometer, fix
        self._gravity = robot.gravity
        self._encoders = Encoders(robot, sensors, window=window)
        self.reset(np.random.default_rng(0), np.zeros(robot.wheel_count))

    def reset(self, random: np.random.Generator, motor_angles: NDArray[np.float64]) -> None:
        """Start a run: all noise follows from `random`, and the motor angles (n,) [rad] count from here."""
        self._encoders.reset(motor_angles)
        self._imu = AttitudeSensor(self._sensors, random, self._faults)
        self._acceleration, self._fixes = None, None
        if self._accelerometer is not None:
            self._acceleration = AccelerationSensor(
                self._accelerometer,
                sample_time=self._sensors.sample_time,
                gravity=self._gravity,
                random=random.spawn(1)[0],
            )
        if self._fix is not None:
            self._fixes = FixSensor(self._fix, random.spawn(1)[0])

    def read(
        self,
        t: float,
        truth: NDArray[np.float64],
        body_velocity: NDArray[np.float64],
        motor_angles: NDArray[np.float64],
    ) -> Reading:
        """Return what the sensors say.

        Parameters
        ----------
        t : float
            Time since the start [s].
        truth : array (10,)
            The state as it is.
        body_velocity : array (6,)
            Velocity of the body's point at the ball's centre, world frame [m/s]; angular velocity, body frame [rad/s].
        motor_angles : array (n,)
            Of the motors, seen at the wheels [rad].
        """
        rate = body_velocity[3:]
        gyro, attitude = self._imu.read(t, rate, truth[2:5])
        wheel_angles, wheel_speeds = self._encoders.read(motor_angles)
        acceleration = None
        if self._acceleration is not None:
            acceleration = self._acceleration.read(body_velocity[:3], rate, rotation(*truth[2:5]))
        return Reading(
            wheel_angles=wheel_angles,
            wheel_speeds=wheel_speeds,
            gyro=gyro,
            attitude=attitude,
            acceleration=acceleration,
            fix=self._fixes.read(t, truth) if self._fixes else None,
        )
