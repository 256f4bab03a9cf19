"""Variation between logs: per-log estimates of a linear model, priors, and the findings."""

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.fitting.between_logs import LogEstimates, log_estimates
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification.identify import estimated_parameters
from ballbot.identification.quantities import FRICTION, Bounds, Coordinates
from ballbot.identification.variation import Priors, variation_findings, widened, with_torque_scale
from ballbot.robot import Robot

ROBOT = Robot.load("alten")
AT_BOUND = {"c1": Interval(lower=0.0, upper=0.02, method="at bound")}
VALUES = np.array([0.02] * 3 + [0.1] * 3 + [0.05] * 3 + [0.6, 1.1, 0.01])
PRIORS = Priors(sizes=dict.fromkeys(FRICTION, 0.1), degrees=8.0, robots=5)


@pytest.fixture(scope="module")
def coordinates() -> Coordinates:
    return estimated_parameters(ROBOT, free=("friction",), law="stribeck", bounds=Bounds())


def uncertainty(coordinates: Coordinates, errors: NDArray[np.float64], values=VALUES) -> Uncertainty:
    """Return an uncertainty of scaled errors (p,)."""
    point = coordinates.scaled(values)
    half = 1.96 * errors * coordinates.slopes(point)
    intervals = {
        label: Interval(lower=float(value - reach), upper=float(value + reach), method="clustered")
        for label, value, reach in zip(coordinates.labels, values, half, strict=True)
        if np.isfinite(reach)
    }
    known = np.isfinite(np.outer(errors, errors))
    return Uncertainty(
        coordinates=coordinates,
        point=point,
        covariance=np.where(known, np.diag(errors**2), np.nan),
        bootstrap=errors,
        intervals=AT_BOUND | intervals,
    )


def test_each_logs_estimate_is_that_of_its_own_least_squares(coordinates: Coordinates):
    """Of a linear model with 60 windows of each of three logs, whose parameters lie apart."""
    random, size, shifts = np.random.default_rng(0), len(coordinates.labels), np.array([0.0, 0.01, -0.02])
    of_log, J = np.repeat(np.arange(3), 60), random.standard_normal((180, 20, size))
    truth = coordinates.scaled(VALUES) + shifts[of_log, None]
    y = np.einsum("wki,wi->wk", J, truth) + 0.02 * random.standard_normal(J.shape[:2])

    def least_squares(rows: NDArray[np.bool_]) -> NDArray[np.float64]:
        return np.linalg.lstsq(J[rows].reshape(-1, size), y[rows].ravel(), rcond=None)[0]

    point = least_squares(np.ones(len(J), dtype=bool))
    residuals = np.einsum("wki,i->wk", J, point) - y
    equations = WindowEquations(np.einsum("wki,wkj->wij", J, J), np.einsum("wki,wk->wi", J, residuals))
    within = uncertainty(coordinates, np.full(12, 1e-3), coordinates.physical(point))
    found = log_estimates(within, equations, of_log, widen=1.0)
    expected = [least_squares(of_log == log) for log in range(3)]
    np.testing.assert_allclose(found.points, expected, atol=1e-10)
    # 60 windows of 20 residuals of 0.02; errors from 180 windows scatter by a twentieth, and the windows by a tenth
    errors = np.sqrt(found.covariances.diagonal(axis1=1, axis2=2))
    np.testing.assert_allclose(errors, 0.02 / np.sqrt(1200.0), rtol=0.35)


def of_logs(points: np.ndarray, errors: np.ndarray) -> LogEstimates:
    """Return estimates (k, p) with independent errors (p,), scaled; NaN of parameters at a bound."""
    covariances = np.tile(
        np.where(np.isfinite(np.outer(errors, errors)), np.diag(errors**2), np.nan), (len(points), 1, 1)
    )
    return LogEstimates(points=points, covariances=covariances)


def test_one_log_has_the_errors_of_the_estimate_and_the_variation_of_the_prior(coordinates: Coordinates):
    errors, values = np.full(12, 2e-3), VALUES.copy()
    errors[3], values[3] = np.nan, 0.0  # c1 is at zero
    within = uncertainty(coordinates, errors, values)
    scaled = coordinates.scaled(values)
    found, varied = widened(coordinates, within, of_logs(scaled[None], errors), priors=PRIORS)
    # E(tau^2) = 8 / 6; b varies by 0.1 of 0.02 and of the wheels' mean c + s at 10 rad/s, over bounds of 0.1
    of_b = 0.02 + float(np.mean(values[3:6]) + 0.05) / 10.0
    assert found.scaled_errors[0] == pytest.approx(np.sqrt(2e-3**2 + 8.0 / 6.0 * of_b**2), rel=2e-3)
    assert found.standard_errors[0] == pytest.approx(0.1 * found.scaled_errors[0])
    assert np.isnan(found.standard_errors[3])
    # a bound has no error, and its interval reaches farther: by 0.1 of the wheels' mean c + s
    more = 1.96 * np.sqrt(8.0 / 6.0) * 0.1 * float(np.mean(values[3:6]) + 0.05)
    assert found.intervals["c1"].lower == 0.0
    assert found.intervals["c1"].upper == pytest.approx(np.hypot(0.02, more), rel=2e-3)
    for label, one in varied.predictions.items():
        assert one.lower <= found.intervals[label].lower < found.intervals[label].upper <= one.upper
    (finding,) = variation_findings(varied)
    assert "One log" in finding.text
    assert "5 simulated robots" in finding.text


def test_more_logs_know_more_and_logs_that_differ_are_found(coordinates: Coordinates):
    errors, scaled = np.full(12, 5e-3), coordinates.scaled(VALUES)
    within = uncertainty(coordinates, errors)
    one, _ = widened(coordinates, within, of_logs(scaled[None], errors), priors=PRIORS)
    points = np.tile(scaled, (3, 1))
    alike, varied = widened(coordinates, within, of_logs(points, errors), priors=PRIORS)
    assert np.all(alike.standard_errors < one.standard_errors)
    assert variation_findings(varied) == []
    points[1, 4] += 0.15
    apart, varied = widened(coordinates, within, of_logs(points, errors), priors=PRIORS)
    assert np.all(apart.standard_errors > alike.standard_errors)
    (finding,) = variation_findings(varied)
    assert "The 3 logs differ" in finding.text


def test_a_scale_that_is_not_known_makes_a_motors_friction_as_uncertain(coordinates: Coordinates):
    within = uncertainty(coordinates, np.full(12, 5e-3))
    found = with_torque_scale(coordinates, within, np.array([0.2, 0.0, 0.0]))
    np.testing.assert_allclose(
        found.standard_errors[:9:3], np.hypot(within.standard_errors[:9:3], 0.2 * VALUES[:9:3]), rtol=1e-12
    )
    untouched = [1, 2, 4, 5, 7, 8, 9, 10, 11]
    np.testing.assert_array_equal(found.standard_errors[untouched], within.standard_errors[untouched])
    # b1 and c1 are wrong together
    assert found.correlation[0, 3] > within.correlation[0, 3]
    assert found.intervals["c1"].upper > within.intervals["c1"].upper
    assert found.intervals["c2"].upper == pytest.approx(within.intervals["c2"].upper)
