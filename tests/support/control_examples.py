"""Robots and controllers that several tests use."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ballbot import Controller, Robot
from ballbot.arrays import Floats
from ballbot.control.parts import Parts
from ballbot.control.parts.disturbance_observer import DisturbanceObserver
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.integral import IntegralAction
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.parts.notch import Notch
from ballbot.control.parts.planner import Planner
from ballbot.control.parts.policy import SCALES, Policy, observation_size
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.presets import precise_controller
from ballbot.robot import Friction
from ballbot.twin import Scenario

Change = Callable[[Floats], Floats]
#: the nominal scenario's
FRICTION = Scenario.nominal(Robot.load("alten")).friction


def alten(friction: Friction | None = None) -> Robot:
    """Return the thesis's robot, without friction if none is given."""
    return Robot.load("alten").replace(friction=friction or Friction.none(3))


def four_wheeled(*, friction: bool) -> Robot:
    """Return the thesis's robot on four wheels that are not evenly spread."""
    robot = Robot.load("alten")
    four = Friction(
        viscous=(0.014, 0.016, 0.013, 0.015),
        coulomb=(0.11, 0.09, 0.12, 0.1),
        stribeck=(0.05, 0.04, 0.06, 0.05),
        stribeck_speed=0.6,
        stribeck_exponent=1.1,
        rolling=0.007,
    )
    wheels = replace(robot.wheels, azimuths=(0.1, 1.5, 3.2, 4.9))
    return robot.replace(wheels=wheels, friction=four if friction else Friction.none(4))


def leaning(theta: float, phi: float = 0.0) -> Floats:
    """Return a state (10,) at rest with that lean [rad]."""
    state = np.zeros(10)
    state[2:4] = theta, phi
    return state


def example_parts(wheel_count: int) -> Parts:
    """Return every part, at settings that all differ from the defaults."""
    return Parts(
        planner=Planner(
            torque_limit=1.5,
            speed_limit=1.0,
            speed_cap=0.9,
            prompt_speed=0.15,
            yaw_frequency=2.5,
            yaw_rate_limit=0.8,
            yaw_acceleration_limit=1.5,
            yaw_prompt_rate=0.3,
        ),
        feed_forward=FeedForward(),
        integral=IntegralAction(
            gain=np.tile((0.5, 0.3, 0.2), (wheel_count, 1)),
            limit=0.2,
            yaw_limit=0.4,
            memory=40.0,
            dead_band=0.001,
        ),
        disturbance_observer=DisturbanceObserver(frequency=3.0, limit=0.4),
        lean_limit=LeanLimit(lean=0.3, turn=2.0),
        notch=Notch(frequency=33.0, width=0.5, depth=0.2),
        prediction=DelayPrediction(delay=0.012),
    )


def everything(robot: Robot) -> Controller:
    """Return a controller with every part, at settings that all differ from the defaults."""
    precise, parts = precise_controller(robot, compensation="partial"), example_parts(robot.wheel_count)
    own, integral = precise.parts.integral, parts.integral
    assert own is not None
    assert integral is not None
    # the example's gain does not stabilise a robot
    return precise.with_parts(replace(parts, integral=replace(integral, gain=own.gain)))


def with_policy(controller: Controller, *, feedback: float = 0.0, units: int = 64) -> Controller:
    """Return a controller with a policy of random weights, as large as those of a trained one."""
    random, wheels = np.random.default_rng(7), len(controller.gain)
    shapes = {"first": (units, observation_size(wheels)), "second": (units, units), "last": (wheels, units)}
    layers = {
        name: np.hstack([random.normal(0.0, 1.2 / np.sqrt(n), (m, n)), random.normal(0.0, 0.1, (m, 1))])
        for name, (m, n) in shapes.items()
    }
    policy = Policy(
        feedback=feedback,
        torque_scale=0.4 * controller.torque_limit,
        torque_limit=0.5 * controller.torque_limit,
        period=2.0 * controller.sample_time,
        largest_lean=0.2,
        largest_speed=1.0,
        **layers,
    )
    return controller.with_parts(replace(controller.parts, policy=policy))


def linear_policy(controller: Controller) -> Controller:
    """Return a controller whose policy does as its feedback; its units are driven too little to bend."""
    small, wheels = 0.05, len(controller.gain)
    first = np.pad(small * np.eye(10), ((0, 0), (0, observation_size(wheels) - 9)))
    second = np.pad(np.eye(10), ((0, 0), (0, 1)))
    last = np.pad(controller.gain * np.array(SCALES) / (small * controller.torque_limit), ((0, 0), (0, 1)))
    policy = Policy(
        feedback=0.0,
        torque_scale=controller.torque_limit,
        torque_limit=controller.torque_limit,
        period=controller.sample_time,
        largest_lean=0.3,
        largest_speed=1.0,
        first=first,
        second=second,
        last=last,
    )
    return controller.with_parts(replace(controller.parts, policy=policy))


class Altered:
    """A controller that is given other states, or whose torques are changed on their way."""

    def __init__(
        self, controller: Controller, *, state: Change = lambda x: x, torques: Change = lambda u: u
    ) -> None:
        self.controller, self.sample_time = controller, controller.sample_time
        self._state, self._torques = state, torques

    def reset(self) -> None:
        self.controller.reset()

    def update(self, t: float, state: Floats, reference: Floats) -> Floats:
        return self._torques(self.controller.update(t, self._state(state), reference))
