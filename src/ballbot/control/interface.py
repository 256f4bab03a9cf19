"""The seam between a controller and everything that runs one: a measurement and a reference in, torques out."""

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ballbot.estimation.interface import EstimatorName, checked_name

#: a measured state with a larger magnitude or a NaN is invalid: no coordinate of a robot is a million metres
LARGEST_STATE = 1e6


@runtime_checkable
class Feedback(Protocol):
    """A controller: `ballbot.Controller`, or a user's own."""

    @property
    def sample_time(self) -> float:
        """Time between two updates, over which torques are held [s]."""
        ...

    def reset(self) -> None:
        """Clear the memory: a run starts."""
        ...

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m] for the measured state (10,) and the reference (10,) at time t [s]."""
        ...


def estimator_of(controller: Feedback) -> EstimatorName:
    """Return the name of the estimator that a controller is designed for; "onboard" if it has no `estimator`.

    InputError if its `estimator` is not the name of an estimator.
    """
    return checked_name(getattr(controller, "estimator", "onboard"))
