"""A robot's sensors, with their errors: wheel encoders, an AHRS, an accelerometer, and fixes from outside.

Encoders count; the AHRS is noisy and drifts; an accelerometer sits at a place of the body; something outside (cameras,
a laser scanner, beacons) sees where the robot is.

Each is read once a sample, in order of time, and knows nothing of later samples. The errors in the robot file are
always there; `SensorFaults` are those that a scenario adds.

Gravity shows the AHRS which way is up and nothing shows it which way is north, so psi does not drift alone: its whole
frame turns about the vertical, and theta and phi, which are about that frame's axes, with it. So the thesis has it
(Appendix IV): the drift "does not affect the ability of the BBR to balance", but "the world frame of the BBR [...]
slowly drifts". If the lean stayed correct about the world's axes, the wheels would act on it rotated by the
error of psi, and the robot would fall.

The accelerometer at a place r of the body shows the specific force f = R^T (a + g e_z) + w_dot x r + w x (w x r). a,
the acceleration of the body's point at the ball's centre, and w_dot are differences over the sample: a sensor of this
kind filters to half its own rate, and a MuJoCo contact's last step would be noise.
"""

import math
from collections import deque

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import real_array
from ballbot.errors import InputError
from ballbot.estimation.interface import Fix, Reading
from ballbot.estimation.swing import turned_about_vertical
from ballbot.mechanics.geometry import rotation
from ballbot.robot import Robot, Sensors
from ballbot.robot.derived import encoder_step
from ballbot.robot.parameters import parameter, parameter_class


class Encoders:
    """Encoders on the motors' shafts, seen at the wheels: whole counts, and speeds differenced from them.

    The robot's gear ratio multiplies the counts of a motor turn. Counts are differenced over `window` samples: a
    longer window gives smoother speeds, delayed by half of it.
    """

    def __init__(self, robot: Robot, sensors: Sensors, *, window: int = 1) -> None:
        #: [rad] a count, at the wheel
        self.resolution = encoder_step(robot, sensors)
        self._window_time = window * sensors.sample_time
        self._recent = np.zeros((window + 1, robot.wheel_count))
        self._start = np.zeros(robot.wheel_count)

    def reset(self, angles: ArrayLike) -> None:
        """Set the present motor angles (n,) [rad] zero; counts start at a random place only if these do."""
        self._start = real_array(angles, self._start.shape, "The array of motor angles").copy()
        self._recent[:] = 0.0

    def read(self, angles: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the counted angles (n,) [rad] and the speeds (n,) [rad/s] at motor angles (n,) [rad]."""
        seen = real_array(angles, self._start.shape, "The array of motor angles", finite=False)
        counted = np.floor((seen - self._start) / self.resolution) * self.resolution
        self._recent[:-1] = self._recent[1:]
        self._recent[-1] = counted
        return counted, (self._recent[-1] - self._recent[0]) / self._window_time


@parameter_class
class SensorFaults:
    """Errors of an AHRS beyond white noise; all are off at their defaults.

    Its heading is the integral of its gyro, so the bias about the vertical turns its frame away, in addition to the
    drift in the robot's file.
    """

    gyro_bias: float = parameter(
        "standard deviation of each axis at the start; it makes the heading drift",
        "rad/s",
        default=0.0,
        least=0.0,
    )
    gyro_bias_walk: float = parameter("random walk of the biases", "rad/s/sqrt(s)", default=0.0, least=0.0)
    lean_error: float = parameter(
        "standard deviation of a slow error of theta and phi", "rad", default=0.0, least=0.0
    )
    lean_error_time: float = parameter("correlation time of that error", "s", default=10.0, most=1e6)
    latency: float = parameter(
        "delay of gyro and attitude, in whole samples", "s", default=0.0, least=0.0, most=10.0
    )


@parameter_class
class Accelerometer:
    """Where an accelerometer sits and how noisy it is."""

    position: tuple[float, float, float] = parameter(
        "from the ball's centre: forward, left, up", "m", default=(0.0, 0.0, 0.3), least=-math.inf
    )
    noise: float = parameter("standard deviation of each sample", "m/s^2", default=0.02, least=0.0)


@parameter_class
class FixSource:
    """How often a fix comes and how good it is; in the world's frame and at once."""

    rate: float = parameter("fixes per second", "Hz")
    position: bool = parameter("whether it measures x and y", default=True)
    heading: bool = parameter("whether it measures psi", default=True)
    position_noise: float = parameter("standard deviation of x and of y", "m", default=0.005)
    heading_noise: float = parameter("standard deviation of psi", "rad", default=0.02)
    missing: float = parameter("fraction of fixes that are lost", default=0.0, least=0.0, most=1.0)


def sensor_samples(duration: float, sample_time: float) -> int:
    """Return how many samples of the sensors [s] a controller holds its torques for.

    InputError if the duration [s] is not a whole multiple of the sample time, at least one.
    """
    samples = round(duration / sample_time)
    if samples < 1 or abs(duration - samples * sample_time) > 1e-6 * sample_time:
        raise InputError(
            f"The sensors are sampled every {sample_time:g} s, so a controller's sample time must be a whole number of "
            f"these samples, not {duration:g} s."
        )
    return samples


class SensorSuite:
    """All sensors of one robot: encoders and AHRS, and an accelerometer and fixes where there are any.

    The robot gives gear ratio and gravity; its own sensors are not looked at. `window` is the number of samples over
    which encoder counts are differenced into a speed. The first fix comes at 1 / rate.
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
        self._gravity = np.array([0.0, 0.0, robot.gravity])
        self._encoders = Encoders(robot, sensors, window=window)
        self.reset(np.random.default_rng(0), np.zeros(robot.wheel_count))

    def reset(self, random: np.random.Generator, motor_angles: NDArray[np.float64]) -> None:
        """Start a run: all noise follows from `random`, and the motor angles (n,) [rad] count from here."""
        self._encoders.reset(motor_angles)
        self._random = random
        if self._faults is not None:
            faults, self._slow = self._faults, random.spawn(1)[0]
            self._bias = faults.gyro_bias * self._slow.standard_normal(3)  # each axis: N(0, gyro_bias)
            # each angle: N(0, lean_error), and stays so
            self._lean = faults.lean_error * self._slow.standard_normal(2)
            self._heading = 0.0
            self._waiting: deque[tuple[NDArray[np.float64], NDArray[np.float64]]] = deque(
                maxlen=1 + round(faults.latency / self._sensors.sample_time)
            )
        self._shaking = random.spawn(1)[0] if self._accelerometer is not None else None
        self._before: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        self._outside = random.spawn(1)[0] if self._fix is not None else None
        self._taken = 0

    def read(
        self,
        t: float,
        truth: NDArray[np.float64],
        body_velocity: NDArray[np.float64],
        motor_angles: NDArray[np.float64],
    ) -> Reading:
        """Return the readings of a true state (10,) at t [s] since the start, when the AHRS's frame is the world's.

        The velocity (6,) is that of the body's point at the ball's centre, world frame [m/s], and its angular velocity,
        body frame [rad/s]; the motors' angles (n,) [rad] are seen at the wheels.
        """
        rate = body_velocity[3:]
        gyro, attitude = self._read_ahrs(t, rate, truth[2:5])
        wheel_angles, wheel_speeds = self._encoders.read(motor_angles)
        return Reading(
            wheel_angles=wheel_angles,
            wheel_speeds=wheel_speeds,
            gyro=gyro,
            attitude=attitude,
            acceleration=self._read_acceleration(body_velocity[:3], rate, truth[2:5]),
            fix=self._read_fix(t, truth),
        )

    def _read_ahrs(
        self, t: float, rate: NDArray[np.float64], angles: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        sensors = self._sensors
        gyro = rate + sensors.gyro_noise * self._random.standard_normal(3)
        attitude = angles + sensors.attitude_noise * self._random.standard_normal(3)
        drift = sensors.heading_drift * t
        if self._faults is None:
            return gyro, turned_about_vertical(attitude, drift)
        leaning = attitude + np.append(self._lean, 0.0)
        self._waiting.append((gyro + self._bias, turned_about_vertical(leaning, self._heading + drift)))
        self._wander(self._faults, sensors.sample_time)
        return self._waiting[0]

    def _wander(self, faults: SensorFaults, h: float) -> None:
        """Let the slow errors go on by a sample."""
        self._heading += h * float(self._bias[2])
        self._bias = self._bias + faults.gyro_bias_walk * math.sqrt(h) * self._slow.standard_normal(3)
        memory = math.exp(-h / faults.lean_error_time)
        fresh = faults.lean_error * math.sqrt(1.0 - memory**2)
        self._lean = memory * self._lean + fresh * self._slow.standard_normal(2)

    def _read_acceleration(
        self, velocity: NDArray[np.float64], rate: NDArray[np.float64], angles: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        if self._accelerometer is None or self._shaking is None:
            return None
        before = self._before if self._before is not None else (velocity, rate)
        acceleration, turning = (
            (now - last) / self._sensors.sample_time
            for now, last in zip((velocity, rate), before, strict=True)
        )
        self._before = (velocity.copy(), rate.copy())
        position = np.array(self._accelerometer.position)
        force = rotation(*angles).T @ (acceleration + self._gravity)
        force += np.cross(turning, position) + np.cross(rate, np.cross(rate, position))
        return force + self._accelerometer.noise * self._shaking.standard_normal(3)

    def _read_fix(self, t: float, truth: NDArray[np.float64]) -> Fix | None:
        """Return the fix that has come by now, if one has."""
        source = self._fix
        if source is None or self._outside is None:
            return None
        due = math.floor(t * source.rate + 1e-9)
        if due <= self._taken:
            return None
        self._taken = due
        # the same draws for each fix, whether it comes or not and whatever it has
        chance, (east, north, turn) = self._outside.random(), self._outside.standard_normal(3)
        if chance < source.missing:
            return None
        return Fix(
            position=truth[:2] + source.position_noise * np.array([east, north]) if source.position else None,
            heading=float(truth[4] + source.heading_noise * turn) if source.heading else None,
            position_deviation=source.position_noise,
            heading_deviation=source.heading_noise,
        )
