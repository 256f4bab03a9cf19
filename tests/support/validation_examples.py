"""A balancing robot whose friction is known, and logs of it."""

from functools import cache

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.control.references import square
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.validation import Validation, validate
from tests.support.control_examples import FRICTION

#: standard deviations of the sensors' noise, in the order of the states
NOISE = np.array([1e-4, 1e-4, 6e-4, 6e-4, 1e-3, 2e-3, 2e-3, 4e-3, 4e-3, 4e-3])


@cache
def true_robot() -> Robot:
    """Return the preset with the known friction."""
    return Robot.load("alten").replace(friction=FRICTION)


@cache
def gain() -> np.ndarray:
    """Return the gain that the logs are recorded with."""
    return design_gain(true_robot()).gain


@cache
def perfect_log(duration: float = 24.0) -> Log:
    """Return a log of the robot on a square whose sensors are perfect; no true_ columns."""
    start = np.zeros(10)
    start[2:5] = 0.01, -0.015, 0.05
    log = simulate(
        Model(true_robot()),
        Controller(true_robot(), gain()),
        square(period=16.0),
        duration=duration,
        initial_state=start,
    )
    return log.without_truth()


@cache
def noisy_log(duration: float = 24.0) -> Log:
    """Return the same log seen through white noise of the standard deviations `NOISE`."""
    return with_noise(perfect_log(duration))


def with_noise(log: Log, *, scale: float = 1.0) -> Log:
    """Return a log seen through white noise of so many times the standard deviations `NOISE`."""
    noise = np.random.default_rng(7).normal(size=(len(log), 10)) * (scale * NOISE)
    return log.with_columns({name: log[name] + noise[:, i] for i, name in enumerate(STATE_NAMES)})


@cache
def noisy_validation() -> Validation:
    """Return the validation of the known robot on the whole noisy log."""
    return validate(true_robot(), noisy_log())


@cache
def wheel_log(*, duration: float = 40.0) -> Log:
    """Return a noisy log of the known robot around a square, with encoders."""
    return with_noise(perfect_log(duration))
