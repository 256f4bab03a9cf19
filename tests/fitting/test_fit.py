"""The one fit on plain experiments, against closed forms."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from ballbot.fitting.experiment import Residuals, residuals_without_states
from ballbot.fitting.fit import fit, released
from ballbot.fitting.parameter import FitParameter, Limits


def signed(name: str, bounds: Limits = (-5.0, 5.0)) -> FitParameter:
    return FitParameter(name=name, symbol=name, unit="1", scale="signed", bounds=bounds, default=0.0)


def line(seed: int, b: float = -0.8, **more: Limits) -> tuple[Residuals, np.ndarray, np.ndarray]:
    """Return the experiment of a linear model with two parameters, its columns and its values."""
    random = np.random.default_rng(seed)
    X = random.normal(size=(400, 2))
    values = X @ [0.3, b] + 0.1 * random.normal(size=400)
    made = residuals_without_states(
        lambda p: (X @ p - values).reshape(100, 4),
        parameters=(signed("a", **more), signed("b")),
        block=np.arange(400),
        block_log=np.zeros(400, dtype=np.int64),
    )
    return made, X, values


def test_fit_of_a_linear_model_is_the_closed_form_with_the_jackknife_of_its_rows():
    made, X, values = line(11)
    found = fit(made, made.coordinates.scaled(np.zeros(2)))
    assert_allclose(found.values, np.linalg.lstsq(X, values, rcond=None)[0], atol=1e-9)
    plain = np.linalg.inv(X.T @ X) * np.mean((values - X @ found.values) ** 2)
    # rows are independent; their squares scatter
    assert_allclose(found.covariance, plain, rtol=0.25, atol=0.1 * plain.max())


def test_a_parameter_is_estimated_if_held_out_blocks_tell_it_and_otherwise_moves_the_errors_of_others():
    for b in (-0.8, 0.0):
        made, X, _ = line(11, b)
        narrower = replace(made, coordinates=made.coordinates.holding("b"))
        held = fit(narrower, narrower.coordinates.scaled(np.zeros(2)))
        found = released(held, made, "b", deviation=0.5)
        if b:
            assert_allclose(found.values, fit(made, made.coordinates.scaled(np.zeros(2))).values, atol=1e-9)
            assert found.errors.max() < 0.01  # 0.1 / sqrt(400), rows being independent
        else:
            assert_allclose(found.values, held.values)
            # a is the regression of the values less b x_2 on x_1
            moved = np.array([-0.5 * (X[:, 0] @ X[:, 1]) / (X[:, 0] @ X[:, 0]), 0.5])
            own = np.diag([held.covariance[0, 0], 0.0])
            assert_allclose(found.covariance, own + np.outer(moved, moved), rtol=1e-6, atol=1e-12)


def test_fit_ends_at_a_bound_and_gives_no_error_there():
    made, X, values = line(12, bounds=(-5.0, 0.2))
    found = fit(made, made.coordinates.scaled(np.zeros(2)))
    assert found.at_bound.tolist() == [True, False]
    assert np.isnan(found.errors[0])
    assert_allclose(found.values[1], X[:, 1] @ (values - 0.2 * X[:, 0]) / (X[:, 1] @ X[:, 1]), atol=1e-6)


def test_a_wide_interval_is_a_profile_which_is_that_of_the_error_where_the_model_is_linear():
    made, _, _ = line(11, bounds=(0.285, 0.315))
    found = fit(made, made.coordinates.scaled(np.array([0.3, 0.0])))
    of = found.uncertainty.intervals
    # the half width of a is a third of its bounds' width, that of b a thousandth
    assert (of["a"].method, of["b"].method) == ("profile", "clustered")
    half = found.quantile * found.errors
    assert_allclose([of["b"].lower, of["b"].upper], found.values[1] + half[1] * np.array([-1.0, 1.0]))
    # a limit is accepted if the rise, the square of the distance, is right to a fifth
    assert_allclose(
        [of["a"].lower, of["a"].upper], found.values[0] + half[0] * np.array([-1.0, 1.0]), atol=0.1 * half[0]
    )


def test_part_of_an_experiment_is_the_experiment_of_these_blocks():
    made, X, values = line(13)
    part = made.part(np.arange(100, 300)).part(np.arange(50, 150))
    found = fit(part, part.coordinates.scaled(np.zeros(2)))
    assert_allclose(found.values, np.linalg.lstsq(X[150:250], values[150:250], rcond=None)[0], atol=1e-9)


def test_of_two_optima_the_lower_is_the_estimate_and_the_other_is_told():
    random = np.random.default_rng(14)
    x, w, noise = random.normal(size=(3, 400))
    # exactly so much worse is the other sign: noise and w are orthogonal
    noise -= w * (w @ noise) / (w @ w)
    made = residuals_without_states(
        lambda a: x * (a**2 - 1.0) + 0.02 * w * (a + 1.0) + noise,
        parameters=(signed("a"),),
        block=np.arange(400),
        block_log=np.zeros(400, dtype=np.int64),
    )
    # three of four starts lie nearer to the worse one
    starts = made.coordinates.scaled(np.array([[0.8], [1.2], [2.0], [-3.0]]))
    found = fit(made, starts)
    assert_allclose(found.values, [-1.0], atol=0.1)
    assert found.other is not None
    assert_allclose(found.other.values, [1.0], atol=0.1)
    at_one = np.log(np.mean((0.04 * w + noise) ** 2) / np.mean(noise**2)) / 2.0
    # the optima lie a little beside 1 and -1, where x and w or noise are not orthogonal
    assert_allclose(found.other.rise, at_one, rtol=0.1)
