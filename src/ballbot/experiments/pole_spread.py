"""How well a robot's fastest unstable pole is known, from the standard deviations in its file: Monte Carlo.

The fastest of two poles that lie together, as those of a symmetric robot's two leans do, is no smooth function of the
parameters, and the delta method halves what moves one of the two. So robots are drawn. Where the variance comes from is
told by linear propagation to the mean of the unstable poles, which is smooth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.variations import draw_robots, propagate

#: relative error of a standard deviation from so many draws: 1 / sqrt(2 N), 2.5 %
DRAWS = 800


@dataclass(frozen=True, kw_only=True)
class PoleSpread:
    """The fastest unstable pole [rad/s] over robots as they may be."""

    deviation: float  #: standard deviation
    lower: float  #: 2.5 % of the draws are below
    upper: float  #: 2.5 % of the draws are above
    draws: int
    causes: tuple[tuple[str, float], ...]  #: parameter and its share of the variance, the largest first

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "standard_deviation": self.deviation,
            "interval_95": [self.lower, self.upper],
            "draws": self.draws,
            "variance_shares": dict(self.causes),
        }


def pole_spread(robot: Robot, *, draws: int = DRAWS, seed: int = 0) -> PoleSpread:
    """Return what a robot's standard deviations make of its fastest pole about upright, exact model.

    Raises
    ------
    InputError
        Where the standard deviations are too large to be a robot's.
    """
    fastest = [float(_growths(one).max()) for one in draw_robots(robot, draws, seed=seed)]
    lower, upper = np.quantile(fastest, [0.025, 0.975])
    mean = propagate(robot, _mean_growth)
    return PoleSpread(
        deviation=float(np.std(fastest, ddof=1)),
        lower=float(lower),
        upper=float(upper),
        draws=draws,
        causes=tuple(mean.largest(len(mean.parts))),
    )


def _growths(robot: Robot) -> NDArray[np.float64]:
    return np.asarray(Model(robot).linearize().poles().real, dtype=np.float64)


def _mean_growth(robot: Robot) -> NDArray[np.float64]:
    growths = _growths(robot)
    return np.array([growths[growths > 0.0].mean()])
