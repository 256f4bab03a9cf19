"""Residual torque against wheel speed: friction that the model's law lacks or has too much of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.validation.residuals.regression import fit, indicators

_BINS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedEffect:
    """Mean residual torque of one wheel at speeds that are equally frequent."""

    speeds: NDArray[np.float64]  #: (b,) [rad/s] mean of each bin
    torques: NDArray[np.float64]  #: (b,) [N m]
    half_widths: NDArray[np.float64]  #: (b,) of the 95 % intervals
    p_value: float  #: of no torque at any speed; NaN where a speed was seldom had

    @property
    def largest(self) -> int:
        """The bin whose torque is the furthest from zero, in errors."""
        return int(np.argmax(np.abs(self.torques) / self.half_widths))


def speed_effect(
    torque: NDArray[np.float64], speed: NDArray[np.float64], blocks: NDArray[np.int64]
) -> SpeedEffect:
    """Return one wheel's mean residual torque (n,) against its earlier speed (n,); NaN is passed over."""
    known = np.isfinite(speed)
    torque, speed, blocks = torque[known], speed[known], blocks[known]
    edges = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, _BINS + 1)))
    if len(edges) < 2:  # a wheel that stood still
        edges = np.array([-np.inf, np.inf])
    place = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, len(edges) - 2)
    columns = indicators(place, len(edges) - 1)
    found = fit(columns, torque, blocks)
    return SpeedEffect(
        speeds=columns.T @ speed / columns.sum(axis=0),
        torques=found.values,
        half_widths=found.half_widths,
        p_value=found.p_value(range(columns.shape[1])),
    )
