"""Intervals, and the findings about them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from ballbot.findings import texts
from ballbot.fitting.intervals import Interval, between, truncated_reach
from ballbot.fitting.uncertainty import WindowEquations, covariance, leverage_corrected
from ballbot.identification.quantities import scale_between
from ballbot.identification.result_findings import correlation_findings, interval_findings
from tests.support.control_examples import alten

COORDINATES = scale_between(alten())
LABELS = COORDINATES.labels


def place(label: str) -> int:
    return LABELS.index(label)


@pytest.mark.parametrize(
    ("label", "limits", "expected"),
    [
        ("c1", (-0.1, 0.4), (0.0, 0.2)),  # friction is not negative: zero is a limit
        ("c1", (0.2, 1.3), (0.1, math.inf)),  # the bound is ours, not the robot's
        ("v_s", (-0.1, 0.5), (-math.inf, math.sqrt(0.3))),
        ("delta", (None, None), (-math.inf, math.inf)),
    ],
)
def test_bounds_are_not_interval_limits_except_zero_of_an_amount(label, limits, expected):
    found = between(COORDINATES, place(label), *limits, method="profile")
    assert (found.lower, found.upper) == pytest.approx(expected)


def test_scores_without_leverage_make_the_jackknife_over_windows():
    random = np.random.default_rng(5)
    J, y = random.standard_normal((25, 6, 3)), random.standard_normal((25, 6))

    def fitted(rows: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.lstsq(J[rows].reshape(-1, 3), -y[rows].ravel())[0])

    everything = np.arange(25)
    estimate = fitted(everything)
    apart = np.array([fitted(np.delete(everything, i)) for i in everything]) - estimate
    left = y + J @ estimate
    equations = WindowEquations(np.einsum("wki,wkj->wij", J, J), np.einsum("wki,wk->wi", J, left))
    found = covariance(leverage_corrected(equations, np.ones(3, bool)), np.ones(3, bool))
    # `covariance` has W / (W - 1) where the jackknife about the estimate has (W - 1) / W
    np.testing.assert_allclose(found, np.einsum("wi,wj->ij", apart, apart) * 25 / 24, rtol=1e-8)


# --- words ---


def test_open_intervals_are_reported():
    two = Interval(lower=0.1, upper=0.2, method="clustered")
    found = interval_findings(
        {
            "b1": two,
            "v_s": replace(two, upper=math.inf),
            "delta": replace(two, lower=-math.inf),
            "s1": replace(two, lower=-math.inf, upper=math.inf),
            "c1": replace(two, lower=0.0, upper=math.inf),
        }
    )
    sentences = texts(found)
    assert [sentence.split()[0] for sentence in sentences] == ["s1", "c1", "v_s", "delta"]
    assert "its value means nothing" in sentences[0]
    assert "any value fits, zero included" in sentences[1]
    assert "limited from below only: 0.1 or more" in sentences[2]
    assert "limited from above only: 0.2 or less" in sentences[3]


@pytest.mark.parametrize(
    ("pair", "experiment"),
    [
        (("c1", "s1"), "slow motion through standstill"),
        (("b3", "c3"), "high and low speeds"),
        (("gain1", "l"), "data sheet's value"),
        (("late_imu", "delay"), "quick changes of torque"),
        (("offset2", "lean_x"), "half a turn apart"),
    ],
)
def test_unidentifiable_pairs_are_named_with_an_experiment(pair, experiment):
    sentences = texts(correlation_findings(pair, np.array([[1.0, -0.97], [-0.97, 1.0]])))
    assert f"{pair[0]} and {pair[1]} (-0.97)" in sentences[0]
    assert experiment in sentences[1]


def test_a_ridge_of_several_parameters_is_named():
    # three numbers of which the logs determine only the sum: every pair has a correlation of only -0.5
    random = np.random.default_rng(0)
    free = random.standard_normal((100_000, 3))
    known_sum = free - free.mean(axis=1, keepdims=True) + 1e-3 * random.standard_normal((100_000, 1))
    values = np.column_stack([known_sum, random.standard_normal(100_000)])
    labels, correlation = ("b1", "c1", "s1", "C_rr"), np.asarray(np.corrcoef(values, rowvar=False))
    sentence, *advice = texts(correlation_findings(labels, correlation))
    assert [words.split(", log")[0] for words in advice] == [
        "To separate viscous from dry friction",
        "To separate dry friction at rest from that at speed",
    ]
    assert sentence.startswith("b1, c1 and s1 are nearly collinear")
    assert correlation_findings(labels, np.eye(4)) == []


@pytest.mark.parametrize("beyond", [0.0, 0.5, 3.0, 29.0, 31.0, 1e6])
def test_an_interval_at_a_bound_is_never_of_zero_width(beyond):
    """A normal variable beyond the bound by so many deviations, known to be within it: 95 % lie below the reach."""
    reach = truncated_reach(beyond)
    assert reach > 0.0
    # logarithms of the tail do not underflow; beyond 30 it is taken as exponential, off by 0.3 %
    share = norm.logsf(beyond + reach) - norm.logsf(beyond)
    assert share == pytest.approx(math.log(0.05), rel=5e-3)
