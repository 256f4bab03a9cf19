"""What the upside-down stage gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.result import ParameterTable
from ballbot.identification.upside_down.windows import BALL_NAMES
from ballbot.identification.windows import Span
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class UpsideDown:
    """Driveline and ball-wheel friction of a robot without its weight on the ball; p = 3 n + 2 parameters."""

    robot: Robot  #: with the friction found; rolling friction as it was, which has no part here
    parameters: ParameterTable  #: {b: [..], c: [..], s: [..], v_s, delta}, SI units; NaN without influence
    standard_errors: ParameterTable  #: alike, clustered by window; NaN where there is none
    labels: tuple[str, ...]  #: (p,)
    correlation: NDArray[np.float64]  #: (p, p)
    #: root mean square error (3,) [rad/s] of Omega on the windows held out: with the friction "found", that of the
    #: "robot file" where it has any, and "none"
    held_out: Mapping[str, NDArray[np.float64]]
    fit: Mapping[str, NDArray[np.float64]]  #: alike, on the windows fitted
    fit_windows: tuple[Span, ...]
    held_out_windows: tuple[Span, ...]
    evolution_cost: tuple[float, ...]  #: after each generation [rad/s]
    window: float  #: length of a window [s]
    warnings: tuple[str, ...]  #: sentences

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; NaN becomes None, JSON's null."""
        return {
            "parameters": _table(self.parameters),
            "standard_errors": _table(self.standard_errors),
            "correlation": {
                "labels": list(self.labels),
                "matrix": [[_number(one) for one in row] for row in self.correlation.tolist()],
            },
            "rmse": {
                "columns": list(BALL_NAMES),
                "held_out": {name: error.tolist() for name, error in self.held_out.items()},
                "fit": {name: error.tolist() for name, error in self.fit.items()},
            },
            "cost": {"evolution": list(self.evolution_cost)},
            "windows": {
                "length": self.window,
                "fit": [[span.log, span.start, span.end] for span in self.fit_windows],
                "held_out": [[span.log, span.start, span.end] for span in self.held_out_windows],
            },
            "warnings": list(self.warnings),
        }


def _table(table: ParameterTable) -> dict[str, object]:
    return {
        key: [_number(one) for one in value] if isinstance(value, list) else _number(value)
        for key, value in table.items()
    }


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
