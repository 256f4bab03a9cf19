"""What identification of an axis gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.axis.inverse import InverseFit
from ballbot.identification.axis.ladder import RungVerdict
from ballbot.identification.axis.laws import Rung


@dataclass(frozen=True, kw_only=True)
class AxisErrors:
    """How well parameters predict a record."""

    record: str
    open_loop_rmse: float  #: of the position over the whole record, from its start [m]
    closed_loop_force: float | None  #: |F - F_hat| / |F| in closed loop; None where the loop is not known
    closed_loop_position: float | None  #: alike for the position


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """One method's parameters and what they predict."""

    method: str  #: "inverse", "closed loop" or "open loop"
    rung: Rung
    values: dict[str, float]  #: SI units
    standard_errors: dict[str, float]  #: clustered in time; NaN where there is none
    errors: tuple[AxisErrors, ...]  #: on the record fitted, then on those held against it

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "method": self.method,
            "law": self.rung.name,
            "parameters": self.values,
            "standard_errors": self.standard_errors,
            "errors": {
                one.record: {k: v for k, v in vars(one).items() if k != "record"} for one in self.errors
            },
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisIdentification:
    """An axis, identified."""

    record: str  #: that was fitted
    unit: str  #: of positions: "m" or "rad"
    inverse: dict[str, InverseFit]  #: by form
    ladder: tuple[RungVerdict, ...]
    chosen: Rung
    estimates: tuple[Estimate, ...]  #: the chosen law by every method
    rungs: dict[str, Estimate]  #: every law by output error in open loop
    asymmetry: NDArray[
        np.float64
    ]  #: (parts, 2): (b- - b+)/2 in equal parts of the record, with standard errors; none where a part cannot tell
    remarks: tuple[str, ...]

    def estimate(self, method: str) -> Estimate:
        """Return the estimate by that method."""
        return next(one for one in self.estimates if one.method == method)

    @property
    def best(self) -> Estimate:
        """The estimate to simulate the axis with."""
        return self.estimate("open loop")

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "record": self.record,
            "unit": self.unit,
            "law": self.chosen.name,
            "parameters": self.best.values,
            "standard_errors": self.best.standard_errors,
            "estimates": {one.method: one.to_dict() for one in self.estimates},
            "inverse": {form: fit.to_dict() for form, fit in self.inverse.items()},
            "ladder": [
                {
                    "law": one.rung.name,
                    "below": one.rung.below,
                    "held_out_rms": one.rms,
                    "gain": one.gain,
                    "gain_interval": list(one.interval),
                }
                for one in self.ladder
            ],
            "laws": {name: one.to_dict() for name, one in self.rungs.items()},
            "asymmetry_over_time": self.asymmetry,
            "remarks": list(self.remarks),
        }
