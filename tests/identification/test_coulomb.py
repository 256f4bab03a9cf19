"""The Coulomb equivalent: against a line fitted by NumPy, its errors against drawn parameters, and its limits."""

import numpy as np
import pytest

from ballbot.identification.coulomb import coulomb_equivalent, coulomb_sentence
from ballbot.identification.quantities import FRICTION, Layout

LAYOUT = Layout(wheel_count=3)
SPEEDS = np.linspace(-3.0, 3.0, 2001)[:, None] * np.array([1.0, 0.7, 1.3])
VALUES = np.array([0.014] * 3 + [0.11, 0.09, 0.12] + [0.05, 0.04, 0.06] + [0.6, 1.1, 0.007])


def found(values: np.ndarray, errors: np.ndarray | None = None, correlation: np.ndarray | None = None):
    return coulomb_equivalent(
        LAYOUT,
        values,
        covariance=(np.eye(12) if correlation is None else correlation)
        * (np.nan if errors is None else np.outer(errors, errors)),
        wheel_speeds=SPEEDS,
    )


@pytest.mark.parametrize(("v_s", "delta"), [(0.6, 1.1), (0.1, 0.3), (3.0, 10.0), (0.45, 3.6)])
def test_it_is_the_value_at_rest_of_the_line_that_numpy_fits(v_s: float, delta: float) -> None:
    values = VALUES.copy()
    values[9:11] = v_s, delta
    got = found(values)
    for i in range(3):
        w = np.linspace(0.0, got.speeds[i], 20_001)
        dry = values[3 + i] + values[6 + i] * np.exp(-((w / v_s) ** delta))
        # the cusp at rest of a small exponent costs the midpoint rule up to 1e-4 of s
        assert got.values[i] == pytest.approx(np.polyfit(w, dry, 1)[1], abs=2e-4 * values[6 + i])


def test_its_errors_are_those_of_drawn_parameters() -> None:
    errors = np.array([2e-3] * 3 + [0.02] * 3 + [0.02] * 3 + [0.03, 0.05, 1e-3])
    R = np.eye(12)
    for i in range(3):
        R[3 + i, 6 + i] = R[6 + i, 3 + i] = -0.9
    got = found(VALUES, errors, R)
    drawn = np.random.default_rng(1).multivariate_normal(VALUES, R * np.outer(errors, errors), size=1500)
    deviations = np.array([found(row).values for row in drawn]).std(axis=0)
    # 1500 draws give a deviation to 1.8 %, and the derivatives are those at the estimate
    np.testing.assert_allclose(got.standard_errors, deviations, rtol=0.07)
    assert np.all(got.standard_errors < 0.6 * errors[3:6])


@pytest.mark.parametrize(("of_c", "of_s", "compared"), [(0.0027, 0.2, "c"), (0.04, 0.05, "c_e")])
def test_the_better_determined_of_the_two_is_compared(of_c: float, of_s: float, compared: str) -> None:
    """s and c alone are uncertain if their sum is known; c is the one if s is all but open."""
    errors = np.array([1e-3] * 3 + [of_c] * 3 + [of_s] * 3 + [np.nan, np.nan, 1e-4])
    R = np.eye(12)
    if compared == "c_e":  # as c + s is known
        for i in range(3):
            R[3 + i, 6 + i] = R[6 + i, 3 + i] = -0.97
    got = found(VALUES, errors, R)
    assert got.compared == compared
    first = {"c": got.coulomb, "c_e": got.values}[compared][0]
    assert f"{first:.2f}"[:4] in coulomb_sentence(got, FRICTION).partition(":")[0]
