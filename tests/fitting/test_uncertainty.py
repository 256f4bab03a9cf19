"""Covariances of estimates, and whether groups of windows agree."""

import numpy as np
import pytest

from ballbot.fitting.uncertainty import WindowEquations, correlation, discrepancy


@pytest.mark.slow
def test_discrepancy_of_a_right_model_is_as_rare_as_its_level_and_a_wrong_one_is_seen():
    """Scores of windows that are alike: p is uniform. Groups of which one is pulled the other way: p is least."""
    random = np.random.default_rng(3)
    groups, estimated = np.repeat(np.arange(3), 30), np.array([True, True, False, True])
    p_values = []
    for _ in range(100):
        scores = random.standard_normal((90, 4)) @ random.standard_normal((4, 4))
        equations = WindowEquations(matrices=np.zeros((90, 4, 4)), scores=scores - scores.mean(axis=0))
        p_values.append(discrepancy(equations, groups, estimated, seed=1).p_value)
    # 100 uniform numbers: the largest distance of their distribution is below 0.163 with 99 %
    assert np.max(np.abs(np.sort(p_values) - np.arange(1, 101) / 100)) < 0.163
    pulled = random.standard_normal((90, 4)) + np.array([1.0, 0.0, -1.0])[groups][:, None]
    equations = WindowEquations(np.zeros((90, 4, 4)), pulled - pulled.mean(axis=0))
    found = discrepancy(equations, groups, estimated, seed=1)
    assert found.p_value == pytest.approx(1e-3)
    assert found.factor > 1.5


def test_correlation_of_a_covariance_that_rounding_made_indefinite_is_one():
    indefinite = np.array([[4.0, np.nan, 2.2], [np.nan, np.nan, np.nan], [2.2, np.nan, 1.0]])
    found = correlation(indefinite)[np.ix_([0, 2], [0, 2])]
    # the nearest that is a covariance has both in proportion
    np.testing.assert_allclose(found, 1.0)
    assert np.linalg.eigvalsh(found)[0] > -1e-12
