"""Variation between logs, by per-log estimates, priors and findings; motors that the logs cannot separate."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.fitting.between_logs import LogEstimates, log_estimates
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification import identify
from ballbot.identification import variation as motors
from ballbot.identification.identify import IdentificationOptions, estimated_parameters
from ballbot.identification.quantities import FRICTION as QUANTITIES
from ballbot.identification.quantities import Bounds, Coordinates, scale_between
from ballbot.identification.variation import (
    WHEELS_APART,
    Priors,
    inseparable,
    uncertainty_of_each,
    variation_findings,
    widened,
)
from ballbot.robot import Robot
from tests.support.control_examples import FRICTION, alten
from tests.support.identification_examples import TRUTH, balancing_log, noisy

ROBOT = Robot.load("alten")
AT_BOUND = {"c1": Interval(lower=0.0, upper=0.02, method="at bound")}
VALUES = np.array([0.02] * 3 + [0.1] * 3 + [0.05] * 3 + [0.6, 1.1, 0.01])
PRIORS = Priors(sizes=dict.fromkeys(QUANTITIES, 0.1), degrees=8.0, robots=5)


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


SPEEDS = np.linspace(-3.0, 3.0, 200)[:, None] * np.ones(3)
NONE = np.zeros(12, dtype=bool)
SPACE = scale_between(alten(FRICTION), free=("viscous", "coulomb", "rolling"))


def fitted(*, seen: float, between: float) -> WindowEquations:
    """Return equations that see the friction of all wheels, and of their differences a share."""
    random, p = np.random.default_rng(0), len(TRUTH)
    J = seen * random.normal(size=(80, 50, p)) * SPACE.free
    columns = SPACE.layout.columns("coulomb")
    assert columns is not None
    mean = J[..., columns].mean(axis=-1, keepdims=True)
    J[..., columns] = mean + between * (J[..., columns] - mean)
    r = random.normal(size=(80, 50))
    return WindowEquations(matrices=np.einsum("wki,wkj->wij", J, J), scores=np.einsum("wki,wk->wi", J, r))


def tied(*names: str) -> Coordinates:
    return replace(SPACE, alike=names)


@pytest.mark.parametrize(("between", "names"), [(1.0, ()), (0.02, ("coulomb",))])
def test_wheels_are_fitted_as_one_if_their_differences_are_not_known_to_less_than_their_mean(between, names):
    # a scaled error of 1 / (2 sqrt(4000)) is 0.004 N m of c; with a fiftieth of the sight of differences 0.2 N m
    found = inseparable(SPACE, fitted(seen=2.0, between=between), TRUTH, unknown=NONE, speeds=SPEEDS)
    assert found == names


def test_numbers_that_are_equal_move_together_and_count_once():
    space = tied("coulomb")
    assert int(space.free.sum()) == int(SPACE.free.sum()) - 2
    point = space.scaled(TRUTH)
    point[3] = 0.5
    values = space.physical(point)
    np.testing.assert_allclose(values[3:6], 0.25)  # half of the range
    np.testing.assert_allclose(values[:3], TRUTH[:3])


def test_each_wheels_error_contains_by_how_much_motors_differ():
    space = tied("coulomb")
    point = space.scaled(TRUTH)
    values, scaled = space.physical(point), 0.01 / np.where(space.free, space.slopes(point), np.nan)
    R = np.where(np.outer(space.free, space.free), np.eye(12), np.nan)
    intervals = {
        "c1": Interval(lower=0.09, upper=np.inf, method="clustered"),
        "b1": Interval(lower=0.0, upper=0.02, method="at bound"),
    }
    C = R * np.outer(scaled, scaled)
    common = Uncertainty(coordinates=space, point=point, covariance=C, intervals=intervals)
    found = uncertainty_of_each(space, common)
    apart = WHEELS_APART * values[3]
    np.testing.assert_allclose(found.standard_errors[3:6], np.hypot(0.01, apart))
    # what is common to the wheels is their mean's error
    np.testing.assert_allclose(found.correlation[3, 4], 0.01**2 / (0.01**2 + apart**2))
    np.testing.assert_allclose(found.correlation[3:6, 3:6].diagonal(), 1.0)
    assert found.intervals["b1"] == Interval(lower=0.0, upper=0.02, method="at bound")
    assert found.intervals["c3"] == found.intervals["c1"]
    assert found.intervals["c1"].upper == np.inf  # what was open stays open
    half = np.hypot(values[3] - 0.09, 1.96 * apart)
    assert found.intervals["c1"].lower == pytest.approx(values[3] - half)
    assert np.isnan(found.standard_errors[6:9]).all()


@pytest.mark.slow
def test_a_fit_of_motors_as_one_says_so_and_has_one_number_for_them(monkeypatch):
    monkeypatch.setattr(motors, "INSEPARABLE", 0.0)
    log = noisy(balancing_log(), seed=4).between(6.0, 10.0)
    options = IdentificationOptions(most_steps=4, step=2.5e-3, most_profiles=0)
    found = identify(alten(), log, law="coulomb", window=0.1, options=options)
    assert next(one.text for one in found.findings if one.code == "motors-alike").startswith("Motors alike: ")
    for symbol in ("b", "c"):
        assert len(set(found.parameters[symbol])) == 1
    assert list(found.robot.friction.coulomb) == found.parameters["c"]
    # dry friction and Stribeck part of the truth together, less what has faded: 0.09 to 0.18 N m
    assert 0.08 < found.parameters["c"][0] < 0.18
    assert min(found.standard_errors["c"]) > WHEELS_APART * found.parameters["c"][0]
    assert {"c1", "c2", "c3"} <= found.intervals.keys() & found.variation.predictions.keys()
    assert found.verdict.usable
