"""The on-board state, the thesis's way (Appendices I and V): an AHRS and wheel encoders, nothing else.

    z = T_obw wheel_speed + w      ball's angular velocity, body frame (wheels see z - w)
    Omega = R z                    the same, world frame
    v = r_b (Omega_y, -Omega_x)    velocity of a ball that rolls without slip
    Phi_dot = B^-1 w               rates of theta, phi, psi
    x, y                           the sum of v from the start: an error here is never corrected

It cannot measure slip, the play between encoder and wheel, or the drift of its own heading. A value that is missing
(NaN) is predicted: the gyro's and v stay as they were, theta, phi and psi go on at their last rates.
"""

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.estimation.heading import Heading
from ballbot.estimation.interface import Reading, all_known, checked_reading, known
from ballbot.mechanics.geometry import angle_rates, rotation, transforms
from ballbot.robot import Robot


class OnboardState:
    """The ten states from wheel speeds, gyro and attitude, updated every `sample_time` [s] without look-ahead.

    InputError if the sample time is not positive.

    >>> estimator = OnboardState(Robot.load("alten"), sample_time=0.005)
    >>> zero = np.zeros(3)
    >>> turning = Reading(wheel_angles=zero, wheel_speeds=zero, gyro=np.array([0.2, 0.0, 0.0]), attitude=zero)
    >>> estimator.update(turning)[7].item()  # theta_dot
    0.2
    """

    def __init__(self, robot: Robot, *, sample_time: float) -> None:
        if not sample_time > 0:
            raise InputError(f"The sample time of an on-board state must be above 0 s, not {sample_time}.")
        self.robot = robot
        self.sample_time = sample_time
        self._ball_from_wheels = transforms(robot).T_obw
        self._position = np.zeros(2)
        self._velocity: Floats | None = None
        self._gyro, self._attitude = np.zeros(3), np.zeros(3)
        self._heading = Heading()

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset to the position (x, y) [m]."""
        self._position = np.array(position, dtype=np.float64)
        self._velocity = None
        self._heading = Heading()

    def update(self, reading: Reading) -> Floats:
        """Take one sample and return the state (10,), all NaN until a reading is complete.

        Wheel speeds, gyro and attitude are used, and no fix. InputError if the reading has the wrong number of wheels.
        """
        _, speeds, gyro, attitude = checked_reading(reading, self.robot.wheel_count)
        rolls, turns, leans = all_known(speeds), all_known(gyro), all_known(attitude)
        if self._velocity is None and not (rolls and turns and leans):
            return np.full(10, np.nan)
        gyro = gyro.copy() if turns else np.where(known(gyro), gyro, self._gyro)
        attitude = attitude.copy()
        if known(attitude[2]):
            attitude[2] = self._heading.unwrapped(float(attitude[2]))
        if not leans:
            ahead = self._attitude + self.sample_time * angle_rates(self._attitude, self._gyro)
            attitude = np.where(known(attitude), attitude, ahead)
        self._gyro, self._attitude = gyro, attitude
        velocity = (
            self._rolling(speeds, gyro, attitude) if rolls or self._velocity is None else self._velocity
        )
        if self._velocity is not None:  # trapezoid between this sample and the one before
            self._position = self._position + 0.5 * self.sample_time * (velocity + self._velocity)
        self._velocity = velocity
        return np.concatenate((self._position, attitude, velocity, angle_rates(attitude, gyro)))

    def _rolling(self, speeds: Floats, gyro: Floats, attitude: Floats) -> Floats:
        """Return v (2,) [m/s] of the ball."""
        theta, phi, psi = attitude
        ball_rate = rotation(theta, phi, psi) @ (self._ball_from_wheels @ speeds + gyro)
        radius = self.robot.ball.radius
        return np.array([radius * ball_rate[1], -radius * ball_rate[0]])
