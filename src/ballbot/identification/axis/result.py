"""Result of the identification of an axis."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, finding_results
from ballbot.fitting.model_selection import Candidate, Gain, ModelSelection
from ballbot.identification.axis.inverse import InverseFit
from ballbot.identification.axis.laws import AxisLaw, unit_for
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.prediction import AxisErrors, PredictedError
from ballbot.identification.axis.residuals import ResidualTest
from ballbot.identification.axis.selection import HorizonChoice
from ballbot.identification.axis.structure import AxisModel
from ballbot.summary import Summary, estimated, first_texts, plotted, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """One method's parameters and their prediction errors."""

    method: str  #: "inverse", "closed loop", "whole record" or "open loop"
    model: AxisModel
    values: dict[str, float]  #: by label, SI units
    #: by label, clustered in time, with the discrepancies; NaN for a parameter at a bound
    standard_errors: dict[str, float]
    half_widths: dict[str, float]  #: of the 95 % intervals, by label, with the discrepancies
    errors: tuple[AxisErrors, ...]  #: on the records fitted, then on the others
    #: the part of the standard errors that what the model lacks adds, by label, of parameters that have such
    discrepancies: dict[str, float] = field(default_factory=dict)

    @property
    def law(self) -> AxisLaw:
        """Its friction law."""
        return self.model.law

    def axis(self, record: int | None = 0) -> Axis:
        """Return the axis of one of the fitted records, or of another one."""
        return self.model.axis(self.values, record)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "method": self.method,
            "law": self.law.name,
            "parameters": self.values,
            "standard_errors": self.standard_errors,
            "discrepancies": self.discrepancies,
            "intervals_95": {
                label: [value - self.half_widths[label], value + self.half_widths[label]]
                for label, value in self.values.items()
            },
            "errors": {
                one.record: {k: v for k, v in vars(one).items() if k != "record"} for one in self.errors
            },
        }


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class AxisIdentification:
    """An axis, identified."""

    records: tuple[str, ...]  #: that were fitted
    unit: str  #: of positions: "m" or "rad"
    model: AxisModel  #: with the law that was selected or requested
    terms: tuple[tuple[str, Gain], ...]  #: forces over position and drift that were selected, and their gains
    drift: float  #: of the offset, from its least to its greatest value [N]; subtracted from the forces before the fits
    horizon: HorizonChoice
    inverse: dict[str, InverseFit]  #: by form
    laws: ModelSelection[AxisLaw]  #: every law, by its errors on held-out blocks
    estimates: tuple[Estimate, ...]  #: the chosen law by every method
    by_law: dict[str, Estimate]  #: every law by output error in open loop
    #: (parts, 2): (b- - b+)/2 in equal parts of the record, with standard errors; empty if a part moves one way only
    asymmetry: NDArray[np.float64]
    residuals: tuple[ResidualTest, ...]
    expected: PredictedError  #: on another record
    findings: tuple[Finding, ...]

    @property
    def chosen(self) -> AxisLaw:
        """The friction law."""
        return self.model.law

    def estimate(self, method: str) -> Estimate:
        """Return the estimate by that method."""
        return next(one for one in self.estimates if one.method == method)

    @property
    def inverse_estimate(self) -> Estimate | None:
        """The chosen law's linear part by the inverse model; None if its mass is not above zero."""
        return next((one for one in self.estimates if one.method == "inverse"), None)

    @property
    def best(self) -> Estimate:
        """The estimate to simulate the axis with."""
        return self.estimate("open loop")

    def summary(self) -> Summary:
        """Return the law's parameters with their standard errors, the error to expect elsewhere, and findings."""
        best, one, unit = self.best, self.expected, f"m{self.unit}"
        rows = [
            (label, estimated(value, best.standard_errors[label], _unit(self, label)))
            for label, value in best.values.items()
        ]
        rows.append(
            (
                "error elsewhere",
                f"{1e3 * one.error:.3g} {unit} RMS over {one.horizon:g} s, 95 % interval {1e3 * one.lower:.3g} to "
                f"{1e3 * one.upper:.3g} {unit}",
            )
        )
        return Summary(
            title=f"Axis of {', '.join(self.records)}, law {self.chosen.name}: value ± standard error",
            rows=tuple(rows),
            sentences=first_texts(self.findings),
        )

    def plot(self) -> Figure:
        """Return a figure of each law's gain on held-out blocks over the simpler law within it."""
        return plotted(self)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "records": list(self.records),
            "unit": self.unit,
            "law": self.chosen.name,
            "terms": {name: gain.to_dict() for name, gain in self.terms},
            "drift_range": self.drift,
            "force_between_rows": "interpolated" if self.model.interpolated else "held",
            "horizon": {
                "chosen": self.horizon.chosen,
                "tried": list(self.horizon.horizons),
                "held_out_rms": self.horizon.errors,
            },
            "parameters": self.best.values,
            "standard_errors": self.best.standard_errors,
            "estimates": {one.method: one.to_dict() for one in self.estimates},
            "inverse": {form: fit.to_dict() for form, fit in self.inverse.items()},
            "selection": [_law_result(one) for one in self.laws.candidates],
            "laws": {name: one.to_dict() for name, one in self.by_law.items()},
            "asymmetry_over_time": self.asymmetry,
            "residuals": {one.quantity: one.to_dict() for one in self.residuals},
            "expected_elsewhere": self.expected.to_dict(),
            "findings": finding_results(self.findings),
        }


def _unit(found: AxisIdentification, label: str) -> str:
    """Return the unit of a parameter; empty for one without, or of a drift's shape."""
    return "" if label.startswith("drift_") else unit_for(found.model.parameter(label), found.unit)


def _law_result(one: Candidate[AxisLaw]) -> dict[str, object]:
    """Return what results.json holds of a law."""
    gain = one.gain
    return {
        "law": one.name,
        "below": one.within,
        "held_out_rms": float(np.sqrt(one.held_out.squares.mean())),
        "gain": gain.share if gain else np.nan,
        "gain_interval": [gain.lower, gain.upper] if gain else [np.nan, np.nan],
    }
