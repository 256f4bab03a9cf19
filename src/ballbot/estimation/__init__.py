"""Estimate the state from the robot's own sensors, and from a fix if there is one.

`OnboardState` is the thesis's way. `ballbot.estimation.kalman.KalmanFilter`, the better one, is compiled and comes
from its own file, so that Numba is loaded only if it is used; `named_estimator` makes either.
"""

from ballbot.estimation.interface import Estimator, EstimatorName, Fix, Reading, checked_name
from ballbot.estimation.onboard import OnboardState
from ballbot.robot import Robot

__all__ = ["Estimator", "Fix", "OnboardState", "Reading", "named_estimator"]


def named_estimator(name: EstimatorName, robot: Robot, *, sample_time: float) -> Estimator:
    """Return a new estimator of a robot, updated every sample time [s].

    InputError if no estimator has that name, or the sample time is not positive.

    >>> estimator = named_estimator("onboard", Robot.load("alten"), sample_time=0.005)
    >>> zero = np.zeros(3)
    >>> leaning = Reading(wheel_angles=zero, wheel_speeds=zero, gyro=zero, attitude=np.array([0.01, 0.0, 0.0]))
    >>> estimator.update(leaning)[2].item()
    0.01
    """
    if checked_name(name) == "onboard":
        return OnboardState(robot, sample_time=sample_time)
    from ballbot.estimation.kalman import KalmanFilter

    return KalmanFilter(robot, sample_time=sample_time)
