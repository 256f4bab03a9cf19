"""Logs with a known friction, for tests of identification."""

from functools import cache

import numpy as np

from ballbot import Controller, Log, Model, lqr, simulate
from ballbot.control import references
from ballbot.log import STATE_NAMES
from ballbot.robot import Friction, Robot
from ballbot.robot.components import PARAMETERS
from tests.support.control_examples import FRICTION, alten

#: the friction behind `balancing_log`, in the order of `ballbot.identification.quantities`
TRUTH = np.array([*FRICTION.viscous, *FRICTION.coulomb, *FRICTION.stribeck, 0.6, 1.1, 0.007])

#: standard deviations of good sensors' noise, for x y theta phi psi and their rates
NOISE = np.array([1e-4, 1e-4, 5e-4, 5e-4, 5e-4, 1e-3, 1e-3, 7e-4, 7e-4, 7e-4])


@cache
def balancing_log(*, friction: Friction = FRICTION, duration: float = 25.0) -> Log:
    """Return a log without noise of the thesis's robot on a square, balanced by a gain that lets it wander."""
    weights = np.diag([20.0, 20.0, 500.0, 500.0, 5.0, 30.0, 30.0, 20.0, 20.0, 2.0])
    gain = lqr(Model(alten()), weights, 30.0 * np.eye(3), sample_time=0.005).gain
    plant = Model(alten(friction))
    controller = Controller(alten(), gain, sample_time=0.005)
    log = simulate(plant, controller, references.square(side=0.5, period=16.0), duration=duration)
    return log.without_truth()


def noisy(log: Log, *, seed: int) -> Log:
    """Return the log with `NOISE` in its states."""
    random = np.random.default_rng(seed)
    noise = NOISE * random.standard_normal((len(log), 10))
    return log.with_columns({name: log[name] + noise[:, i] for i, name in enumerate(STATE_NAMES)})


def late(log: Log, *, imu: float, velocity: float, friction: Friction = FRICTION) -> Log:
    """Return a simulated log as an IMU and velocities that are late by so much [s] show it.

    Between rows the model is stepped on from each of them, five times as finely.
    """
    plant, fine = Model(alten(friction)), 5
    step = log.sample_time / fine
    rows = []
    for state, u in zip(log.states[:-1], log.torques[:-1], strict=True):
        for _ in range(fine):
            rows.append(state)
            state = plant.advance(state, u, step)
    states = np.array([*rows, log.states[-1]])
    times = log.t[0] + step * np.arange(len(states))
    delays = dict.fromkeys(STATE_NAMES, imu) | {"x": 0.0, "y": 0.0, "x_dot": velocity, "y_dot": velocity}
    return log.with_columns(
        {name: np.interp(log.t - delays[name], times, states[:, i]) for i, name in enumerate(STATE_NAMES)}
    )


def exact() -> Robot:
    """Return the thesis's robot without friction, of which the file is right."""
    names = [
        "drive.torque_constant",
        "sensors.sample_time",
        *(item.name for item in PARAMETERS if item.error),
    ]
    return alten().annotated(standard_deviations=dict.fromkeys(names, 0.0))
