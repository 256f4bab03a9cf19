"""A robot's sensors, with their errors: wheel encoders, an AHRS, an accelerometer, and fixes from outside.

Encoders count; the AHRS is noisy and drifts; an accelerometer sits at a place of the body; something outside (cameras,
a laser scanner, beacons) sees where the robot is.

Each is read once a sample, in order of time, and knows nothing of later samples. The errors in the robot file are
always there; `SensorFaults` are those that a scenario adds. Encoders and AHRS are compiled: the loop
(`ballbot.simulation.loop`) reads those of robots side by side, `SensorSuite` those of one.

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
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.estimation.interface import Fix, Reading
from ballbot.estimation.known import Shown
from ballbot.estimation.swing import attitude_of, swing_of
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.geometry import rotation
from ballbot.records import number, packed, schema_of, whole
from ballbot.robot import Robot, Sensors
from ballbot.robot.derived import encoder_step
from ballbot.robot.parameters import parameter, parameter_class


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


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorRecord:
    """The numbers of one robot's encoders and AHRS."""

    count: float = field(metadata=number("rad"))  #: of an encoder, at the wheel
    window: int = field(metadata=whole())  #: samples over which counts are differenced into a speed
    gyro_noise: float = field(metadata=number("rad/s"))
    attitude_noise: float = field(metadata=number("rad"))
    heading_drift: float = field(metadata=number("rad/s"))
    latency: int = field(metadata=whole())  #: whole samples by which gyro and attitude are late
    gyro_bias: float = field(metadata=number("rad/s"))
    bias_step: float = field(metadata=number("rad/s"))  #: a sample's step of the biases
    lean_error: float = field(metadata=number("rad"))
    #: what stays of the lean's error in a sample, and the step that comes upon it
    lean_memory: float = field(metadata=number("1"))
    lean_step: float = field(metadata=number("rad"))
    sample_time: float = field(metadata=number("s"))


SENSORS = schema_of(SensorRecord)
_SENSORS_TYPE = SENSORS.dtype()


def sensor_record(
    robot: Robot, sensors: Sensors, *, sample_time: float, window: int = 1, faults: SensorFaults | None = None
) -> SensorRecord:
    """Return the numbers of the encoders and the AHRS of a robot, which gives the gear ratio."""
    faults = faults or SensorFaults()
    memory = math.exp(-sample_time / faults.lean_error_time)
    return SensorRecord(
        count=encoder_step(robot, sensors),
        window=window,
        gyro_noise=sensors.gyro_noise,
        attitude_noise=sensors.attitude_noise,
        heading_drift=sensors.heading_drift,
        latency=round(faults.latency / sample_time),
        gyro_bias=faults.gyro_bias,
        bias_step=faults.gyro_bias_walk * math.sqrt(sample_time),
        lean_error=faults.lean_error,
        lean_memory=memory,
        lean_step=faults.lean_error * math.sqrt(1.0 - memory**2),
        sample_time=sample_time,
    )


class SensorMemory(NamedTuple):
    """What the sensors of one robot keep from sample to sample; zeros at the start."""

    counted: NDArray[np.float64]  #: (1 + longest window, n) encoder angles at the last samples
    errors: NDArray[np.float64]  #: (6,) of the AHRS: biases, errors of the lean, heading of its frame
    late: NDArray[np.float64]  #: (1 + longest latency, 6) gyro and attitude at the last samples


def new_sensor_memory(*robots: int, wheels: int, window: int, latency: int) -> SensorMemory:
    """Return a memory of one robot, or of so many."""
    return SensorMemory(
        counted=np.zeros((*robots, 1 + window, wheels)),
        errors=np.zeros((*robots, 6)),
        late=np.zeros((*robots, 1 + latency, 6)),
    )


@inlined
def _read_encoders(record, memory, sample, angles, speeds):
    """Turn motor angles (n,) since the start into counted ones, and fill the speeds (n,) differenced from them."""
    recent = memory.counted
    now, before = sample % len(recent), (sample - record.window) % len(recent)
    passed = record.window * record.sample_time
    for i in range(len(angles)):
        angles[i] = math.floor(angles[i] / record.count) * record.count
        recent[now, i] = angles[i]
        earlier = recent[before, i] if sample >= record.window else 0.0
        speeds[i] = (angles[i] - earlier) / passed


@inlined
def _read_ahrs(record, memory, sample, t, noise, faults, gyro, angles):
    """Turn the true gyro and angles (3,) at t [s] into what the AHRS shows.

    Standard normal numbers: `noise` (6,) for the gyro and the angles, `faults` (10,) for the errors of the start and
    their steps in this sample; the errors stay zero if these are empty.
    """
    errors = memory.errors
    if sample == 0 and len(faults) > 0:
        for i in range(3):
            errors[i] = record.gyro_bias * faults[i]
        for i in range(2):
            errors[3 + i] = record.lean_error * faults[3 + i]
    for i in range(3):
        gyro[i] += record.gyro_noise * noise[i] + errors[i]
        angles[i] += record.attitude_noise * noise[3 + i]
    angles[0] += errors[3]
    angles[1] += errors[4]
    drift = record.heading_drift * t + errors[5]
    if drift != 0.0:
        swing = swing_of(angles[0], angles[1], angles[2])
        turned = attitude_of(swing.g_x, swing.g_y, swing.heading + drift)
        angles[0], angles[1], angles[2] = turned.theta, turned.phi, turned.psi
    if len(faults) > 0:
        errors[5] += record.sample_time * errors[2]
        for i in range(3):
            errors[i] += record.bias_step * faults[5 + i]
        for i in range(2):
            errors[3 + i] = record.lean_memory * errors[3 + i] + record.lean_step * faults[8 + i]
    if record.latency > 0:
        now, old = memory.late[sample % len(memory.late)], max(sample - record.latency, 0) % len(memory.late)
        for i in range(3):
            now[i], now[3 + i] = gyro[i], angles[i]
        for i in range(3):
            gyro[i], angles[i] = memory.late[old, i], memory.late[old, 3 + i]


@inlined
def read_sensors(record, memory, sample, t, noise, faults, shown):
    """Turn the true values at t [s] into what the sensors show; for the numbers see `_read_ahrs`."""
    _read_ahrs(record, memory, sample, t, noise, faults, shown.gyro, shown.attitude)
    _read_encoders(record, memory, sample, shown.wheel_angles, shown.wheel_speeds)


@compiled
def _read(record, memory, sample, t, noise, faults, shown):
    read_sensors(record.view(_SENSORS_TYPE)[0], memory, sample, t, noise, faults, shown)


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

    The robot gives gear ratio and gravity; its own sensors are not looked at. Encoders sit on the motors' shafts and
    count from the angles of the reset on. `window` is the number of samples over which counts are differenced into a
    speed: a longer one gives smoother speeds, delayed by half of it. The first fix comes at 1 / rate.
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
        self._sample_time, self._faulty = sensors.sample_time, faults is not None
        self._accelerometer, self._fix = accelerometer, fix
        self._gravity = np.array([0.0, 0.0, robot.gravity])
        record = sensor_record(robot, sensors, sample_time=self._sample_time, window=window, faults=faults)
        self._record = packed(record)
        self._memory = new_sensor_memory(
            wheels=robot.wheel_count, window=record.window, latency=record.latency
        )
        self.reset(np.random.default_rng(0), np.zeros(robot.wheel_count))

    def reset(self, random: np.random.Generator, motor_angles: NDArray[np.float64]) -> None:
        """Start a run: all noise follows from `random`, and the motor angles (n,) [rad] count from here."""
        self._random, self._start, self._sample = random, motor_angles.copy(), 0
        self._memory.errors[:] = 0.0
        self._slow = random.spawn(1)[0] if self._faulty else None
        self._faults = np.empty(10 if self._faulty else 0)
        if self._slow is not None:
            self._slow.standard_normal(out=self._faults[:5])
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
        shown = Shown(
            wheel_angles=motor_angles - self._start,
            wheel_speeds=np.empty(len(motor_angles)),
            gyro=body_velocity[3:].copy(),
            attitude=truth[2:5].copy(),
        )
        noise = self._random.standard_normal(6)
        if self._slow is not None:
            self._slow.standard_normal(out=self._faults[5:])
        _read(self._record, self._memory, self._sample, float(t), noise, self._faults, shown)
        self._sample += 1
        return Reading(
            **shown._asdict(),
            acceleration=self._read_acceleration(body_velocity[:3], body_velocity[3:], truth[2:5]),
            fix=self._read_fix(t, truth),
        )

    def _read_acceleration(
        self, velocity: NDArray[np.float64], rate: NDArray[np.float64], angles: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        if self._accelerometer is None or self._shaking is None:
            return None
        before = self._before if self._before is not None else (velocity, rate)
        acceleration, turning = (
            (now - last) / self._sample_time for now, last in zip((velocity, rate), before, strict=True)
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
