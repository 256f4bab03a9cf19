"""Any two models side by side: which is called better, by what names, and from the command line."""

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.findings import texts
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.validation import ModelPair, NamedModel, findings, validate, validate_pair
from tests.support.foreign_log_examples import small_robot, swaying_log
from tests.support.validation_examples import noisy_log, true_robot


def _viscous() -> Robot:
    """Return the known robot with all of its friction taken for viscous."""
    robot = true_robot()
    none = (0.0, 0.0, 0.0)
    return robot.replace(
        {"friction.viscous": (0.1, 0.1, 0.1), "friction.coulomb": none, "friction.stribeck": none}
    )


def _pair(first: Model, second: Model, *, files: tuple[str, str]) -> ModelPair:
    return ModelPair(NamedModel(f"of {files[0]}", first), NamedModel(f"of {files[1]}", second))


@pytest.mark.slow
def test_swapping_the_models_inverts_every_ratio_and_verdict():
    models = _pair(Model(true_robot()), Model(_viscous()), files=("true.toml", "viscous.toml"))
    swapped = ModelPair(models.second, models.first)
    log = noisy_log().between(0.0, 12.0)
    one, other = (validate_pair(pair, log) for pair in (models, swapped))
    assert one.open_loop is not None
    assert other.open_loop is not None
    # the runs are cut where either model falls, so that they are the same
    np.testing.assert_allclose(one.open_loop.errors.ratio, 1.0 / other.open_loop.errors.ratio, rtol=1e-12)
    assert set(one.open_loop.errors.verdicts()) == {"better"}
    assert set(other.open_loop.errors.verdicts()) == {"worse"}
    np.testing.assert_allclose(one.horizon.ratio, 1.0 / other.horizon.ratio, rtol=1e-12)
    adequacy, better = findings(one)[:2]
    assert adequacy.code == "adequacy"
    assert "the model of true.toml is better than the one of viscous.toml in every one" in better.text
    assert "worse in x, y" in other.open_loop.verdict()


@pytest.mark.slow
def test_the_formulation_that_made_the_log_is_found_in_closed_loop():
    models = _pair(Model(true_robot()), Model(true_robot(), formulation="thesis"), files=("exact", "thesis"))
    validation = validate_pair(models, noisy_log().between(0.0, 12.0))
    assert validation.closed_loop is not None
    assert validation.closed_loop.restarted.ratio[:4].min() > 1.5
    # without friction both start at the same noise: they differ only after half a second
    assert np.median(validation.horizon.ratio[0]) == pytest.approx(1.0, abs=0.02)


def test_models_that_cannot_be_compared_are_refused():
    model = Model(true_robot())
    with pytest.raises(InputError, match="are the same"):
        _pair(model, model, files=("a", "b"))
    with pytest.raises(InputError, match="give them different names"):
        _pair(model, Model(_viscous()), files=("a", "a"))
    with pytest.raises(InputError, match="no friction to validate"):
        ModelPair.by_friction(Model(Robot.load("alten")))
    with pytest.raises(InputError, match="4 wheels"):
        _pair(model, Model(Robot.load("cmu")), files=("a", "cmu"))


@pytest.mark.slow
def test_pushed_log_gets_no_open_loop_verdict():
    log = swaying_log()
    push = 0.03 * np.sin(2.0 * np.pi * 1.5 * log.t)
    pushed = log.with_columns({"theta": log["theta"] + push})
    validation = validate(small_robot(), pushed, accept=["lean-scale"])
    assert validation.open_loop is None
    assert validation.closed_loop is None
    said = " ".join(texts(findings(validation)))
    assert "No open-loop validation: Something other than wheels and gravity moves the lean" in said
    assert "Open loop," not in said
    assert "open_loop" not in validation.to_dict()
