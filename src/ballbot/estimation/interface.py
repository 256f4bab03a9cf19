"""The seam between a robot's sensors and whoever makes the state of what they say.

An estimator gets one reading a sample, in order of time, and answers at once: it knows nothing of what comes
next, so that what is tried here runs on a robot as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Fix:
    """Where something outside the robot sees it now: cameras, a laser scanner, a beacon.

    Either part may be missing, as None or as NaN; a deviation is the standard deviation of each number that is there.

    Raises
    ------
    InputError
        Where the position is not of two numbers, or a deviation is not above 0.
    """

    position: NDArray[np.float64] | None = None  #: (2,) x, y of the ball's centre, world frame [m]
    heading: float | None = None  #: psi, world frame; whole turns do not matter [rad]
    position_deviation: float = 0.005  #: [m]
    heading_deviation: float = 0.02  #: [rad]

    def __post_init__(self) -> None:
        if self.position is not None and self.position.shape != (2,):
            raise InputError(f"position of a fix must be (2,), x and y, not {self.position.shape}.")
        for name in ("position_deviation", "heading_deviation"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} of a fix must be above 0, not {getattr(self, name)}.")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What all sensors say at one instant; n is the number of wheels."""

    wheel_angles: NDArray[np.float64]  #: (n,) encoder angles, relative to the body [rad]
    wheel_speeds: NDArray[np.float64]  #: (n,) speeds derived from them [rad/s]
    gyro: NDArray[np.float64]  #: (3,) angular velocity of the body, body frame [rad/s]
    attitude: NDArray[
        np.float64
    ]  #: (3,) theta, phi, psi as the AHRS has them, psi without jumps of a turn [rad]
    acceleration: NDArray[np.float64] | None = (
        None  #: (3,) specific force of an accelerometer, body frame [m/s^2]
    )
    fix: Fix | None = None  #: seldom there


class Estimator(Protocol):
    """Readings in, states out."""

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Forget the past; the robot stands still at (x, y) [m] when the next reading comes."""
        ...

    def update(self, reading: Reading) -> NDArray[np.float64]:
        """Take one sample and return the state (10,): x, y, theta, phi, psi and their rates, world frame."""
        ...
