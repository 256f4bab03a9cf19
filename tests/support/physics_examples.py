"""Logs of balancing for tests of the physics checks, and mistakes made in their columns."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from ballbot import Controller, Model, Robot, simulate
from ballbot.control import references
from ballbot.control.presets import nominal_controller
from ballbot.log import STATE_NAMES, Log
from ballbot.robot.components import scaled_body
from tests.support.control_examples import FRICTION

#: of x y theta phi psi and their rates, as of an IMU and of encoders [m, rad, m/s, rad/s]
NOISE = np.array([1e-5, 1e-5, 1.7e-3, 1.7e-3, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3])


@cache
def balancing(name: str = "alten", *, seed: int = 1, mass: float = 1.0) -> tuple[Log, Robot]:
    """Return a log of 12 s around a square on a robot with friction, and the robot; `mass` scales the true body."""
    robot = Robot.load(name)
    true = robot.replace(friction=FRICTION, body=scaled_body(robot.body, mass=mass, height=1.0))
    feedback = NoisyFeedback(nominal_controller(robot), seed)
    log = simulate(Model(true), feedback, references.square(side=0.5, period=12.0), duration=12.0)
    measured = np.array(feedback.measured[: len(log)])
    return log.without_truth().with_columns(dict(zip(STATE_NAMES, measured.T, strict=True))), robot


class NoisyFeedback:
    """A controller that feeds back noisy states, and keeps them."""

    def __init__(self, controller: Controller, seed: int) -> None:
        self._controller, self._seed = controller, seed
        self.sample_time = controller.sample_time
        self.reset()

    def reset(self) -> None:
        self._controller.reset()
        self._random = np.random.default_rng(self._seed)
        self.measured: list[NDArray[np.float64]] = []

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        self.measured.append(state + NOISE * self._random.standard_normal(10))
        return self._controller.update(t, self.measured[-1], reference)


def scaled(log: Log, factor: float, *names: str) -> Log:
    """Return the log with columns times a factor."""
    return log.with_columns({name: factor * log[name] for name in names})
