"""Logs of balancing for tests of the physics checks, and mistakes made in their columns."""

from functools import cache

import numpy as np

from ballbot import Model, Robot, simulate
from ballbot.arrays import Floats
from ballbot.control import references
from ballbot.control.presets import nominal_controller
from ballbot.log import STATE_NAMES, Log
from ballbot.robot.components import scaled_body
from tests.support.control_examples import FRICTION, Altered

#: of x y theta phi psi and their rates, as of an IMU and of encoders [m, rad, m/s, rad/s]
NOISE = np.array([1e-5, 1e-5, 1.7e-3, 1.7e-3, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3])


@cache
def balancing(name: str = "alten", *, seed: int = 1, mass: float = 1.0) -> tuple[Log, Robot]:
    """Return a log of 12 s around a square on a robot with friction, and the robot; `mass` scales the true body."""
    robot = Robot.load(name)
    true = robot.replace(friction=FRICTION, body=scaled_body(robot.body, mass=mass, height=1.0))
    random, measured = np.random.default_rng(seed), list[Floats]()

    def noisy(state: Floats) -> Floats:
        measured.append(state + NOISE * random.standard_normal(10))
        return measured[-1]

    feedback = Altered(nominal_controller(robot), state=noisy)
    log = simulate(Model(true), feedback, references.square(side=0.5, period=12.0), duration=12.0)
    columns = dict(zip(STATE_NAMES, np.array(measured[: len(log)]).T, strict=True))
    return log.without_truth().with_columns(columns), robot
