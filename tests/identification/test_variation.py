"""Variation between logs: per-log estimates of a linear model, priors, and the findings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.fitting.between_logs import VariancePrior
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.fitting.uncertainty import Discrepancy, WindowEquations
from ballbot.identification.identify import estimated_parameters
from ballbot.identification.parameters import Bounds, Coordinates
from ballbot.identification.quantities import FRICTION
from ballbot.identification.variation import (
    LogEstimates,
    Priors,
    discrepancy_finding,
    log_estimates,
    shipped_priors,
    units_of,
    variation,
    variation_findings,
)
from ballbot.identification.windows import Span
from ballbot.robot import Robot

ROBOT = Robot.load("alten")
VALUES = np.array([0.02] * 3 + [0.1] * 3 + [0.05] * 3 + [0.6, 1.1, 0.01])
PRIORS = Priors(by_name=dict.fromkeys(FRICTION, VariancePrior(scale=0.1, degrees=8.0)), robots=5)


@pytest.fixture(scope="module")
def coordinates() -> Coordinates:
    return estimated_parameters(ROBOT, free=("friction",), law="stribeck", bounds=Bounds())


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """A linear model at its least-squares estimate from all windows."""

    point: NDArray[np.float64]
    equations: WindowEquations
    by_log: NDArray[np.float64]  #: (k, p), the exact least-squares estimate of each log alone
    spans: tuple[Span, ...]


def linear(coordinates: Coordinates, *, shifts: NDArray[np.float64], seed: int = 0) -> Linear:
    """Return 60 windows of each of k logs, whose parameters lie `shifts` (k,) off, scaled."""
    random, size = np.random.default_rng(seed), len(coordinates.labels)
    truth = coordinates.scaled(VALUES)
    J = random.standard_normal((60 * len(shifts), 20, size))
    of_log = np.repeat(np.arange(len(shifts)), 60)
    y = np.einsum("wki,wi->wk", J, truth + shifts[of_log, None]) + 0.02 * random.standard_normal(J.shape[:2])

    def least_squares(rows: NDArray[np.bool_]) -> NDArray[np.float64]:
        return np.linalg.lstsq(J[rows].reshape(-1, size), y[rows].ravel(), rcond=None)[0]

    point = least_squares(np.ones(len(J), dtype=bool))
    residuals = np.einsum("wki,i->wk", J, point) - y
    return Linear(
        point=point,
        equations=WindowEquations(
            matrices=np.einsum("wki,wkj->wij", J, J), scores=np.einsum("wki,wk->wi", J, residuals)
        ),
        by_log=np.array([least_squares(of_log == log) for log in range(len(shifts))]),
        spans=tuple(Span(log=int(log), start=float(k), end=k + 1.0) for k, log in enumerate(of_log)),
    )


def uncertainty(coordinates: Coordinates, errors: NDArray[np.float64]) -> Uncertainty:
    """Return an uncertainty of scaled errors (p,)."""
    physical = errors * coordinates.slopes(coordinates.scaled(VALUES))
    return Uncertainty(
        scaled_errors=errors,
        standard_errors=physical,
        bootstrap_errors=physical,
        correlation=np.eye(len(errors)),
        intervals={"c1": Interval(lower=0.0, upper=0.02, method="at bound")},
    )


def test_each_logs_estimate_is_that_of_its_own_least_squares(coordinates: Coordinates):
    made = linear(coordinates, shifts=np.array([0.0, 0.01, -0.02]))
    found = log_estimates(
        coordinates,
        made,
        made.spans,
        values=coordinates.physical(made.point),
        uncertainty=uncertainty(coordinates, np.full(12, 1e-3)),
        widen=1.0,
        seed=0,
    )
    np.testing.assert_allclose(found.points, made.by_log, atol=1e-10)
    # 60 windows of 20 residuals of 0.02; errors from 60 windows scatter by a tenth, and the larger of two counts
    np.testing.assert_allclose(found.errors, 0.02 / np.sqrt(1200.0), rtol=0.5)


def test_one_log_has_the_errors_of_the_estimate_and_a_bound_has_those_of_its_interval(
    coordinates: Coordinates,
):
    made, errors = linear(coordinates, shifts=np.zeros(1)), np.full(12, 2e-3)
    errors[3] = np.nan  # c1 at zero
    values = coordinates.physical(made.point)
    values[3] = 0.0
    found = log_estimates(
        coordinates,
        made,
        made.spans,
        values=values,
        uncertainty=uncertainty(coordinates, errors),
        widen=1.0,
        seed=0,
    )
    assert found.errors[0, 0] == pytest.approx(2e-3, rel=0.05)  # slopes at the truth and at the estimate
    assert found.errors[0, 3] == pytest.approx(0.02 / 0.5 / 1.96)


def test_the_prediction_is_wider_than_what_the_robot_has_in_common(coordinates: Coordinates):
    by_log = LogEstimates(points=coordinates.scaled(VALUES)[None], errors=np.full((1, 12), 5e-3))
    found = variation(coordinates, VALUES, by_log, priors=PRIORS)
    for label, one in found.predictions.items():
        robot = found.robots[label]
        assert one.lower <= robot.lower < robot.upper <= one.upper
    assert list(found.predictions) == list(coordinates.labels)
    assert np.all(found.deviations > 0.0)
    (finding,) = variation_findings(found)
    assert "One log" in finding.text
    assert "5 simulated robots" in finding.text


def test_only_logs_that_differ_are_said_to_vary(coordinates: Coordinates):
    points = np.tile(coordinates.scaled(VALUES), (3, 1))
    errors = np.full((3, 12), 5e-3)
    alike = variation(coordinates, VALUES, LogEstimates(points=points, errors=errors), priors=PRIORS)
    assert variation_findings(alike) == []
    points[1, 4] += 0.1
    apart = variation(coordinates, VALUES, LogEstimates(points=points, errors=errors), priors=PRIORS)
    assert apart.apart == ("c2",)
    assert apart.between["c2"].between > 1.3 * alike.between["c2"].between
    (finding,) = variation_findings(apart)
    assert "c2 varies" in finding.text


def test_units_are_the_robots_own_size(coordinates: Coordinates):
    units = units_of(coordinates, VALUES)
    assert units[:9] == pytest.approx([0.02] * 3 + [0.15] * 6)
    assert np.isinf(units[9:11]).all()
    assert units[11] == pytest.approx(0.01)
    assert np.all(units_of(coordinates, np.array([0.0] * 9 + [1.0, 1.0, 0.0])) > 0.0)


def test_the_shipped_priors_cover_the_friction():
    shipped = shipped_priors()
    assert set(shipped.by_name) == set(FRICTION)
    assert shipped.robots >= 2
    assert all(0.0 < one.scale < 10.0 and one.degrees >= 3.0 for one in shipped.by_name.values())


def test_a_discrepancy_is_reported_only_if_chance_does_not_explain_it():
    assert discrepancy_finding(Discrepancy(ratio=1.1, p_value=0.3)) == []
    (finding,) = discrepancy_finding(Discrepancy(ratio=4.0, p_value=0.001))
    assert "2 times as large" in finding.text
