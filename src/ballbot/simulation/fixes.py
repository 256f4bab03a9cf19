"""Something outside that sees where the robot is, now and then: cameras, a laser scanner, beacons."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.estimation.interface import Fix


@dataclass(frozen=True, kw_only=True)
class FixSource:
    """How often a fix comes and how good it is; in the world's frame and at once."""

    rate: float  #: [Hz]
    position: bool = True  #: whether it says x and y
    heading: bool = True  #: whether it says psi
    position_noise: float = 0.005  #: standard deviation of x and of y [m]
    heading_noise: float = 0.02  #: standard deviation of psi [rad]
    missing: float = 0.0  #: share of fixes that do not come, 0 to 1

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate) and self.rate > 0):
            raise InputError(f"rate of a fix is {self.rate}; it must be above 0 Hz.")
        for name in ("position_noise", "heading_noise"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{name} of a fix is {value}; it must be above 0.")
        if not 0 <= self.missing <= 1:
            raise InputError(f"missing of a fix is {self.missing}; it must be a fraction from 0 to 1.")


class FixSensor:
    """The fixes of one run; the first comes at 1 / rate.

    Parameters
    ----------
    source : FixSource
    random : Generator
    """

    def __init__(self, source: FixSource, random: np.random.Generator) -> None:
        self._source = source
        self._random = random
        self._taken = 0

    def read(self, t: float, truth: NDArray[np.float64]) -> Fix | None:
        """Return the fix that has come by now, if one has.

        Parameters
        ----------
        t : float
            Time since the start [s].
        truth : array (10,)
            The state as it is.
        """
        source = self._source
        due = math.floor(t * source.rate + 1e-9)
        if due <= self._taken:
            return None
        self._taken = due
        # the same draws for each fix, whether it comes or not and whatever it has
        chance, (east, north, turn) = self._random.random(), self._random.standard_normal(3)
        if chance < source.missing:
            return None
        return Fix(
            position=truth[:2] + source.position_noise * np.array([east, north]) if source.position else None,
            heading=float(truth[4] + source.heading_noise * turn) if source.heading else None,
            position_deviation=source.position_noise,
            heading_deviation=source.heading_noise,
        )
