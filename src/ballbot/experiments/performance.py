"""What a robot's own log shows of how well it is controlled: the quantities that a prediction names.

A real robot has no true position, so that errors here are those of the logged state, with its drift. The same numbers
of a simulated run are taken from its logged state, too.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.experiments.metrics import SETTLE, position_error, rms, rms_torque_change, settled
from ballbot.log import Log

#: share of the samples whose torques the margin leaves out: single samples at the limit say little
_RARE = 0.001


@dataclass(frozen=True, kw_only=True)
class Performance:
    """A run in five numbers that its log shows; errors are NaN if it ended before it settled."""

    peak_error: float  #: largest horizontal distance from the reference once settled [m]
    rms_error: float  #: its root mean square [m]
    roughness: float  #: RMS change of the torques from one sample to the next [N m]
    lean: float  #: largest lean from the vertical [rad]
    #: share of the torque limit that the torques of any wheel leave in all but a thousandth of the samples; measured
    #: torques beyond the limit leave none
    torque_margin: float

    @staticmethod
    def of(log: Log, *, torque_limit: float, settle: float = SETTLE) -> Performance:
        """Return the numbers of a log with reference, torques and states.

        Parameters
        ----------
        log : Log
            Its truth, if it has one, is not looked at.
        torque_limit : float
            The controller's, of each wheel [N m].
        settle : float
            See `ballbot.experiments.metrics.settled` [s].
        """
        seen = log.without_truth()
        counted = settled(seen, settle)
        error = position_error(seen)[counted]
        upright = np.cos(seen["theta"]) * np.cos(seen["phi"])
        largest = np.abs(seen.torques).max(axis=1)
        return Performance(
            peak_error=float(error.max()) if counted.any() else np.nan,
            rms_error=rms(error) if counted.any() else np.nan,
            roughness=rms_torque_change(seen),
            lean=float(np.arccos(np.clip(upright.min(), -1.0, 1.0))),
            torque_margin=max(1.0 - float(np.quantile(largest, 1.0 - _RARE)) / torque_limit, 0.0),
        )

    def to_array(self) -> NDArray[np.float64]:
        """Return its numbers (5,), as a checkpoint keeps them."""
        return np.array(astuple(self), dtype=np.float64)

    @staticmethod
    def from_array(numbers: NDArray[np.float64]) -> Performance:
        """Return the performance of numbers (5,)."""
        return Performance(**dict(zip(QUANTITIES, numbers.tolist(), strict=True)))


#: names of the quantities, in their order
QUANTITIES = tuple(field.name for field in fields(Performance))


def performance_of(log: Log, controller: Controller) -> Performance:
    """Return the numbers of a run with that controller."""
    return Performance.of(log, torque_limit=controller.torque_limit)
