"""What an identification gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, finding_results
from ballbot.identification.intervals import Interval
from ballbot.identification.prediction import Predictor
from ballbot.identification.quantities import BY_NAME, Layout
from ballbot.identification.windows import Span
from ballbot.log import STATE_NAMES
from ballbot.robot import Robot

#: {b: [..], c: [..], s: [..], v_s, delta, C_rr, ..}; see `ballbot.identification.quantities`
ParameterTable = dict[str, list[float] | float]


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowErrors:
    """Errors of open-loop predictions over windows, all samples of all windows together."""

    window_samples: int  #: compared in each window
    squares_with: NDArray[
        np.float64
    ]  #: (w, 10), sums of squared errors in each window with the friction found
    squares_without: NDArray[np.float64]  #: (w, 10), without friction

    @property
    def windows(self) -> int:
        """How many windows."""
        return len(self.squares_with)

    @property
    def samples(self) -> int:
        """Samples compared in all, n."""
        return self.windows * self.window_samples

    @property
    def rmse_with(self) -> NDArray[np.float64]:
        """Root mean square error of each state (10,) with the friction found."""
        return np.sqrt(self.squares_with.sum(axis=0) / max(self.samples, 1))

    @property
    def rmse_without(self) -> NDArray[np.float64]:
        """Root mean square error of each state (10,) without friction."""
        return np.sqrt(self.squares_without.sum(axis=0) / max(self.samples, 1))

    @property
    def with_friction(self) -> dict[str, float]:
        """By (4.1), |x - x_hat| / n, for each state."""
        return self._by_state(self.rmse_with / np.sqrt(self.samples))

    @property
    def without_friction(self) -> dict[str, float]:
        """By (4.1), for each state."""
        return self._by_state(self.rmse_without / np.sqrt(self.samples))

    @property
    def ratios(self) -> dict[str, float]:
        """Error with friction over error without, for each state."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._by_state(self.rmse_with / self.rmse_without)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "windows": self.windows,
            "samples": self.samples,
            "with_friction": self.with_friction,
            "without_friction": self.without_friction,
            "rmse_with_friction": self._by_state(self.rmse_with),
            "rmse_without_friction": self._by_state(self.rmse_without),
        }

    @staticmethod
    def _by_state(values: NDArray[np.float64]) -> dict[str, float]:
        return dict(zip(STATE_NAMES, values.tolist(), strict=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """What logs told of a robot: p parameters, friction's 3 n + 3 first."""

    #: the robot with the friction found; a parameter without influence is as it was before, where that predicts as well
    robot: Robot
    parameters: ParameterTable  #: SI units; NaN where a parameter has no influence
    standard_errors: (
        ParameterTable  #: alike; NaN where a parameter has none: no influence, at a bound, or held
    )
    predictor: Predictor  #: predicts windows with any such parameters
    values: NDArray[np.float64]  #: (p,), those that the verdict's predictions were made with, SI units
    bootstrap_errors: ParameterTable  #: alike, from a bootstrap of blocks of windows
    intervals: dict[
        str, Interval
    ]  #: of 95 %, by label; none for a parameter without influence, held or refused
    correlation: NDArray[np.float64]  #: (p, p); NaN for parameters without standard error
    fit: WindowErrors  #: on the windows fitted
    held_out: WindowErrors  #: on the windows that the fit never saw
    fit_windows: tuple[Span, ...]
    held_out_windows: tuple[Span, ...]
    window: float  #: length of the windows [s]
    left_out: tuple[str, ...]  #: states whose errors did not count in the fit
    evolution_cost: tuple[
        float, ...
    ]  #: best cost after each generation, on the windows drawn for the evolution
    polish_cost: tuple[float, ...]  #: cost after each step, on all windows fitted
    warnings: tuple[str, ...]  #: sentences
    log_findings: tuple[Finding, ...] = ()  #: of the checks of the logs

    @property
    def layout(self) -> Layout:
        """Which parameters, in their order."""
        return self.predictor.layout

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the correlation's rows (p,): b1 .. bn, c1 .. cn, s1 .. sn, v_s, delta, C_rr and what else was sought."""
        return self.layout.labels

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; NaN becomes None, JSON's null."""
        return {
            "parameters": _without_nan(self.parameters),
            "standard_errors": _without_nan(self.standard_errors),
            "bootstrap_errors": _without_nan(self.bootstrap_errors),
            "intervals": {label: interval.to_dict() for label, interval in self.intervals.items()},
            "correlation": {"labels": list(self.labels), "matrix": _without_nan(self.correlation.tolist())},
            "units": {BY_NAME[name].symbol: BY_NAME[name].unit for name in self.layout.names},
            "held_out": self.held_out.to_dict(),
            "fit": self.fit.to_dict(),
            "left_out_of_cost": list(self.left_out),
            "cost": {"evolution": list(self.evolution_cost), "polish": list(self.polish_cost)},
            "windows": {
                "fit": [[span.log, span.start, span.end] for span in self.fit_windows],
                "held_out": [[span.log, span.start, span.end] for span in self.held_out_windows],
            },
            "warnings": list(self.warnings),
            "findings": finding_results(self.log_findings),
        }


def _without_nan(value: object) -> object:
    match value:
        case dict():
            return {key: _without_nan(one) for key, one in value.items()}
        case list():
            return [_without_nan(one) for one in value]
        case float() if not np.isfinite(value):
            return None
    return value
