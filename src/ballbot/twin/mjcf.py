"""The twin as an MJCF document, the format of MuJoCo's models.

    world
    |- floor
    |- ball                free joint
    `- body                free joint, its frame at the ball's centre
       |- payload
       `- wheel i          hinges "wheel i" (rotor; what the encoder sees) and "play i", on one axis
          `- roller i.k    hinge, turns freely

The ball meets the floor through a contact pair of its own, with pivoting and rolling friction, and the
rollers through ordinary contacts with sliding friction only: rollers that inherited the floor's pivoting
friction would hold the ball's heading and the robot would fall. The wheels are `ballbot.twin.mjcf_wheels`'s.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.robot import Robot
from ballbot.twin.faults import Payload
from ballbot.twin.mjcf_wheels import add_shafts, add_wheel
from ballbot.twin.numbers import text
from ballbot.twin.parts import BodyParts, point_wheel_parts, split_robot, wheel_frames, wheel_parts
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_checks import check_scenario
from ballbot.twin.softness import add_soft_contacts

#: balancing; the body held, wheels in the air, no ball; the body held upside down, the ball on its wheels
Mounting = Literal["floor", "stand", "upside_down"]

# MuJoCo's impedance d: dry friction gives way like a damper below a speed that grows with (1 - d)/d. Its
# default of 0.9 to 0.95 lets a slowly rolling ball coast on as if in oil; this lets it stop.
_HARD = "0.999 0.999 0.001"

_ALUMINIUM = 2700.0  # [kg/m^3]


def twin_mjcf(robot: Robot, scenario: Scenario, *, mounting: Mounting = "floor") -> str:
    """Return the MJCF document (XML) of a robot in a scenario.

    Friction that depends on speed is not in it: `ballbot.twin.driveline` sets that at each step, so in
    MuJoCo's own viewer the drivelines have their friction at rest. Motors, supply, pushes, bumps and timing
    are not in it either.

    Parameters
    ----------
    robot : Robot
    scenario : Scenario
    mounting : {"floor", "stand", "upside_down"}
        Upside down, the world's frame is the body's: z points down, and so does gravity along it.

    Raises
    ------
    InputError
        Where the scenario does not fit the robot, or the robot's wheels do not fit its body.
    """
    check_scenario(scenario, robot)
    root = _document(robot, scenario, mounting)
    if scenario.softness and mounting != "stand":
        hard = _document(robot, replace(scenario, softness=None), mounting)
        add_soft_contacts(root, scenario, ET.tostring(hard, encoding="unicode"))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def floor_normal(scenario: Scenario) -> NDArray[np.float64]:
    """Return the unit normal (3,) of the floor, R_x(tilt_x) R_y(tilt_y) e_z, in the world's frame."""
    about_x, about_y = scenario.floor_tilt
    cx, sx, cy, sy = math.cos(about_x), math.sin(about_x), math.cos(about_y), math.sin(about_y)
    return np.array([sy, -sx * cy, cx * cy])


def _document(robot: Robot, scenario: Scenario, mounting: Mounting) -> ET.Element:
    point = scenario.wheel_contact == "point"
    wheel, rest = split_robot(robot, scenario.rollers, wheel_of=point_wheel_parts if point else wheel_parts)
    root = ET.Element("mujoco", model=f"{robot.name} {scenario.name}")
    _options(root, robot, scenario, mounting)
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "light", pos="0 0 3", dir="0 0 -1")
    if mounting == "floor":
        _floor(world, scenario)
    if mounting != "stand":
        _ball(world, robot, scenario, mounting)
    body = _body(world, robot, rest, mounting)
    if scenario.payload:
        _payload(body, scenario.payload)
    for i, frame in enumerate(wheel_frames(robot)):
        add_wheel(body, i, frame, robot, scenario, wheel)
    if mounting == "floor":
        _floor_contact(root, robot, scenario)
    add_shafts(root, robot, scenario)
    actuators = ET.SubElement(root, "actuator")
    for i in range(robot.wheel_count):
        ET.SubElement(actuators, "motor", name=f"wheel {i + 1}", joint=f"wheel {i + 1}")
    return root


def _options(root: ET.Element, robot: Robot, scenario: Scenario, mounting: Mounting) -> None:
    ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    down = 1.0 if mounting == "upside_down" else -1.0
    option = ET.SubElement(
        root,
        "option",
        timestep=text(scenario.timestep),
        gravity=text((0.0, 0.0, down * robot.gravity)),
        integrator="implicitfast",
        cone="elliptic",
        impratio="10",
        # twice as fast as "dense" here; MuJoCo 4.0.0 factors some sparse Hessians wrongly (its issue 3767,
        # mended in 4.0.1), which tests/test_twin_physics.py shows not to touch this robot
        jacobian="sparse",
    )
    # without "autoreset" off, a state that is no longer finite becomes the upright one, without a word; the
    # midphase sorts the geoms within a body, of which every body here has one, and takes a sixth of the step
    ET.SubElement(option, "flag", autoreset="disable", midphase="disable")
    default = ET.SubElement(root, "default")
    ET.SubElement(default, "joint", solimpfriction=_HARD, solreffriction="0.002 1", solreflimit="0.002 1")
    ET.SubElement(default, "geom", contype="0", conaffinity="0")


def _floor(world: ET.Element, scenario: Scenario) -> None:
    floor = ET.SubElement(world, "geom", name="floor", type="plane", size="5 5 0.1", rgba="0.85 0.85 0.85 1")
    if any(scenario.floor_tilt):
        floor.set("zaxis", text(floor_normal(scenario)))


def _ball(world: ET.Element, robot: Robot, scenario: Scenario, mounting: Mounting) -> None:
    ball = robot.ball
    height = ball.radius / floor_normal(scenario)[2] if mounting == "floor" else 0.0
    element = ET.SubElement(world, "body", name="ball", pos=text((0.0, 0.0, height)))
    ET.SubElement(element, "freejoint", name="ball")
    inertia = text((ball.inertia,) * 3)
    ET.SubElement(element, "inertial", pos="0 0 0", mass=text(ball.mass), diaginertia=inertia)
    # bit 1: the rollers have it in their conaffinity, nothing else has
    ET.SubElement(
        element,
        "geom",
        name="ball",
        type="sphere",
        size=text(ball.radius),
        contype="0" if scenario.softness else "1",
        rgba="0.2 0.3 0.7 1",
    )


def _floor_contact(root: ET.Element, robot: Robot, scenario: Scenario) -> None:
    rolling = scenario.friction.rolling * robot.ball.radius  # a force N C_rr at r_b is a moment N C_rr r_b
    grip = scenario.floor_grip
    pairs = ET.SubElement(root, "contact")
    ET.SubElement(
        pairs,
        "pair",
        geom1="ball",
        geom2="floor",
        condim="6" if rolling > 0 else "4",
        friction=text((grip, grip, scenario.pivoting, rolling, rolling)),
        solref=text((scenario.contact_time, 1.0)),
        solimp=_HARD,
    )


def _body(world: ET.Element, robot: Robot, parts: BodyParts, mounting: Mounting) -> ET.Element:
    held = mounting != "floor"
    height = 0.0 if held else robot.ball.radius
    element = ET.SubElement(world, "body", name="body", pos=text((0.0, 0.0, height)))
    if not held:
        ET.SubElement(element, "freejoint", name="body")
    J = parts.inertia
    ET.SubElement(
        element,
        "inertial",
        pos=text(parts.center_of_mass),
        mass=text(parts.mass),
        fullinertia=text((J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])),
    )
    low = robot.ball.radius + 2 * robot.wheels.radius
    high = max(2 * robot.body.center_of_mass, low + 0.05)
    ET.SubElement(
        element,
        "geom",
        name="body",
        type="cylinder",
        size=text((robot.ball.radius,)),
        fromto=text((0.0, 0.0, low, 0.0, 0.0, high)),
        rgba="0.6 0.6 0.6 0.5",
    )
    return element


def _payload(body: ET.Element, payload: Payload) -> None:
    radius = (3 * payload.mass / (4 * math.pi * _ALUMINIUM)) ** (1 / 3)
    element = ET.SubElement(body, "body", name="payload", pos=text(payload.position))
    inertia = text((0.4 * payload.mass * radius**2,) * 3)
    ET.SubElement(element, "inertial", pos="0 0 0", mass=text(payload.mass), diaginertia=inertia)
    ET.SubElement(element, "geom", type="sphere", size=text(radius), rgba="0.8 0.5 0.2 1")
