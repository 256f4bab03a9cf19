"""An accelerometer at a place of the body: the specific force that it feels, averaged over a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class Accelerometer:
    """Where an accelerometer sits and how noisy it is."""

    position: tuple[float, float, float] = (0.0, 0.0, 0.3)  #: from the ball's centre, body frame [m]
    noise: float = 0.02  #: standard deviation of each sample [m/s^2]


class AccelerationSensor:
    """Specific force f = R^T (a + g e_z) + w_dot x r + w x (w x r) at a place r of the body.

    a, the acceleration of the body's point at the ball's centre, and w_dot are differences over the sample: a sensor
    of this kind filters to half its own rate, and a MuJoCo contact's last step would be noise.

    Parameters
    ----------
    accelerometer : Accelerometer
    sample_time : float
        [s]
    gravity : float
        [m/s^2]
    random : Generator
    """

    def __init__(
        self,
        accelerometer: Accelerometer,
        *,
        sample_time: float,
        gravity: float,
        random: np.random.Generator,
    ) -> None:
        self._accelerometer = accelerometer
        self._place = np.array(accelerometer.position)
        self._sample_time = sample_time
        self._gravity = np.array([0.0, 0.0, gravity])
        self._random = random
        self._before: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def read(
        self,
        velocity: NDArray[np.float64],
        body_rate: NDArray[np.float64],
        R_world_body: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return acc_x, acc_y, acc_z (3,) [m/s^2], body frame.

        Parameters
        ----------
        velocity : array (3,)
            Of the body's point at the ball's centre, world frame [m/s].
        body_rate : array (3,)
            Angular velocity w, body frame [rad/s].
        R_world_body : array (3, 3)
            Body to world.
        """
        before = self._before if self._before is not None else (velocity, body_rate)
        acceleration = (velocity - before[0]) / self._sample_time
        turning = (body_rate - before[1]) / self._sample_time
        self._before = (velocity.copy(), body_rate.copy())
        force = R_world_body.T @ (acceleration + self._gravity)
        force += np.cross(turning, self._place) + np.cross(body_rate, np.cross(body_rate, self._place))
        return force + self._accelerometer.noise * self._random.standard_normal(3)
