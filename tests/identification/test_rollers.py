"""Rollers in logs that the compiled loop made: they are found where they are, and not where there are none."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.control.controller import Controller
from ballbot.control.references import square
from ballbot.identification.prediction import Predictor, windows_for
from ballbot.identification.quantities import scale_between
from ballbot.identification.rollers import as_its_friction, on_points
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections, RollerContacts
from tests.support.validation_examples import gain, true_robot


def _robot() -> Robot:
    """Return a robot without play, whose friction is without the rollers' losses."""
    robot = true_robot().replace({"drive.backlash": 0.0})
    return robot.replace({"friction.roller_softness": 1.0})


def _log(contacts: RollerContacts | None) -> Log:
    robot = _robot()
    made = simulate_batch(
        Model(robot),
        Controller(robot, gain()),
        square(period=8.0),
        duration=16.0,
        imperfections=Imperfections(contacts=contacts, seed=3),
    )
    return made.log(0).without_truth()


@pytest.fixture(scope="module")
def rolling() -> Log:
    return _log(RollerContacts(rollers=_robot().wheels.rollers))


def _error(log: Log) -> float:
    """Return the root mean square error of theta's rate over windows of 0.25 s [rad/s]."""
    robot = _robot()
    coordinates = scale_between(robot)
    predictor = Predictor(robot=robot, step=log.sample_time, layout=coordinates.layout)
    windows = windows_for(predictor, coordinates.upper, [log], duration=0.25)
    residuals = predictor.residuals(coordinates.nominal[None], windows, every=5)
    return float(np.sqrt((residuals[0, ..., 7] ** 2).mean()))


def test_a_log_without_rollers_effects_is_predicted_better_by_friction_without_them(rolling):
    # what is left: within a window the rollers are where the log has them, not where the prediction has them
    assert _error(as_its_friction(rolling, _robot())) < 0.6 * _error(rolling)


def test_rollers_are_found_wherever_encoders_show_zero(rolling):
    names = wheel_angle_names(_robot().wheel_count)
    shift = dict(zip(names, (0.1, -0.05, 0.2), strict=True))
    shifted = rolling.with_columns({name: rolling[name] + shift[name] for name in names})
    (first, second), softness = on_points([rolling, shifted], _robot())
    # phases are tried in steps of a sixteenth of a pitch
    apart, change = first.torques - second.torques, first.torques - rolling.torques
    assert np.sqrt((apart**2).mean()) < 0.4 * np.sqrt((change**2).mean())
    # the model made the log: its contacts are as soft as the twin's, within a step of those tried
    assert 0.8 < softness < 1.25


def test_rollers_are_not_found_where_there_are_none():
    log = _log(None)
    (same,), softness = on_points([log], _robot())
    assert softness == 0.0
    assert same is log


def test_friction_with_the_rollers_losses_leaves_a_log_as_it_is(rolling):
    robot = _robot()
    with_losses = robot.replace(friction=replace(robot.friction, roller_softness=0.0))
    assert as_its_friction(rolling, with_losses) is rolling
