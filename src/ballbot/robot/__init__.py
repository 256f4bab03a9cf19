"""The robot's parameters, with units and where each came from."""

from ballbot.robot.components import Ball, Body, Drive, Friction, Rollers, Sensors, Wheels
from ballbot.robot.robot import Robot

__all__ = ["Ball", "Body", "Drive", "Friction", "Robot", "Rollers", "Sensors", "Wheels"]
