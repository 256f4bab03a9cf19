"""A friction law that is registered by a test: rational in place of exponential, with a quadratic and a load term."""

import numpy as np

from ballbot import LawParameter, Robot, register_friction_law
from ballbot.robot import Friction


def toothed(speed, load, coulomb, stribeck, stribeck_speed, quadratic, teeth):
    """Return c + s/(1 + (w/v_s)^2) + b_2 w^2 + m |u|."""
    return coulomb + stribeck / (1.0 + (speed / stribeck_speed) ** 2) + quadratic * speed**2 + teeth * load


QUADRATIC = LawParameter(
    name="quadratic",
    symbol="b_2",
    meaning="torque for each (rad/s)^2",
    unit="N m s^2/rad^2",
    usual=(0.0, 0.02),
    default=0.0,
)
TEETH = LawParameter(
    name="teeth",
    symbol="m",
    meaning="dry friction for each N m of the motor's torque",
    usual=(0.0, 0.5),
    default=0.0,
    each_wheel=False,
    proportional=True,
)
LAW = register_friction_law(
    toothed, parameters=(QUADRATIC, TEETH), formula="c + s/(1 + (w/v_s)^2) + b_2 w^2 + m |u|"
)
FRICTION = Friction(
    viscous=(0.014, 0.016, 0.013),
    coulomb=(0.11, 0.09, 0.12),
    stribeck=(0.05, 0.04, 0.06),
    stribeck_speed=0.6,
    stribeck_exponent=1.0,
    rolling=0.007,
    law="toothed",
    own=(("quadratic", (0.004, 0.006, 0.005)), ("teeth", 0.1)),
)


def robot_by_law() -> Robot:
    """Return the thesis's robot with the friction of the law."""
    return Robot.load("alten").replace(friction=FRICTION)


def dry(speed, load):
    """Return the dry friction (..., 3) by the formula, written anew."""
    c, s, b_2 = np.array(FRICTION.coulomb), np.array(FRICTION.stribeck), np.array([0.004, 0.006, 0.005])
    w = np.abs(np.asarray(speed))
    return c + s * 0.36 / (0.36 + w * w) + b_2 * w * w + 0.1 * np.abs(load)
