"""Models whose ball pivots, against logs in which it does."""

import numpy as np
import pytest

from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch
from ballbot.validation import ModelPair, validate
from ballbot.validation.models import forecast, model_of
from tests.support.validation_examples import true_robot

ARM = 1e-3  # of pivoting friction [m]: a twentieth of the presets'


def _turning(robot: Robot) -> Log:
    """Return a log of a robot that turns on the spot, whose ball pivots."""

    def reference(t: float) -> np.ndarray:
        return np.array([0.0, 0.0, 0.0, 0.0, 0.8 * np.sin(2.0 * t), *5 * [0.0]])

    model = Model(robot, pivoting=robot.pivoting_torque)
    return simulate_batch(model, "nominal", reference, duration=12.0).log(0)


def test_a_stated_arm_lets_the_ball_pivot_in_forecast_and_validation():
    robot = true_robot().replace({"friction.pivoting": ARM})
    log = _turning(robot)
    starts = np.arange(100, 1000, 100)
    pivoting, rigid = forecast([model_of(robot), Model(robot)], log, starts, 40)
    measured = log.states[starts[:, None] + np.arange(1, 41)]
    # its own model predicts the log to the spin that differences of encoders show; a rigid one does not
    assert np.abs(pivoting - measured)[..., 9].max() < 0.1 * np.abs(rigid - measured)[..., 9].max()
    pair = ModelPair.by_friction(model_of(robot))
    assert [model.pivoting for model in pair.both] == [pytest.approx(robot.weight * ARM)] * 2
    # without noise it would be called the model's own
    random = np.random.default_rng(0)
    noisy = log.with_columns(
        {name: log[name] + 1e-4 * random.standard_normal(len(log)) for name in STATE_NAMES}
    )
    result = validate(robot, noisy, controller="nominal")
    assert result.closed_loop is not None
    assert result.closed_loop.restarted.rmse[0, 9] < 0.1 * np.std(log["psi_dot"])
    assert [run.fell for run in result.closed_loop.whole] == [(0, 0)]
