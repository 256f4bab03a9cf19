"""Logs that can show nothing, and the resolution below which an error counts as none."""

import numpy as np

from ballbot.findings import texts
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.validation import ErrorPair, ModelPair, findings, join_validations, validate, validate_pair
from tests.support.validation_examples import noisy_validation, perfect_log, true_robot


def _still() -> Log:
    log = perfect_log().between(0.0, 2.0)
    return log.with_columns({name: np.zeros(len(log)) for name in log.names if name != "t"})


def test_a_log_that_a_model_simulated_shows_nothing():
    validation = validate(true_robot(), perfect_log().between(0.0, 6.0))
    sentence = "This log was simulated by the model with friction itself"
    assert validation.no_evidence is not None
    assert validation.no_evidence.startswith(sentence)
    assert validation.open_loop is None
    assert validation.closed_loop is None
    # one sentence everywhere
    assert validation.summary().sentences == (validation.no_evidence,)
    assert texts(findings(validation)) == [validation.no_evidence]
    results = validation.results()
    assert results["no_open_loop"] == results["no_closed_loop"] == validation.no_evidence


def test_a_log_at_rest_shows_nothing():
    models = ModelPair.by_friction(Model(true_robot()))
    validation = validate_pair(models, _still())
    assert validation.no_evidence is not None
    assert validation.no_evidence.startswith("The log does not move")
    assert validation.closed_loop is None


def test_logs_that_show_nothing_are_left_out_of_those_joined():
    models = ModelPair.by_friction(Model(true_robot()))
    still, moving = validate_pair(models, _still()), noisy_validation()
    joined = join_validations([still, moving])
    assert joined.left_out == (still.no_evidence,)
    assert joined.duration == moving.duration
    assert still.no_evidence in texts(findings(joined))
    assert join_validations([still, still]).no_evidence == still.no_evidence


def test_an_error_below_the_floor_counts_as_the_floor():
    runs = [np.full((10, 10), value) for value in np.linspace(0.9, 1.1, 9)]
    exact = ErrorPair.of_runs(
        [np.zeros((10, 10))] * 9, [1e-16 * run for run in runs], [1e-13 * run for run in runs]
    )
    assert np.all(exact.unresolved)
    np.testing.assert_allclose(exact.ratio, 1.0)
    np.testing.assert_allclose(exact.ratio_interval(), 1.0)
    assert set(exact.verdicts()) == {"undecided"}
    assert np.isnan(exact.normalised_rmse).all()
