"""Least squares against closed forms and plain formulas."""

import numpy as np

from ballbot.fitting.least_squares import fit_linear


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
