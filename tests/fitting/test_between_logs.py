"""Joint random effects between logs: against the conjugate case and exact coverage."""

import numpy as np
import pytest

from ballbot.fitting.between_logs import spread

#: of c and s, which make up for one another, and of a third parameter
ERRORS = np.array([0.1, 0.1, 0.02])
RIDGE = np.outer(ERRORS, ERRORS) * np.array([[1.0, -0.98, 0.0], [-0.98, 1.0, 0.0], [0.0, 0.0, 1.0]])
SIZES = np.array([0.03, 0.03, 0.05])


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("degrees", [4.0, 15.0])
def test_without_errors_within_logs_it_is_the_conjugate_distribution(count: int, degrees: float) -> None:
    """C = 0: tau^2 has nu + (K - 1) p degrees, and its mean is (nu + sum of squares) / (these - 2)."""
    y = 1.0 + SIZES * np.random.default_rng(count).standard_normal((count, 3))
    nothing = np.tile(1e-10 * np.diag(SIZES**2), (count, 1, 1))
    found = spread(y, nothing, SIZES, degrees=degrees)
    squares = (((y - y.mean(axis=0)) / SIZES) ** 2).sum()
    mean = (degrees + squares) / (degrees + 3 * (count - 1) - 2.0)
    # the grid of tau ends at 50, beyond which a prior of 4 degrees has 2e-3 of the mean
    assert found.factor**2 == pytest.approx(mean, rel=5e-3)
    np.testing.assert_allclose(found.covariance, mean * np.diag(SIZES**2) / count, rtol=5e-3, atol=1e-12)


def drawn(random: np.random.Generator, count: int, degrees: float) -> np.ndarray:
    """Return the estimates (k, 3) from logs of a robot whose parameters are zero and whose tau is of the prior."""
    tau = np.sqrt(degrees / random.chisquare(degrees))
    within = random.multivariate_normal(np.zeros(3), RIDGE, count)
    return within + tau * SIZES * random.standard_normal((count, 3))


def test_the_covariance_is_that_of_the_estimates_over_robots_drawn_from_the_prior() -> None:
    random, robots, count = np.random.default_rng(1), 800, 3
    errors, stated = np.zeros((robots, 3)), np.zeros((3, 3))
    for i in range(robots):
        y = drawn(random, count, 8.0)
        errors[i] = y.mean(axis=0)  # the logs are alike, so it is m
        stated += spread(y, np.tile(RIDGE, (count, 1, 1)), SIZES, degrees=8.0).covariance / robots
    found = errors.T @ errors / robots
    scale = np.sqrt(np.outer(stated.diagonal(), stated.diagonal()))
    # an entry of a covariance of 800 draws errs by sqrt(2 / 800) of the scale, with heavy tails by somewhat more
    np.testing.assert_allclose(found / scale, stated / scale, atol=5.0 * np.sqrt(2.0 / robots))
    # c and s keep their large errors, their sum gets one of the size of the variation
    g = np.array([1.0, 1.0, 0.0])
    assert np.sqrt(stated[0, 0]) > 0.9 * 0.1 / np.sqrt(count)
    assert np.sqrt(g @ stated @ g) < 0.08 / np.sqrt(count)


def test_logs_that_disagree_widen_and_are_found() -> None:
    C = np.tile(RIDGE, (3, 1, 1))
    alike = spread(np.zeros((3, 3)), C, SIZES, degrees=6.0)
    # beyond the ridge of c and s, along which they differ by chance
    along = spread(np.array([[0.1, -0.1, 0.0], [-0.1, 0.1, 0.0], [0.0, 0.0, 0.0]]), C, SIZES, degrees=6.0)
    across = spread(np.array([[0.2, 0.2, 0.0], [-0.2, -0.2, 0.0], [0.0, 0.0, 0.0]]), C, SIZES, degrees=6.0)
    assert along.p_value > 0.05 > across.p_value
    assert across.factor > 3.0 * alike.factor
    assert along.factor < 1.1 * alike.factor
