"""Least squares against closed forms and plain formulas."""

import numpy as np
import pytest

from ballbot.fitting.least_squares import Stopping, fit_linear, minimize_squares


def rosenbrock(p: np.ndarray) -> np.ndarray:
    return np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]])


def derivatives(p: np.ndarray) -> np.ndarray:
    return np.array([[-20.0 * p[0], 10.0], [-1.0, 0.0]])


@pytest.mark.parametrize("method", ["trf", "lm"])
@pytest.mark.parametrize("jacobian_of", [None, derivatives])
def test_descent_ends_at_the_minimum(method, jacobian_of):
    found = minimize_squares(rosenbrock, np.array([-1.2, 1.0]), jacobian_of=jacobian_of, method=method)
    np.testing.assert_allclose(found.point, 1.0, atol=1e-6)
    np.testing.assert_allclose(found.residuals, 0.0, atol=1e-6)
    np.testing.assert_allclose(found.jacobian, derivatives(found.point), atol=1e-2)


def test_descent_stops_at_a_bound_and_marks_it():
    found = minimize_squares(
        rosenbrock,
        np.array([-1.2, 1.0]),
        jacobian_of=derivatives,
        bounds=([-2.0, -2.0], [0.5, 2.0]),
        stopping=Stopping(least_gain=1e-12, least_step=1e-12),
    )
    # on the edge x = 0.5 the best y is x^2
    np.testing.assert_allclose(found.point, [0.5, 0.25], atol=1e-6)
    np.testing.assert_array_equal(found.at_bound, [1, 0])


def test_linear_fit_equals_the_plain_formula_if_rows_are_independent():
    random = np.random.default_rng(10)
    design, values = random.normal(size=(400, 2)), random.normal(size=400)
    single = fit_linear(design, values, np.arange(400))
    plain = np.linalg.inv(design.T @ design) * values.var()
    np.testing.assert_allclose(single.values, np.linalg.lstsq(design, values, rcond=None)[0], atol=1e-12)
    # a block for each row: the plain covariance but for the scatter of 400 squares
    np.testing.assert_allclose(np.diag(single.covariance), np.diag(plain), rtol=0.25)
    # every row ten times, in one block: as many blocks, the same covariance
    tenfold = fit_linear(np.repeat(design, 10, axis=0), np.repeat(values, 10), np.repeat(np.arange(400), 10))
    np.testing.assert_allclose(tenfold.covariance, single.covariance, rtol=1e-9)
    p_values = [
        fit_linear(design, random.normal(size=400), np.arange(400) // 4).p_value((0, 1)) for _ in range(300)
    ]
    assert 0.01 < np.mean(np.array(p_values) < 0.05) < 0.09
