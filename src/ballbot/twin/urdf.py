"""A robot as URDF, the format of ROS's models.

    world
    |- ball               floating joint
    `- base_link          floating joint, its origin at the ball's centre
       `- wheel1 ..       continuous joints; z along the hinge, as in `ballbot.twin.mjcf`
          `- roller1_1 .. continuous joints, turn freely

The parts are those of the twin (`ballbot.twin.parts`). URDF has no ellipsoid: a roller is a cylinder of its radius, as
long as fits between its neighbours without touching them, so that the wheel's outline has corners. Nor has URDF the
reflected inertia of a rotor, or friction that depends on speed.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from ballbot.robot import Robot
from ballbot.twin.mjcf import number_text
from ballbot.twin.parts import WheelParts, split_robot, wheel_frames, wheel_parts

#: of the length at which rollers touch
_CLEAR = 0.98


def robot_urdf(robot: Robot) -> ET.Element:
    """Return the root element of a robot's URDF.

    Raises
    ------
    InputError
        If the robot's wheels do not fit its body.
    """
    rollers, ball = robot.wheels.rollers, robot.ball
    wheel, rest = split_robot(robot, rollers, wheel_of=wheel_parts)
    # its inner edge stays within the roller's part of a turn
    half = (
        _CLEAR
        * (robot.wheels.radius - 2.0 * rollers.radius)
        * math.tan(math.pi / (rollers.per_row * rollers.rows))
    )
    corner = math.hypot(robot.wheels.radius, half) - robot.wheels.radius
    root = ET.Element("robot", name=robot.name)
    root.append(ET.Comment(_ABOUT.format(corner=1e3 * corner)))
    ET.SubElement(root, "link", name="world")
    height = np.array([0.0, 0.0, ball.radius])
    _joint(root, "base_link", "world", kind="floating", place=height)
    body = _link(root, "base_link", rest.mass, rest.inertia, rest.center_of_mass)
    low = ball.radius + 2.0 * robot.wheels.radius
    length = max(2.0 * robot.body.center_of_mass - low, 0.05)
    _shape(body, "visual", ball.radius, length, place=np.array([0.0, 0.0, low + length / 2]))
    _joint(root, "ball", "world", kind="floating", place=height)
    link = _link(root, "ball", ball.mass, ball.inertia * np.eye(3))
    for use in ("visual", "collision"):
        _sphere(link, use, ball.radius)
    for i, frame in enumerate(wheel_frames(robot)):
        _wheel(root, robot, wheel, i, frame, half=half)
    return root


_ABOUT = """
Each roller of an omni-wheel is a link of its own with one contact: a cylinder. With them the robot can move in all
directions; the outline of a wheel has corners that stand out by {corner:.2g} mm, which a real wheel has not. The twin
of Ballbot (ballbot twin export) has rounded rollers. Friction is that at rest; the rotors' inertia is only in the
element ballbot, which holds the whole robot file.
"""


def _wheel(
    root: ET.Element, robot: Robot, parts: WheelParts, index: int, frame: NDArray[np.float64], *, half: float
) -> None:
    name = f"wheel{index + 1}"
    friction, drive, radius = robot.friction, robot.drive, robot.wheels.rollers.radius
    joint = _joint(
        root, name, "base_link", kind="continuous", place=-parts.center_distance * frame[:, 0], frame=frame
    )
    ET.SubElement(joint, "axis", xyz="0 0 1")
    fastest = drive.supply_voltage * drive.speed_constant / drive.gear_ratio
    ET.SubElement(joint, "limit", effort=number_text(drive.torque_limit), velocity=number_text(fastest))
    ET.SubElement(
        joint,
        "dynamics",
        damping=number_text(friction.viscous[index]),
        friction=number_text(friction.coulomb[index] + friction.stribeck[index]),
    )
    hub = _link(root, name, parts.hub_mass, np.diag(parts.hub_inertia))
    _shape(hub, "visual", robot.wheels.radius - 2.0 * radius, 2.0 * radius)
    for k, (center, angle) in enumerate(zip(parts.roller_centers, parts.roller_angles, strict=True), start=1):
        roller = f"roller{index + 1}_{k}"
        turn = np.array(
            [
                [math.cos(angle), -math.sin(angle), 0.0],
                [math.sin(angle), math.cos(angle), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        ET.SubElement(
            _joint(root, roller, name, kind="continuous", place=center, frame=turn), "axis", xyz="0 1 0"
        )
        link = _link(root, roller, parts.roller_mass, np.diag(parts.roller_inertia))
        for use in ("visual", "collision"):
            _shape(link, use, radius, 2.0 * half, turn=(-math.pi / 2, 0.0, 0.0))


def _joint(
    root: ET.Element,
    child: str,
    parent: str,
    *,
    kind: str,
    place: NDArray[np.float64],
    frame: NDArray[np.float64] | None = None,
) -> ET.Element:
    """Add the joint of a link, whose frame (3, 3) is given in its parent's."""
    joint = ET.SubElement(root, "joint", name=child, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=number_text(place), rpy=number_text(_roll_pitch_yaw(frame)))
    return joint


def _roll_pitch_yaw(frame: NDArray[np.float64] | None) -> tuple[float, float, float]:
    """Return the angles of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    if frame is None:
        return 0.0, 0.0, 0.0
    level = math.hypot(frame[0, 0], frame[1, 0])
    pitch = math.atan2(-frame[2, 0], level)
    if level < 1e-9:  # it looks straight up or down: any yaw will do
        return math.atan2(-frame[1, 2], frame[1, 1]), pitch, 0.0
    return math.atan2(frame[2, 1], frame[2, 2]), pitch, math.atan2(frame[1, 0], frame[0, 0])


def _link(
    root: ET.Element,
    name: str,
    mass: float,
    inertia: NDArray[np.float64],
    center: NDArray[np.float64] | None = None,
) -> ET.Element:
    link = ET.SubElement(root, "link", name=name)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=number_text(np.zeros(3) if center is None else center))
    ET.SubElement(inertial, "mass", value=number_text(mass))
    places = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    ET.SubElement(
        inertial, "inertia", {key: number_text(float(inertia[place])) for key, place in places.items()}
    )
    return link


def _shape(
    link: ET.Element,
    use: str,
    radius: float,
    length: float,
    *,
    place: NDArray[np.float64] | None = None,
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Add a cylinder that is seen or touches; its axis is z before the turn (roll, pitch, yaw)."""
    shape = ET.SubElement(link, use)
    ET.SubElement(
        shape, "origin", xyz=number_text(np.zeros(3) if place is None else place), rpy=number_text(turn)
    )
    geometry = ET.SubElement(shape, "geometry")
    ET.SubElement(geometry, "cylinder", radius=number_text(radius), length=number_text(length))


def _sphere(link: ET.Element, use: str, radius: float) -> None:
    geometry = ET.SubElement(ET.SubElement(link, use), "geometry")
    ET.SubElement(geometry, "sphere", radius=number_text(radius))
