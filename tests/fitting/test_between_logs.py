"""Random effects between logs: against Student's t, exact coverage, and priors that are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ballbot.fitting.between_logs import (
    Limits95,
    RobotLogs,
    VariancePrior,
    fit_prior,
    interval_score,
    vary,
)


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("degrees", [4.0, 15.0])
def test_without_errors_within_logs_it_is_students_t(count: int, degrees: float) -> None:
    """v = 0 is conjugate: nu + K - 1 degrees, scale^2 = (nu s^2 + sum (y - mean)^2) / (nu + K - 1)."""
    y = np.array([1.0, 1.3, 0.8, 1.1, 0.95])[:count]
    prior = VariancePrior(scale=0.2, degrees=degrees)
    found = vary(y, np.zeros(count), prior=prior, next_error=0.0)
    freedom = degrees + count - 1.0
    scale = np.sqrt((degrees * 0.2**2 + ((y - y.mean()) ** 2).sum()) / freedom)
    for limits, width in (
        (found.parameter, np.sqrt(1.0 / count)),
        (found.prediction, np.sqrt(1.0 + 1.0 / count)),
    ):
        half = stats.t.ppf(0.975, freedom) * scale * width
        # the grid of tau has 241 values
        assert limits.lower == pytest.approx(y.mean() - half, abs=2e-3 * half)
        assert limits.upper == pytest.approx(y.mean() + half, abs=2e-3 * half)


@pytest.mark.slow
@pytest.mark.parametrize("count", [pytest.param(1, marks=pytest.mark.sample), 3])
def test_coverage_over_robots_drawn_from_the_prior_is_exact(count: int) -> None:
    """Both intervals contain what they are for in 95 % of robots whose tau is drawn from the prior."""
    random = np.random.default_rng(1)
    prior = VariancePrior(scale=0.5, degrees=5.0)
    robots, inside = 2000, np.zeros(2)
    for _ in range(robots):
        tau = prior.scale * np.sqrt(prior.degrees / random.chisquare(prior.degrees))
        errors = random.uniform(0.1, 1.0, count + 1)
        y = 3.0 + tau * random.standard_normal(count + 1) + errors * random.standard_normal(count + 1)
        found = vary(y[1:], errors[1:], prior=prior, next_error=float(errors[0]))
        inside += [
            found.parameter.lower <= 3.0 <= found.parameter.upper,
            found.prediction.lower <= y[0] <= found.prediction.upper,
        ]
    # four standard deviations of a binomial count
    assert np.all(np.abs(inside / robots - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / robots))


@given(
    y=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=6),
    unit=st.floats(1e-6, 1e6),
    shift=st.floats(-1e3, 1e3),
    errors=st.lists(st.floats(0.0, 10.0), min_size=6, max_size=6),
)
def test_units_and_zero_point_do_not_matter(
    y: list[float], unit: float, shift: float, errors: list[float]
) -> None:
    """Limits of a x + b are a times the limits of x, plus b; and each interval contains the mean."""
    values, within = np.array(y), np.array(errors[: len(y)])
    one = vary(values, within, prior=VariancePrior(scale=1.0, degrees=6.0), next_error=1.0)
    other = vary(
        unit * (values + shift),
        unit * within,
        prior=VariancePrior(scale=unit, degrees=6.0),
        next_error=unit,
    )
    size = one.prediction.upper - one.prediction.lower
    for mine, theirs in ((one.parameter, other.parameter), (one.prediction, other.prediction)):
        assert theirs.lower / unit - shift == pytest.approx(mine.lower, abs=1e-6 * (size + abs(shift)))
        assert theirs.upper / unit - shift == pytest.approx(mine.upper, abs=1e-6 * (size + abs(shift)))
    assert (
        one.prediction.lower < one.parameter.lower <= one.mean <= one.parameter.upper < one.prediction.upper
    )
    assert one.between_limits.lower < one.between < one.between_limits.upper


def test_logs_that_disagree_widen_the_prediction() -> None:
    prior = VariancePrior(scale=0.1, degrees=6.0)
    errors = np.full(3, 0.1)
    alike = vary(np.array([1.0, 1.01, 0.99]), errors, prior=prior, next_error=0.1)
    apart = vary(np.array([1.0, 3.0, -1.0]), errors, prior=prior, next_error=0.1)
    assert apart.between > 5.0 * alike.between
    assert apart.prediction.upper - apart.prediction.lower > 5.0 * (
        alike.prediction.upper - alike.prediction.lower
    )


@pytest.mark.slow
@pytest.mark.parametrize("count", [pytest.param(400, marks=pytest.mark.sample), 100])
def test_the_prior_of_many_robots_is_recovered(count: int) -> None:
    """400 robots of two logs: the scale to 15 %, four times its standard error over such samples; of 100, to 30 %."""
    random = np.random.default_rng(2)
    robots = []
    for _ in range(count):
        tau = 0.5 * np.sqrt(8.0 / random.chisquare(8.0))
        errors = np.full(2, random.uniform(0.1, 0.5))
        y = tau * random.standard_normal(2) + errors * random.standard_normal(2)
        robots.append(RobotLogs(estimates=y, errors=errors, beyond=np.zeros(2, dtype=int)))
    found = fit_prior(robots, most_degrees=60.0)
    assert found.scale == pytest.approx(0.5, rel=3.0 / np.sqrt(count))
    assert found.degrees > 3.0


@pytest.mark.sample
def test_estimates_at_a_bound_do_not_narrow_the_prior() -> None:
    """Of 400 robots with a bound that half of the estimates exceed: the scale as it was drawn, to 20 %.

    Taken as they stand, at the bound, they agree with each other, and the prior would be far too narrow.
    """
    random = np.random.default_rng(3)
    bounded, taken = [], []
    for _ in range(400):
        errors = np.full(2, 0.1)
        y = random.standard_normal() + 0.5 * random.standard_normal(2) + errors * random.standard_normal(2)
        beyond = np.where(y >= 0.0, 1, 0)
        at = np.minimum(y, 0.0)
        bounded.append(RobotLogs(estimates=at, errors=errors, beyond=beyond))
        taken.append(RobotLogs(estimates=at, errors=errors, beyond=np.zeros(2, dtype=int)))
    assert fit_prior(bounded, most_degrees=60.0).scale == pytest.approx(0.5, rel=0.2)
    assert fit_prior(taken, most_degrees=60.0).scale < 0.3


@pytest.mark.sample
def test_errors_that_differ_from_log_to_log_widen_the_prior() -> None:
    """A log predicts the next one by its own error; what the next one's exceeds it by belongs to the prior."""
    random = np.random.default_rng(4)
    robots, inside = [], 0
    draws = [(random.choice([0.1, 1.0], 2), random.standard_normal(2)) for _ in range(800)]
    for errors, normal in draws[:400]:
        robots.append(RobotLogs(estimates=errors * normal, errors=errors, beyond=np.zeros(2, dtype=int)))
    prior = fit_prior(robots, most_degrees=60.0)
    for errors, normal in draws[400:]:
        found = vary(errors[:1] * normal[:1], errors[:1], prior=prior, next_error=float(errors[0])).prediction
        inside += found.lower <= errors[1] * normal[1] <= found.upper
    # 95 %, less three deviations of a binomial count of 400, and the shape is not that of the prior
    assert inside / 400 > 0.9


def test_interval_score_is_the_width_and_twice_the_miss_over_the_level() -> None:
    limits = Limits95(lower=1.0, upper=3.0)
    assert interval_score(limits, 2.0) == 2.0
    assert interval_score(limits, 3.5) == pytest.approx(2.0 + 40.0 * 0.5)
    assert interval_score(limits, 0.0) == pytest.approx(2.0 + 40.0 * 1.0)
