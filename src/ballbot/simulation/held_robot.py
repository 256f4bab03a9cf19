"""A robot that is held: on the ball, in the air or upside down.

    on_ball        the body is held, the ball lies on the floor: (J_b + m r_b^2 [1 1 0] + (j_w + j_r) A^T A) Omega_dot =
                   A^T (u - tau), because robot and ball roll over the floor together; m is the mass of both
    in_air         the wheels turn freely, each (j_w + j_r) w_dot = u - tau(w)
    upside_down    the ball lies on the wheels (`ballbot.simulation.upside_down`)

`tilt` moves the body as a hand does. On the ball, a foot holds the ball still meanwhile, so that the wheels turn by
-A w under the body's angular velocity w.

All steps before a new robot's first balance can be rehearsed on it.
"""

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.mechanics.geometry import body_rates_matrix
from ballbot.mechanics.held_ball import held_ball_inertia
from ballbot.robot import Robot, Sensors
from ballbot.robot.components import FALLING_PART
from ballbot.simulation.driveline import Driveline, TorqueSpeedCurve, simulate_driveline
from ballbot.simulation.imperfections import DriveLimits
from ballbot.simulation.plant import Measurement
from ballbot.simulation.sensors import SensorSuite, sensor_samples
from ballbot.simulation.upside_down import ClampedBall, simulate_balls

Hold = Literal["on_ball", "in_air", "upside_down"]

#: standard deviation of the ball's angular velocity from a camera [rad/s]; the thesis gives no figure
CAMERA_NOISE = 0.03
#: period of the thesis's sweep [s]
SWEEP_PERIOD = 62.83
#: time in which a hand turns the body by a radian [s]; a shorter turn takes `_SHORTEST_TILT`
_TILT_TIME, _SHORTEST_TILT = 4.0, 0.5


class HeldRobot:
    """A held robot, with its friction, behind the plant's seam.

    The sensors' errors are the robot's own by default; `torque_noise` is the standard deviation of each sample's torque
    [N m].
    """

    def __init__(
        self,
        robot: Robot,
        *,
        sensors: Sensors | None = None,
        hold: Hold = "on_ball",
        torque_noise: float = 0.0,
    ) -> None:
        self._robot, self._hold, self._noise = robot, hold, torque_noise
        self._sensors = robot.sensors if sensors is None else sensors
        self._suite = SensorSuite(self._robot, self._sensors)
        self._ball = _ball_under_hand(self._robot, hold)
        self._limits = DriveLimits(robot)
        drive = robot.drive  # a free wheel has the same limit as `DriveLimits`
        curve = TorqueSpeedCurve(
            no_load_speed=drive.top_speed, stall_torque=drive.torque_limit / FALLING_PART
        )
        self._lines = [Driveline.of_wheel(robot, i, speed_limit=curve) for i in range(robot.wheel_count)]
        self.reset()

    @property
    def robot(self) -> Robot:
        """The robot that the plant is."""
        return self._robot

    @property
    def ball_omega(self) -> NDArray[np.float64]:
        """Angular velocity of the ball (3,), robot frame [rad/s]; zero in the air."""
        return self._omega.copy()

    @property
    def is_tilting(self) -> bool:
        """Whether the hand moves the body."""
        return self._t < self._tilt_end

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:
        """Hold the robot still at x, y, psi of a state (10,), and return the measurement; the seed is of all noise."""
        given = np.zeros(10) if initial_state is None else real_array(initial_state, (10,), "The state")
        self._place = given[:2].copy()
        self._random = np.random.default_rng([seed, 17])
        self._t = self._tilt_begin = self._tilt_end = 0.0
        n = self._robot.wheel_count
        self._angles, self._speeds, self._omega = np.zeros(n), np.zeros(n), np.zeros(3)
        self._level = np.array([math.pi if self._hold == "upside_down" else 0.0, 0.0, float(given[4])])
        self._from = self._to = self._level
        self._suite.reset(self._random, self._angles)
        return self._measure()

    def tilt(self, attitude: ArrayLike) -> None:
        """Let the hand move the body to theta, phi, psi (3,) [rad], from the next sample on.

        InputError if the attitude is not three finite numbers.
        """
        target = real_array(attitude, (3,), "The attitude")
        self._from, _ = self._hand(self._t)
        self._to = target
        self._tilt_begin = self._t
        self._tilt_end = self._t + max(
            _SHORTEST_TILT, _TILT_TIME * float(np.abs(self._to - self._from).max())
        )

    def step(self, torques: NDArray[np.float64], duration: float) -> Measurement:
        """Hold the torques (n,) [N m] for a duration [s], whole samples, and return the measurement at its end."""
        held = real_array(torques, (self._robot.wheel_count,), "The array of torques")
        duration = positive_number(duration, "The duration")
        measured = None
        for _ in range(sensor_samples(duration, self._sensors.sample_time)):
            self._advance(held)
            measured = self._measure()
        assert measured is not None
        return measured

    def _hand(self, t: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return attitude (3,) [rad] and its rates (3,) [rad/s] at t: a half wave of a cosine from one to the next."""
        lasts = self._tilt_end - self._tilt_begin
        if t >= self._tilt_end or lasts <= 0.0:
            return self._to, np.zeros(3)
        phase = math.pi * (t - self._tilt_begin) / lasts
        way = self._to - self._from
        return self._from + 0.5 * (1.0 - math.cos(phase)) * way, 0.5 * math.pi / lasts * math.sin(phase) * way

    def _advance(self, torques: NDArray[np.float64]) -> None:
        """Advance by one sample."""
        h = self._sensors.sample_time
        noise = self._noise * self._random.standard_normal(len(torques))
        if self._ball is None:
            limit = self._robot.drive.torque_limit
            acting = np.clip(torques + noise, -limit, limit)
            motions = [
                simulate_driveline(line, [torque], sample_time=h, initial_speed=speed)
                for line, torque, speed in zip(self._lines, acting, self._speeds, strict=True)
            ]
            self._speeds = np.array([motion.speeds[0] for motion in motions])
            self._angles = self._angles + [motion.angles[0] for motion in motions]
        else:
            self._turn_ball(self._limits.within(torques + noise, self._speeds), h)
        self._t = round(self._t + h, 9)

    def _turn_ball(self, torques: NDArray[np.float64], h: float) -> None:
        """Advance ball and wheels by a sample."""
        assert self._ball is not None
        before = self._speeds
        if self.is_tilting:
            attitude, _ = self._hand(self._t)
            ahead, rates = self._hand(self._t + h)
            body_rate = body_rates_matrix(*ahead) @ rates
            turned = body_rates_matrix(*(0.5 * (attitude + ahead))) @ (ahead - attitude)
            self._omega = np.zeros(3)
            self._speeds = -self._ball.A @ body_rate
            self._angles = self._angles - self._ball.A @ turned
            return
        self._omega = simulate_balls(
            self._ball,
            friction=self._robot.friction,
            initial=self._omega[None],
            torques=torques[None, None],
            sample_time=h,
        )[0, 0]
        self._speeds = self._ball.A @ self._omega
        self._angles = self._angles + 0.5 * h * (before + self._speeds)

    def _measure(self) -> Measurement:
        """Read every sensor once."""
        attitude, rates = self._hand(self._t)
        truth = np.zeros(10)
        truth[:2], truth[2:5], truth[7:10] = self._place, attitude, rates
        body_velocity = np.concatenate([np.zeros(3), body_rates_matrix(*attitude) @ rates])
        from_level = truth.copy()  # the AHRS's errors are those about the attitude in which the robot is held
        from_level[2:5] -= self._level
        reading = self._suite.read(self._t, from_level, body_velocity, self._angles)
        state = truth.copy()
        state[2:5] = attitude_read = self._level + reading.attitude
        return Measurement(
            t=self._t,
            state=state,
            wheel_angles=reading.wheel_angles,
            wheel_speeds=reading.wheel_speeds,
            gyro=reading.gyro,
            attitude=attitude_read,
            truth=truth,
        )


def _ball_under_hand(robot: Robot, hold: Hold) -> ClampedBall | None:
    """Return the ball that the wheels of a held robot turn; None in the air."""
    if hold == "in_air":
        return None
    ball = ClampedBall.of_robot(robot)
    if hold == "upside_down":
        return ball
    return ClampedBall(A=ball.A, inertia=held_ball_inertia(robot))


def sweep_at(times: NDArray[np.float64], wheel_count: int) -> NDArray[np.float64]:
    """Return the thesis's sweep (N, n) at times [s]: a sine of 1 N m and 62.83 s, equal at every wheel (3.1)."""
    return np.repeat(np.sin(2 * np.pi * times / SWEEP_PERIOD)[:, None], wheel_count, axis=1)


def multisine_at(times: NDArray[np.float64], wheel_count: int, *, seed: int) -> NDArray[np.float64]:
    """Return torques (N, n) at times [s] that stir a ball: sines of 0.1 to 2.5 Hz, 0.26 N m in all (RMS).

    The phases follow from the seed.
    """
    frequencies = 0.1 * 25.0 ** (np.arange(10) / 9)
    random = np.random.default_rng([seed, 61])
    phases = random.uniform(0.0, 2 * np.pi, (10, wheel_count))  # U(0, 2 pi)
    # each wheel's sines lie a little apart, so that no two wheels stay in step
    detuned = frequencies[:, None] * (1 + 0.05 * np.arange(wheel_count))
    waves = np.sin(2 * np.pi * times[:, None, None] * detuned + phases)
    return 0.26 * np.sqrt(2 / 10) * waves.sum(axis=1)
