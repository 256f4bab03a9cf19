"""What an identification gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.windows import Span
from ballbot.log import STATE_NAMES
from ballbot.robot import Robot

#: {b: [..], c: [..], s: [..], v_s, delta, C_rr}
ParameterTable = dict[str, list[float] | float]


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowErrors:
    """Errors of open-loop predictions over windows, all samples of all windows together."""

    windows: int
    samples: int  #: compared in all, n
    rmse_with: NDArray[np.float64]  #: (10,), root mean square error of each state with the friction found
    rmse_without: NDArray[np.float64]  #: (10,), without friction

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
    """A robot's friction, found from logs; p = 3 n + 3 parameters."""

    #: the robot with the friction found; a parameter without influence is as it was before, where that predicts as well
    robot: Robot
    parameters: ParameterTable  #: SI units; NaN where a parameter has no influence
    standard_errors: (
        ParameterTable  #: alike; NaN where a parameter has none: no influence, at a bound, or held
    )
    labels: tuple[
        str, ...
    ]  #: (p,), of the correlation's rows: b1 .. bn, c1 .. cn, s1 .. sn, v_s, delta, C_rr
    correlation: NDArray[np.float64]  #: (p, p); NaN for parameters without standard error
    fit: WindowErrors  #: on the windows fitted
    held_out: WindowErrors  #: on the windows that the fit never saw
    fit_windows: tuple[Span, ...]
    held_out_windows: tuple[Span, ...]
    evolution_cost: tuple[
        float, ...
    ]  #: best cost after each generation, on the windows drawn for the evolution
    polish_cost: tuple[float, ...]  #: cost after each step, on all windows fitted
    warnings: tuple[str, ...]  #: sentences

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; NaN becomes None, JSON's null."""
        return {
            "parameters": _without_nan(self.parameters),
            "standard_errors": _without_nan(self.standard_errors),
            "correlation": {"labels": list(self.labels), "matrix": _without_nan(self.correlation.tolist())},
            "held_out": self.held_out.to_dict(),
            "fit": self.fit.to_dict(),
            "cost": {"evolution": list(self.evolution_cost), "polish": list(self.polish_cost)},
            "windows": {
                "fit": [[span.log, span.start, span.end] for span in self.fit_windows],
                "held_out": [[span.log, span.start, span.end] for span in self.held_out_windows],
            },
            "warnings": list(self.warnings),
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
