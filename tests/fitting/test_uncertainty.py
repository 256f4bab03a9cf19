"""The block bootstrap of an estimate, against least squares done anew and against many repeats."""

import numpy as np
import pytest

from ballbot.fitting.uncertainty import (
    WindowEquations,
    block_length,
    bootstrap,
    correlation,
    covariance,
    discrepancy,
    resamples,
)


def equations_of(J: np.ndarray, residual: np.ndarray) -> WindowEquations:
    """Return the equations of windows with J (w, k, p) and residual (w, k)."""
    return WindowEquations(np.einsum("wki,wkj->wij", J, J), np.einsum("wki,wk->wi", J, residual))


def test_neighbours_are_drawn_together():
    drawn = resamples(1000, block=10, repeats=200, seed=0) - 1.0
    # two windows of one block differ by the blocks that begin or end between them only: 1 of 10
    together = np.mean(drawn[:, 1:] * drawn[:, :-1]) / np.mean(drawn**2)
    # 200 000 products of neighbours give it to about 0.01
    assert together == pytest.approx(0.9, abs=0.03)


def test_one_step_is_the_whole_way_where_the_problem_is_linear():
    random = np.random.default_rng(1)
    J, y = random.standard_normal((30, 8, 3)), random.standard_normal((30, 8))
    estimate = np.linalg.lstsq(J.reshape(-1, 3), -y.ravel())[0]
    shifts = bootstrap(equations_of(J, y + J @ estimate), np.ones(3, bool), seed=4, repeats=5)
    drawn = resamples(30, block=block_length(30), repeats=5, seed=4)
    for times, shift in zip(drawn, shifts, strict=True):
        rows = np.repeat(np.arange(30), times.astype(int))
        anew = np.linalg.lstsq(J[rows].reshape(-1, 3), -y[rows].ravel())[0]
        # the ridge of 1e-12 that keeps a resample's equations soluble
        np.testing.assert_allclose(estimate + shift, anew, rtol=1e-8)


def test_errors_are_those_of_many_repeats_where_neighbouring_windows_depend_on_each_other():
    # a disturbance that lasts several windows: clustered by window, standard errors come out too small
    random = np.random.default_rng(3)
    count, repeats, memory = 400, 200, 0.7
    J = np.repeat(np.ones((count, 1, 1)), 5, axis=1)
    estimates, resampled, clustered = [], [], []
    for seed in range(repeats):
        slow = np.zeros(count)
        for k in range(1, count):
            slow[k] = memory * slow[k - 1] + random.standard_normal()
        residual = slow[:, None] + 0.1 * random.standard_normal((count, 5))
        shift = -residual.mean()
        equations = equations_of(J, residual + shift)
        estimates.append(shift)
        resampled.append(bootstrap(equations, np.array([True]), seed=seed, repeats=200).std())
        clustered.append(np.sqrt(covariance(equations, np.array([True]))[0, 0]))
    true = np.std(estimates)
    # of a memory of 0.7 the clustered errors see 1 / sqrt((1 + 0.7) / (1 - 0.7)) = 0.42
    assert np.median(clustered) / true == pytest.approx(0.42, abs=0.05)
    # blocks of 7 lose 2 * 0.7 / (1 - 0.7^2) / 7 of the long-run variance's 5.7: 10 % of the error or so
    assert np.median(resampled) / true == pytest.approx(0.83, abs=0.08)


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
