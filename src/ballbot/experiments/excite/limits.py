"""What a run may not exceed, and how far it went."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

UNITS = {"lean": "rad", "floor": "m", "torque": "N m"}


@dataclass(frozen=True, kw_only=True)
class Peaks:
    """How far a run, or the worst of some, went."""

    lean: float  #: of the axis from the vertical [rad]
    floor: float  #: distance from where the run began [m]
    torque: float  #: of any wheel [N m]

    def to_dict(self) -> dict[str, float]:
        """Return what results.json holds."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How far a run may go.

    Raises
    ------
    InputError
        Where one is not a positive number.
    """

    lean: float  #: of the axis from the vertical [rad]
    floor: float  #: distance from where the run begins [m]
    torque: float  #: of any wheel [N m]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(
                    f"The {field.name} limit is {value:g} {UNITS[field.name]}; it must be positive."
                )

    def scaled(self, share: float) -> Limits:
        """Return that share of them."""
        return Limits(lean=share * self.lean, floor=share * self.floor, torque=share * self.torque)

    def used(self, peaks: Peaks) -> dict[str, float]:
        """Return what share of each limit the peaks take; above 1 it does not hold."""
        return {field.name: getattr(peaks, field.name) / getattr(self, field.name) for field in fields(self)}

    def exceeded(self, peaks: Peaks) -> list[str]:
        """Return the names of the limits that do not hold."""
        return [name for name, share in self.used(peaks).items() if share > 1.0]

    def to_dict(self) -> dict[str, float]:
        """Return what results.json holds."""
        return asdict(self)


def peaks_of(states: NDArray[np.float64], torques: NDArray[np.float64]) -> Peaks:
    """Return the peaks of states (..., 10) and torques (..., n), of runs that begin at the origin."""
    upright = np.cos(states[..., 2]) * np.cos(states[..., 3])
    return Peaks(
        lean=float(np.arccos(np.clip(upright.min(), -1.0, 1.0))),
        floor=float(np.hypot(states[..., 0], states[..., 1]).max()),
        torque=float(np.abs(torques).max()),
    )
