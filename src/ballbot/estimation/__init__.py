"""The state from the robot's own sensors, and from a fix where there is one.

`OnboardState` is the thesis's way. `ballbot.estimation.kalman.KalmanFilter`, the better one, is compiled and comes
from its own file, so that only who uses it loads Numba.
"""

from ballbot.estimation.interface import Estimator, Fix, Reading
from ballbot.estimation.onboard import OnboardState

__all__ = ["Estimator", "Fix", "OnboardState", "Reading"]
