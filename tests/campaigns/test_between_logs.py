"""A sample of the campaign on intervals between logs: its twins, and its verdict on logs made by the statistics."""

from __future__ import annotations

import numpy as np
import pytest

from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.identification.identify import estimated_parameters
from ballbot.identification.quantities import FRICTION, Bounds
from ballbot.identification.variation import LogEstimates, Priors, scaled_units
from campaigns.between_logs import (
    ROBOT,
    Fit,
    coverage_row,
    judge,
)

VALUES = np.array([0.02] * 3 + [0.1] * 3 + [0.05] * 3 + [0.6, 1.1, 0.01])


def pair(random: np.random.Generator) -> tuple[Fit, Fit]:
    """Return the fits of two logs of a robot: errors of 5 % within a log, and variations of 10 % between logs."""
    coordinates = estimated_parameters(ROBOT, free=("friction",), law="stribeck", bounds=Bounds())
    fits = []
    for _ in range(2):
        values = VALUES * np.exp(0.1 * random.standard_normal(12) + 0.05 * random.standard_normal(12))
        scaled = coordinates.scaled(values)
        errors = 0.05 * values
        scaled_errors = errors / coordinates.slopes(scaled)
        within = Uncertainty(
            coordinates=coordinates,
            point=scaled,
            covariance=np.diag(scaled_errors**2),
            bootstrap=scaled_errors,
            intervals={
                label: Interval(lower=value - half, upper=value + half, method="clustered")
                for label, value, half in zip(
                    coordinates.labels, values.tolist(), (1.96 * errors).tolist(), strict=True
                )
            },
        )
        by_log = LogEstimates(points=scaled[None], covariances=within.covariance[None])
        fits.append(Fit(coordinates=coordinates, values=values, within=within, by_log=by_log))
    return fits[0], fits[1]


def test_intervals_hold_the_other_log_and_are_no_wider_than_the_logs_ask() -> None:
    random = np.random.default_rng(1)
    first, _ = pair(random)
    # what `pair` draws, by quantity in units of its own
    deviations = 0.1 * VALUES / first.coordinates.slopes(first.coordinates.scaled(VALUES))
    shares = deviations / scaled_units(first.coordinates, VALUES)
    sizes = {
        name: float(shares[[one == name for one in first.coordinates.names]].mean()) for name in FRICTION
    }
    priors = Priors(sizes=sizes, degrees=30.0, robots=30)
    judged = [one for _ in range(40) for one in judge(pair(random), priors)]
    held = np.mean([one.held for one in judged], axis=0)
    # 480 estimates: of the robot's own value the other one is sqrt(2) times as far off, 83 %; of another log 95 %
    assert 0.72 < held[0] < 0.92
    assert 0.9 < held[1] < 0.99
    # a spread of differences of 40 pairs is known to a tenth
    widths = [float(cell) for cell in coverage_row("all", judged)[2::2]]
    assert widths == pytest.approx([1.0, np.sqrt(2.0)], rel=0.25)
