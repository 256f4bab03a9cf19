"""The estimators by the names that commands and files know them by."""

from __future__ import annotations

from typing import Literal, get_args

from ballbot.errors import InputError
from ballbot.estimation.interface import Estimator
from ballbot.estimation.onboard import OnboardState
from ballbot.robot.robot import Robot

#: the thesis's way; the Kalman filter, which also listens to fixes
EstimatorName = Literal["onboard", "kalman"]


def checked_name(name: str) -> EstimatorName:
    """Return the name of an estimator; InputError where there is none of that name."""
    for known in get_args(EstimatorName):
        if name == known:
            return known
    raise InputError(
        f"There is no estimator {name!r}; the estimators are {', '.join(get_args(EstimatorName))}."
    )


def named_estimator(name: EstimatorName, robot: Robot, *, sample_time: float) -> Estimator:
    """Return a new estimator of that name for a robot.

    Parameters
    ----------
    name : {"onboard", "kalman"}
    robot : Robot
    sample_time : float
        Time between two updates [s].

    Raises
    ------
    InputError
        Where there is none of that name, or the sample time is not positive.
    """
    if checked_name(name) == "onboard":
        return OnboardState(robot, sample_time=sample_time)
    from ballbot.estimation.kalman import KalmanFilter  # compiled: only who uses it loads Numba

    return KalmanFilter(robot, sample_time=sample_time)
