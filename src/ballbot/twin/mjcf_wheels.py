"""The wheels of the MJCF document: rotor, play or spring, hub and rollers.

The rotor's reflected inertia j_r is the armature of "wheel i"; the wheel follows the rotor through "play i",
a hinge without spring whose stops are the gearbox's play. A driveline that twists has a spring in place of the
stops: a tendon that is slack within the play. Without either that hinge is left out.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.robot import Robot
from ballbot.twin.compliance import driveline_spring, rotor_inertia
from ballbot.twin.numbers import text
from ballbot.twin.parts import WheelParts
from ballbot.twin.scenario import Scenario


def add_wheel(
    body: ET.Element,
    index: int,
    frame: NDArray[np.float64],
    robot: Robot,
    scenario: Scenario,
    parts: WheelParts,
) -> None:
    """Add a wheel to the body: its index from 0 on, its frame (3, 3) and its parts."""
    name = f"wheel {index + 1}"
    element = ET.SubElement(
        body,
        "body",
        name=name,
        pos=text(-parts.center_distance * frame[:, 0]),
        xyaxes=text((*frame[:, 0], *frame[:, 1])),
    )
    joint = ET.SubElement(element, "joint", name=name, axis="0 0 1", armature=text(rotor_inertia(robot)))
    if not scenario.driveline_laws:
        friction = scenario.friction
        joint.set("damping", text(friction.viscous[index]))
        joint.set("frictionloss", text(friction.coulomb[index] + friction.stribeck[index]))
    if scenario.backlash > 0 or scenario.compliance:
        play = ET.SubElement(element, "joint", name=f"play {index + 1}", axis="0 0 1")
        if not scenario.compliance:
            half = scenario.backlash / 2
            play.set("limited", "true")
            play.set("range", text((-half, half)))
    ET.SubElement(
        element, "inertial", pos="0 0 0", mass=text(parts.hub_mass), diaginertia=text(parts.hub_inertia)
    )
    size = (robot.wheels.radius - 2 * scenario.rollers.radius, scenario.rollers.radius)
    ET.SubElement(element, "geom", type="cylinder", size=text(size), rgba="0.7 0.7 0.7 1")
    for k, (center, angle) in enumerate(zip(parts.roller_centers, parts.roller_angles, strict=True)):
        _roller(element, f"roller {index + 1}.{k + 1}", center, float(angle), scenario, parts)


def add_shafts(root: ET.Element, robot: Robot, scenario: Scenario) -> None:
    """Add the springs of drivelines that twist."""
    if not scenario.compliance:
        return
    spring = driveline_spring(robot, scenario.compliance)
    half = scenario.backlash / 2
    tendons = ET.SubElement(root, "tendon")
    for i in range(robot.wheel_count):
        shaft = ET.SubElement(
            tendons,
            "fixed",
            name=f"shaft {i + 1}",
            stiffness=text(spring.stiffness),
            damping=text(spring.damping),
            springlength=text((-half, half)),
        )
        ET.SubElement(shaft, "joint", joint=f"play {i + 1}", coef="1")


def _roller(
    wheel: ET.Element,
    name: str,
    center: NDArray[np.float64],
    angle: float,
    scenario: Scenario,
    parts: WheelParts,
) -> None:
    turn = (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2))
    element = ET.SubElement(wheel, "body", name=name, pos=text(center), quat=text(turn))
    ET.SubElement(element, "joint", name=name, axis="0 1 0")
    inertia = text(parts.roller_inertia)
    ET.SubElement(element, "inertial", pos="0 0 0", mass=text(parts.roller_mass), diaginertia=inertia)
    ET.SubElement(
        element,
        "geom",
        name=name,
        type="ellipsoid" if scenario.wheel_contact == "rollers" else "sphere",
        size=text((scenario.rollers.radius, parts.roller_half_length, scenario.rollers.radius)),
        conaffinity="1",
        condim="3",
        friction=text((scenario.roller_grip, 0.0, 0.0)),
        priority="1",  # the rollers' grip and softness, not the ball's
        solref=text((scenario.contact_time, 1.0)),
        rgba="0.1 0.1 0.1 1",
    )
