"""Validation: a robot's model against its logs, in closed loop, in open loop and by one-step prediction.

Examples
--------
A robot whose friction is known, and a log of it with the noise of its sensors:

>>> from ballbot import Model, Robot, simulate
>>> from ballbot.robot import Friction
>>> from ballbot.simulation.imperfections import Imperfections
>>> from ballbot.simulation.sensed_plant import SensedPlant
>>> alike = dict(viscous=(0.01,) * 3, coulomb=(0.1,) * 3, stribeck=(0.05,) * 3)
>>> friction = Friction(**alike, stribeck_speed=0.6, stribeck_exponent=1.1, rolling=0.007)
>>> robot = Robot.load("alten").replace(friction=friction)
>>> plant = SensedPlant(Model(robot), Imperfections(sensors=robot.sensors))
>>> log = simulate(plant, "nominal", "square", duration=16.0, seed=1).without_truth()

Its model with friction predicts the log better than without friction, by these ratios of the errors:

>>> validation = validate(robot, log)
>>> bool(validation.open_loop.errors.ratio.min() > 2.0)
True
>>> set(validation.open_loop.errors.verdicts())
{'better'}
>>> [finding.code for finding in findings(validation)][:3]
['adequacy', 'open-loop', 'closed-loop']

The gain of the controller that recorded the log, and two models of choice on a part of the log:

>>> recovered = recover_gain(log)
>>> recovered.delay, bool(recovered.r_squared.min() > 0.99)
(0, True)
>>> models = ModelPair.by_friction(Model(robot))
>>> part = validate_pair(models, log, holdout=[(8.0, 16.0)])
>>> round(part.duration, 2)
8.0
"""

from ballbot.validation.closed_loop import RecoveredGain, recover_gain
from ballbot.validation.models import ErrorPair, ModelPair, NamedModel
from ballbot.validation.result import Validation, findings
from ballbot.validation.validation import join_validations, validate, validate_logs, validate_pair

__all__ = [
    "ErrorPair",
    "ModelPair",
    "NamedModel",
    "RecoveredGain",
    "Validation",
    "findings",
    "join_validations",
    "recover_gain",
    "validate",
    "validate_logs",
    "validate_pair",
]
