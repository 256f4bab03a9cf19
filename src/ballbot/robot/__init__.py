"""The robot's parameters, with units and where each came from."""

from ballbot.robot.components import Ball, Body, Drive, Friction, Rollers, Sensors, Wheels
from ballbot.robot.robot import Robot, RobotLike, as_robot

__all__ = [
    "Ball", "Body", "Drive", "Friction", "Robot", "RobotLike", "Rollers", "Sensors", "Wheels", "as_robot",
]  # fmt: skip
