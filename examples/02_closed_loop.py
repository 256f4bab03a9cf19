"""Simulate a controller on the exact model: the effect of friction, and of compensating it.

python examples/02_closed_loop.py
"""

from dataclasses import replace

import ballbot
from ballbot.control.presets import design_gain
from ballbot.control.references import square
from ballbot.workflows.metrics import score

robot = ballbot.Robot.load("alten")
friction = replace(
    robot.friction,
    viscous=(0.014, 0.016, 0.013),
    coulomb=(0.11, 0.09, 0.12),
    stribeck=(0.05, 0.04, 0.06),
    stribeck_speed=0.6,
    stribeck_exponent=1.1,
    rolling=0.007,
)
robot = robot.replace(friction=friction)
gain = design_gain(robot).gain

for compensation in ("none", "full", "partial"):
    controller = ballbot.Controller(robot, gain, compensation=compensation)
    log = ballbot.simulate(ballbot.Model(robot), controller, square(side=0.5, period=32.0), duration=32.0)
    peak = score(log).peak_position_error
    print(f"{compensation:8} compensation: at most {peak:.3f} m from the reference once settled")
