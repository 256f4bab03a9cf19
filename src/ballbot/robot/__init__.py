"""The robot's parameters, with units and where each came from."""

from ballbot.robot.robot import Ball, Body, Drive, Friction, Robot, Rollers, Sensors, Wheels

__all__ = ["Ball", "Body", "Drive", "Friction", "Robot", "Rollers", "Sensors", "Wheels"]
