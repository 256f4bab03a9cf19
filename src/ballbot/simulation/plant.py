"""The seam between a plant and everything that drives one.

A plant is anything that takes wheel torques and gives measurements: the exact model, the MuJoCo twin, a
user's own simulator, a robot on a wire. `simulation.run` and what is built on it use only this interface; the compiled
loop (`simulation.loop`) has robots of its own.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A plant's measurement at one instant.

    The ten states are x, y [m], theta, phi, psi [rad] and their rates, in the world frame; n is the
    number of wheels.
    """

    t: float  #: time since the reset [s]
    state: NDArray[np.float64]  #: (10,) the state as the on-board sensors have it
    wheel_angles: NDArray[np.float64]  #: (n,) encoder angles, zero at the reset [rad]
    wheel_speeds: NDArray[np.float64]  #: (n,) speeds derived from them [rad/s]
    gyro: NDArray[np.float64]  #: (3,) angular velocity of the body, body frame [rad/s]
    acceleration: NDArray[np.float64] | None = None  #: (3,) specific force, body frame [m/s^2]
    attitude: NDArray[np.float64] | None = None  #: (3,) theta, phi, psi of an AHRS [rad]
    truth: NDArray[np.float64]  #: (10,) the true state; not for controllers
    #: whether the sensors gave all that the state needs; if not, it is the estimator's prediction
    valid: bool = True
    ended: str | None = None  #: why the run must stop ("fallen: ..."), or None


@runtime_checkable
class Plant(Protocol):
    """Wheel torques in, measurements out."""

    @property
    def robot(self) -> Robot:
        """The robot that the plant is."""
        ...

    def reset(self, initial_state: ArrayLike | None, *, seed: int) -> Measurement:
        """Start again at t = 0 from a true state (10,), or upright at rest at the origin; return the first measurement.

        Everything random in the run to come follows from the seed: equal seeds give equal runs, bit for bit.
        """
        ...

    def step(self, torques: NDArray[np.float64], duration: float) -> Measurement:
        """Hold the torques (n,) [N m] for a duration [s] and return the measurement at its end."""
        ...
