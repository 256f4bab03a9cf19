"""Logs of balancing for tests of the physics checks, and mistakes made in their columns."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ballbot import Controller, Model, Robot, simulate
from ballbot.control import references
from ballbot.control.presets import nominal_controller
from ballbot.log import STATE_NAMES, Log
from ballbot.robot import Friction
from ballbot.robot.components import scaled_body

#: about that of a real robot of the thesis's kind
FRICTION = Friction(
    viscous=(0.014, 0.016, 0.013),
    coulomb=(0.11, 0.09, 0.12),
    stribeck=(0.05, 0.04, 0.06),
    stribeck_speed=0.6,
    stribeck_exponent=1.1,
    rolling=0.007,
)
#: of x y theta phi psi and their rates, as of an IMU and of encoders [m, rad, m/s, rad/s]
NOISE = np.array([1e-5, 1e-5, 1.7e-3, 1.7e-3, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3])
TORQUES = ("u1", "u2", "u3")


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


def exchanged(log: Log, *pairs: tuple[str, str]) -> Log:
    """Return the log with pairs of columns exchanged."""
    return log.with_columns({a: log[b] for pair in pairs for a, b in (pair, pair[::-1])})


def scaled(log: Log, factor: float, *names: str) -> Log:
    """Return the log with columns times a factor."""
    return log.with_columns({name: factor * log[name] for name in names})


def delayed(log: Log, delay: float, *names: str) -> Log:
    """Return the log with columns that come later by a delay [s]."""
    return log.with_columns({name: np.interp(log.t - delay, log.t, log[name]) for name in names})


#: mistakes, the code that they must get, and words of the sentence
MISTAKES: dict[str, tuple[Callable[[Log], Log], str, str]] = {
    "theta and phi swapped": (
        lambda log: exchanged(log, ("theta", "phi"), ("theta_dot", "phi_dot")),
        "lean-axes",
        "theta and phi are swapped, with their rates",
    ),
    "only the angles swapped": (
        lambda log: exchanged(log, ("theta", "phi")),
        "lean-axes",
        "theta and phi are swapped.",
    ),
    "rates swapped": (
        lambda log: exchanged(log, ("theta_dot", "phi_dot")),
        "lean-axes",
        "theta_dot and phi_dot are swapped",
    ),
    "theta negated": (
        lambda log: scaled(log, -1.0, "theta", "theta_dot"),
        "lean-axes",
        "theta has the opposite sign, with its rate",
    ),
    "lean negated": (
        lambda log: scaled(log, -1.0, "theta", "theta_dot", "phi", "phi_dot"),
        "lean-axes",
        "theta and phi have the opposite sign, with their rates",
    ),
    "lean in degrees": (
        lambda log: scaled(log, 180.0 / np.pi, "theta", "phi", "theta_dot", "phi_dot"),
        "lean-scale",
        "theta and phi are in degrees",
    ),
    "wheels 20 % smaller": (
        lambda log: scaled(log, 1.25, "x", "y", "x_dot", "y_dot"),
        "lean-scale",
        "wheel radius, ball radius, gear ratio",
    ),
    "all torques negated": (
        lambda log: scaled(log, -1.0, *TORQUES),
        "torque-sign",
        "all torques have the opposite sign",
    ),
    "one torque negated": (lambda log: scaled(log, -1.0, "u2"), "torque-sign", "u2 has the opposite sign"),
    "two torques swapped": (
        lambda log: exchanged(log, ("u1", "u3")),
        "torque-order",
        "u1 and u3 are swapped",
    ),
    "torques in another order": (
        lambda log: log.with_columns({"u1": log["u2"], "u2": log["u3"], "u3": log["u1"]}),
        "torque-order",
        "u1 drives wheel 2, u2 drives wheel 3, u3 drives wheel 1",
    ),
    "torques twice": (
        lambda log: scaled(log, 2.0, *TORQUES),
        "torque-scale",
        "times as large as the motion of this robot needs",
    ),
    "torques halved": (
        lambda log: scaled(log, 0.5, *TORQUES),
        "torque-scale",
        "times as large as the motion of this robot needs",
    ),
    "random torques": (
        lambda log: log.with_columns(
            dict(zip(TORQUES, np.random.default_rng(0).standard_normal((3, len(log))), strict=True))
        ),
        "torque-unrelated",
        "u1, u2 and u3: the motion explains",
    ),
    "torques 80 ms late": (lambda log: delayed(log, 0.08, *TORQUES), "torque-delay", "80 ms too late"),
    "torques 50 ms early": (lambda log: delayed(log, -0.05, *TORQUES), "torque-delay", "50 ms too early"),
}
