"""The robot with the geometry that its logs gave, and how well each value is known."""

from __future__ import annotations

import math
from dataclasses import replace

from ballbot.identification.geometry.survey import Geometry, Measured, common_turn
from ballbot.robot import Robot
from ballbot.robot.parameters import Value


def robot_with_geometry(robot: Robot, geometry: Geometry) -> Robot:
    """Return the robot with the radii, tilt and azimuths found, where the logs gave them.

    Azimuths are upside down's where there are both, less the turn that all have in common, which is a camera's heading.
    A standard deviation is that of noise and of slip together.

    Raises
    ------
    InputError
        Where that is no robot, as when another radius does not go with the ball's inertia.
    """
    found = {one.name: one for one in reversed(geometry.measured)}  # the first of a name counts
    ball, wheels = robot.ball, robot.wheels
    sources, deviations = dict(robot.sources), dict(robot.standard_deviations)
    kept: list[tuple[str, list[Measured]]] = []
    if "ball.radius" in found:
        ball = replace(ball, radius=found["ball.radius"].value)
        wheels = replace(wheels, radius=found["wheels.radius"].value)
        kept += [(name, [found[name]]) for name in ("ball.radius", "wheels.radius")]
    if "wheels.tilt" in found:
        wheels = replace(wheels, tilt=found["wheels.tilt"].value)
        kept.append(("wheels.tilt", [found["wheels.tilt"]]))
    azimuths = [found[f"wheels.azimuths[{i}]"] for i in range(robot.wheel_count)]
    turn = common_turn(azimuths)
    wheels = replace(wheels, azimuths=tuple(one.value - turn for one in azimuths))
    kept.append(("wheels.azimuths", azimuths))
    for name, numbers in kept:
        deviation: Value = tuple(math.hypot(one.standard_error, one.slip) for one in numbers)
        deviations[name] = deviation if name == "wheels.azimuths" else deviation[0]
        sources[name] = f"identified: geometry from logs ({numbers[0].kind})"
    return robot.replace(ball=ball, wheels=wheels, sources=sources, standard_deviations=deviations)
