"""The twin as an MJCF document, the format of MuJoCo's models.

    world
    |- floor
    |- ball                free joint
    `- body                free joint, its frame at the ball's centre
       `- wheel i          hinges "wheel i" (rotor; what the encoder sees) and "play i", on one axis
          `- roller i.k    hinge, turns freely

The rotor's reflected inertia j_r is the armature of "wheel i"; the wheel follows the rotor through "play i",
a hinge without spring whose stops are the gearbox's play. Without play that hinge is left out.

The ball meets the floor through a contact pair of its own, with pivoting and rolling friction, and the
rollers through ordinary contacts with sliding friction only: rollers that inherited the floor's pivoting
friction would hold the ball's heading and the robot would fall.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.derived import reflected_rotor_inertia
from ballbot.robot.robot import Robot
from ballbot.twin.parts import BodyParts, WheelParts, body_parts, wheel_frames, wheel_parts
from ballbot.twin.scenario import Scenario

# MuJoCo's impedance d: dry friction gives way like a damper below a speed that grows with (1 - d)/d. Its
# default of 0.9 to 0.95 lets a slowly rolling ball coast on as if in oil; this lets it stop.
_HARD = "0.999 0.999 0.001"


def twin_mjcf(robot: Robot, scenario: Scenario) -> str:
    """Return the MJCF document (XML) of a robot in a scenario.

    Friction that depends on speed is not in it: `ballbot.twin.driveline` sets that at each step, so in
    MuJoCo's own viewer the drivelines have their friction at rest.

    Raises
    ------
    InputError
        Where the scenario does not fit the robot, or the robot's wheels do not fit its body.
    """
    scenario.check(robot)
    wheel = wheel_parts(robot, scenario.rollers)
    root = ET.Element("mujoco", model=f"{robot.name} {scenario.name}")
    _options(root, robot, scenario)
    world = ET.SubElement(root, "worldbody")
    _floor_and_ball(world, robot)
    body = _body(world, robot, body_parts(robot, wheel))
    for i, frame in enumerate(wheel_frames(robot)):
        _wheel(body, i, frame, robot, scenario, wheel)
    _floor_contact(root, robot, scenario)
    actuators = ET.SubElement(root, "actuator")
    for i in range(robot.wheel_count):
        ET.SubElement(actuators, "motor", name=f"wheel {i + 1}", joint=f"wheel {i + 1}")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _options(root: ET.Element, robot: Robot, scenario: Scenario) -> None:
    ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    option = ET.SubElement(
        root,
        "option",
        timestep=_text(scenario.timestep),
        gravity=_text((0.0, 0.0, -robot.gravity)),
        integrator="implicitfast",
        cone="elliptic",
        impratio="10",
        # twice as fast as "dense" here; MuJoCo 4.0.0 factors some sparse Hessians wrongly (its issue 3767,
        # mended in 4.0.1), which tests/test_twin_physics.py shows not to touch this robot
        jacobian="sparse",
    )
    # else a state that is no longer finite becomes the upright one, without a word
    ET.SubElement(option, "flag", autoreset="disable")
    default = ET.SubElement(root, "default")
    ET.SubElement(default, "joint", solimpfriction=_HARD, solreffriction="0.002 1", solreflimit="0.002 1")
    ET.SubElement(default, "geom", contype="0", conaffinity="0")


def _floor_and_ball(world: ET.Element, robot: Robot) -> None:
    ball = robot.ball
    ET.SubElement(world, "light", pos="0 0 3", dir="0 0 -1")
    ET.SubElement(world, "geom", name="floor", type="plane", size="5 5 0.1", rgba="0.85 0.85 0.85 1")
    element = ET.SubElement(world, "body", name="ball", pos=_text((0.0, 0.0, ball.radius)))
    ET.SubElement(element, "freejoint", name="ball")
    inertia = _text((ball.inertia,) * 3)
    ET.SubElement(element, "inertial", pos="0 0 0", mass=_text(ball.mass), diaginertia=inertia)
    # bit 1: the rollers have it in their conaffinity, nothing else has
    ET.SubElement(
        element,
        "geom",
        name="ball",
        type="sphere",
        size=_text(ball.radius),
        contype="1",
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
        friction=_text((grip, grip, scenario.pivoting, rolling, rolling)),
        solref=_text((scenario.contact_time, 1.0)),
        solimp=_HARD,
    )


def _body(world: ET.Element, robot: Robot, parts: BodyParts) -> ET.Element:
    element = ET.SubElement(world, "body", name="body", pos=_text((0.0, 0.0, robot.ball.radius)))
    ET.SubElement(element, "freejoint", name="body")
    J = parts.inertia
    ET.SubElement(
        element,
        "inertial",
        pos=_text(parts.center_of_mass),
        mass=_text(parts.mass),
        fullinertia=_text((J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])),
    )
    low = robot.ball.radius + 2 * robot.wheels.radius
    high = max(2 * robot.body.center_of_mass, low + 0.05)
    ET.SubElement(
        element,
        "geom",
        name="body",
        type="cylinder",
        size=_text((robot.ball.radius,)),
        fromto=_text((0.0, 0.0, low, 0.0, 0.0, high)),
        rgba="0.6 0.6 0.6 0.5",
    )
    return element


def _wheel(
    body: ET.Element,
    index: int,
    frame: NDArray[np.float64],
    robot: Robot,
    scenario: Scenario,
    parts: WheelParts,
) -> None:
    name = f"wheel {index + 1}"
    friction, drive = scenario.friction, robot.drive
    rotor = reflected_rotor_inertia(
        gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )
    element = ET.SubElement(
        body,
        "body",
        name=name,
        pos=_text(-parts.center_distance * frame[:, 0]),
        xyaxes=_text((*frame[:, 0], *frame[:, 1])),
    )
    ET.SubElement(
        element,
        "joint",
        name=name,
        axis="0 0 1",
        armature=_text(rotor),
        damping=_text(friction.viscous[index]),
        frictionloss=_text(friction.coulomb[index] + friction.stribeck[index]),
    )
    if scenario.backlash > 0:
        half = scenario.backlash / 2
        ET.SubElement(
            element,
            "joint",
            name=f"play {index + 1}",
            axis="0 0 1",
            limited="true",
            range=_text((-half, half)),
        )
    ET.SubElement(
        element, "inertial", pos="0 0 0", mass=_text(parts.hub_mass), diaginertia=_text(parts.hub_inertia)
    )
    size = (robot.wheels.radius - 2 * scenario.rollers.radius, scenario.rollers.radius)
    ET.SubElement(element, "geom", type="cylinder", size=_text(size), rgba="0.7 0.7 0.7 1")
    for k, (center, angle) in enumerate(zip(parts.roller_centers, parts.roller_angles, strict=True)):
        _roller(element, f"roller {index + 1}.{k + 1}", center, float(angle), scenario, parts)


def _roller(
    wheel: ET.Element,
    name: str,
    center: NDArray[np.float64],
    angle: float,
    scenario: Scenario,
    parts: WheelParts,
) -> None:
    turn = (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2))
    element = ET.SubElement(wheel, "body", name=name, pos=_text(center), quat=_text(turn))
    ET.SubElement(element, "joint", name=name, axis="0 1 0")
    inertia = _text(parts.roller_inertia)
    ET.SubElement(element, "inertial", pos="0 0 0", mass=_text(parts.roller_mass), diaginertia=inertia)
    ET.SubElement(
        element,
        "geom",
        type="ellipsoid",
        size=_text((scenario.rollers.radius, parts.roller_half_length, scenario.rollers.radius)),
        conaffinity="1",
        condim="3",
        friction=_text((scenario.roller_grip, 0.0, 0.0)),
        priority="1",  # the rollers' grip and softness, not the ball's
        solref=_text((scenario.contact_time, 1.0)),
        rgba="0.1 0.1 0.1 1",
    )


def _text(values: float | Iterable[float]) -> str:
    """Return numbers so that reading them gives the same bits."""
    if isinstance(values, float | int):
        return repr(float(values))
    return " ".join(repr(float(value)) for value in values)
