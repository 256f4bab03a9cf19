"""The seam between a robot's sensors and the state made from them: readings, estimators by name, and their errors."""

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike

from ballbot.arrays import Bools, Floats, real_array
from ballbot.errors import InputError, suggest
from ballbot.estimation.heading import Heading
from ballbot.estimation.known import LARGEST_READING, Shown


@dataclass(frozen=True, kw_only=True)
class Fix:
    """A pose measured from outside the robot, by cameras, a laser scanner or a beacon.

    Either part may be missing, as None or as NaN. A deviation is a standard deviation, above 0.
    """

    position: Floats | None = None  #: (2,) x, y of the ball's centre, world frame [m]
    heading: float | None = None  #: psi, world frame; whole turns do not matter [rad]
    position_deviation: float = 0.005  #: [m]
    heading_deviation: float = 0.02  #: [rad]

    def __post_init__(self) -> None:
        if self.position is not None:
            position = real_array(self.position, (2,), "position of a fix, x and y,", finite=False)
            object.__setattr__(self, "position", position)
        for name in ("position_deviation", "heading_deviation"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} of a fix must be above 0, not {getattr(self, name)}.")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """The readings of all sensors at one instant; n is the number of wheels. A value that is missing is NaN."""

    wheel_angles: Floats  #: (n,) encoder angles, relative to the body [rad]
    wheel_speeds: Floats  #: (n,) speeds derived from them [rad/s]
    gyro: Floats  #: (3,) angular velocity of the body, body frame [rad/s]
    #: (3,) theta, phi, psi as the AHRS has them; psi may begin again after a turn [rad]
    attitude: Floats
    #: (3,) specific force of an accelerometer, body frame [m/s^2]
    acceleration: Floats | None = None
    fix: Fix | None = None  #: rarely available

    @property
    def whole(self) -> bool:
        """Whether encoders, gyro and attitude have every value; else an estimator predicts what is missing."""
        needed = (self.wheel_angles, self.wheel_speeds, self.gyro, self.attitude)
        return bool(known(np.concatenate(needed)).all())


def known(values: ArrayLike) -> Bools:
    """Return which of a sensor's values (...) are valid: finite, and within a sensor's range."""
    return np.abs(values) <= LARGEST_READING


def checked_reading(reading: Reading, wheel_count: int, heading: Heading) -> Shown:
    """Return what compiled code takes of a reading, with psi as the heading goes on.

    InputError if a shape is wrong, or values are not numbers.
    """

    def checked(name: str, count: int) -> Floats:
        return real_array(getattr(reading, name), (count,), f"{name} of a reading", finite=False)

    n, attitude = wheel_count, checked("attitude", 3).copy()
    if abs(attitude[2]) <= LARGEST_READING:
        attitude[2] = heading.unwrapped(attitude[2])
    return Shown(checked("wheel_angles", n), checked("wheel_speeds", n), checked("gyro", 3), attitude)


class Estimator(Protocol):
    """Turn readings into states. Predicts across missing values (NaN)."""

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset: the robot stands still at (x, y) [m] when the next reading comes."""
        ...

    def update(self, reading: Reading) -> Floats:
        """Take one sample and return the state (10,): x, y, theta, phi, psi and their rates, world frame."""
        ...


_MINUTE = 60.0


@dataclass(frozen=True, kw_only=True)
class EstimationErrors:
    """Root-mean-square errors over a run; two components count together."""

    lean: float  #: theta and phi [rad]
    rate: float  #: theta_dot, phi_dot and psi_dot [rad/s]
    velocity: float  #: of the ball [m/s]
    heading: float  #: psi [rad]
    position: float  #: [m]
    position_drift: float  #: change of the position's error within a minute [m]; NaN if the run is shorter


def state_errors(t: Floats, states: Floats, truth: Floats) -> EstimationErrors:
    """Return the errors of estimated states (N, 10) against the true ones (N, 10), at even times t (N,) [s]."""
    error = states - truth
    rows = round(_MINUTE * (len(t) - 1) / float(t[-1] - t[0]))
    drift = error[rows:, :2] - error[:-rows, :2]

    def size(errors: Floats) -> float:
        return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))

    return EstimationErrors(
        lean=size(error[:, 2:4]),
        rate=size(error[:, 7:10]),
        velocity=size(error[:, 5:7]),
        heading=size(error[:, 4:5]),
        position=size(error[:, :2]),
        position_drift=size(drift) if len(drift) else float("nan"),
    )


#: the thesis's way; the Kalman filter, which also uses fixes
EstimatorName = Literal["onboard", "kalman"]


def checked_name(name: str) -> EstimatorName:
    """Return the name of an estimator; InputError if the name is unknown."""
    for known in get_args(EstimatorName):
        if name == known:
            return known
    hint = suggest(name, get_args(EstimatorName), otherwise="the estimators are")
    raise InputError(f"There is no estimator {name!r}; {hint}")
