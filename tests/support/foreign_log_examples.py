"""Logs as other people's robots write them, made from a simulated run whose truth is known."""

from functools import cache
from pathlib import Path

import numpy as np

from ballbot import Log, Model, simulate
from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.robot import Friction, Robot
from tests.support.control_examples import Altered
from tests.support.foreign_logs import POLLED, Habits, columns_of, write

SENSOR_DELAY = 0.0175  #: [s]


@cache
def small_robot() -> Robot:
    """Return the course's robot with about the friction that its logs show: light, and busy at some hertz."""
    friction = Friction(
        viscous=(0.02, 0.02, 0.02),
        coulomb=(0.1, 0.12, 0.1),
        stribeck=(0.0, 0.0, 0.0),
        stribeck_speed=1.0,
        stribeck_exponent=1.0,
        rolling=0.01,
    )
    return Robot.load("rob311").replace(friction=friction)


@cache
def swaying_log() -> Log:
    """Return a run of the small robot that sways in all directions and turns its heading to and fro."""

    def reference(t: float) -> np.ndarray:
        r = np.zeros(10)
        r[0], r[1] = 0.25 * np.sin(1.3 * t), 0.25 * np.sin(1.9 * t + 1.0)
        r[4] = 0.6 * np.sin(1.1 * t)
        return r

    # noise on the torques [N m], without which no log separates a command's delay from the lean's; its mean is a push
    # along the way or of the heading
    robot, random = small_robot(), np.random.default_rng(7)
    gain = design_gain(robot, torque_weight=30.0).gain
    dithered = Altered(Controller(robot, gain), torques=lambda u: u + 0.15 * random.standard_normal(3))
    return simulate(Model(robot), dithered, reference, duration=30.0)


#: as the course's robot logs: a host polls the latest of messages of 5 ms
COURSE = Habits(
    start=0.5,
    duration=29.0,
    layout="blanks",
    lean_unit="deg",
    command="duty",
    sensor_delay=SENSOR_DELAY,
    command_delay=0.010,
    noise=5e-4,
    interval=POLLED,
    messages=0.005,
)


def foreign_columns(habits: Habits = COURSE) -> dict[str, np.ndarray]:
    """Return the columns in which a team of these habits logs the swaying robot."""
    log = swaying_log()
    # the dither of two control periods in one: by itself it changes faster than a host's rows show
    u = 0.5 * (log.torques + np.roll(log.torques, -1, axis=0))
    log = log.with_columns(dict(zip(("u1", "u2", "u3"), u.T, strict=True)))
    return columns_of(log, habits, small_robot(), dead_band=0.0)


def write_foreign(path: Path, columns: dict[str, np.ndarray], habits: Habits = COURSE) -> Path:
    """Write columns as a text of these habits."""
    return write(path, columns, habits)[0]
