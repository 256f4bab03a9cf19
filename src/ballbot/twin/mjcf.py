"""The twin as an MJCF document, the format of MuJoCo's models.

    world
    |- floor
    |- ball                free joint
    `- body                free joint, its frame at the ball's centre
       |- payload
       `- wheel i          hinges "wheel i" (rotor; the encoder measures it) and "play i", on one axis
          `- roller i.k    hinge, turns freely

The ball meets the floor through a contact pair of its own, with pivoting and rolling friction, and the rollers through
ordinary contacts with sliding friction only: rollers with the floor's pivoting friction would fix the
ball's heading and the robot would fall.

Wheels. The rotor's reflected inertia j_r is the armature of "wheel i"; the wheel follows the rotor through "play i", a
hinge without spring whose stops are the gearbox's play. A driveline that twists has a spring in place of the stops: a
tendon that is slack within the play. Without either that hinge is left out.

Spring of a driveline. A spring of stiffness k connects the rotor to its wheel, and the wheel to the robot on its ball.
With m the mobility of that wheel, the angular acceleration that a unit torque on it gives the robot without
rotors,

    (2 pi f)^2 = k (1/j_r + m)        d = 2 zeta k / (2 pi f)

m = W M^-1 W^T has an eigenvalue for each way of moving (forward, sideways, turning). They are small beside 1/j_r and
close together, so that one spring serves all within a part in a hundred on the BBR.

Soft contacts are springs of a stiffness in N/m, in the terms of MuJoCo's solver. For a contact at depth r that gives
way at v, the solver finds the force from (A + R) f + a_0 = -b v - k d r, with the contact's acceleration a = A f + a_0
and R = (1 - d)/d m, where d is the impedance and m the sum of the two bodies' inverse weights (MuJoCo's documentation,
"Computation", constraint model). So

    f = K r + C v - a/R        K = k d / R        C = b / R

a spring, a damper, and a spurious mass 1/R = d/(1 - d) / m; a small d keeps it small (some 0.3 kg for each
of the BBR's contacts). Written into `solref` as -k d^2 and -b d. Friction has the same R, a damper of its own and a
high ratio of impedances, so that a wheel that grips creeps little.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.twin.engine import Engine
from ballbot.twin.faults import Compliance, Payload, Softness
from ballbot.twin.parts import BodyParts, WheelParts, split_robot, wheel_frames
from ballbot.twin.scenario import Scenario, check_scenario


def number_text(values: float | Iterable[float]) -> str:
    """Return numbers so that reading them gives the same bits."""
    if isinstance(values, float | int):
        return repr(float(values))
    return " ".join(repr(float(value)) for value in values)


def add(parent: ET.Element, tag: str, **attributes: str | float | Iterable[float]) -> ET.Element:
    """Return a new element with attributes that are texts or numbers."""
    texts = {name: raw if isinstance(raw, str) else number_text(raw) for name, raw in attributes.items()}
    return ET.SubElement(parent, tag, texts)


_IMPEDANCE = 0.2  # d
_IMPEDANCE_RATIO = 100.0  # of friction to normal force; 10 elsewhere
_LARGEST_STEP = 1.0  # k d h^2 and b h at most: beyond, the contact jumps from step to step


def _add_roller_contacts(root: ET.Element, scenario: Scenario) -> None:
    """Add the contacts of the rollers with the ball, each by itself: MuJoCo need not look for pairs that touch.

    InputError if soft contacts are too stiff for the timestep, or MuJoCo is not installed.
    """
    softness, grip = scenario.softness, scenario.roller_grip
    # made without these contacts; it gives the inverse weights of the bodies
    engine = Engine(ET.tostring(root, encoding="unicode")) if softness else None
    pairs, friction = root.find("contact"), (grip, grip, 0.0, 0.0, 0.0)
    if pairs is None:
        pairs = add(root, "contact")
    contact: dict[str, tuple[float, ...]] = {"solref": (scenario.contact_time, 1.0)}
    for name in (body.get("name", "") for body in root.iter("body")):
        if not name.startswith("roller "):
            continue
        if softness and engine:
            mobility = engine.mobility("ball") + engine.mobility(name)
            contact = {
                "solref": _contact_reference(softness, mobility, scenario.timestep),
                "solreffriction": (-1.0, -0.5 * _IMPEDANCE / scenario.timestep),
                "solimp": (_IMPEDANCE, _IMPEDANCE, 0.001),
            }
        add(pairs, "pair", geom1="ball", geom2=name, condim="3", friction=friction, **contact)


def _contact_reference(softness: Softness, mobility: float, step: float) -> tuple[float, float]:
    d = _IMPEDANCE
    R = (1 - d) / d * mobility
    k_d, b = softness.stiffness * R, softness.damping * R
    if k_d * step**2 > _LARGEST_STEP or b * step > _LARGEST_STEP:
        stiffest, most = _LARGEST_STEP / (R * step**2), _LARGEST_STEP / (R * step)
        raise InputError(
            f"softness.stiffness is {softness.stiffness:g} N/m and softness.damping "
            f"{softness.damping:g} N s/m; with a timestep of {step:g} s they must "
            f"be below {stiffest:.2g} and {most:.2g}. Reduce them or the timestep."
        )
    return -k_d * d, -b * d


def _mobility(robot: Robot) -> float:
    """Return the smallest m above zero [1/(kg m^2)]: the slowest way of moving."""
    tiny = 1e-12 * robot.drive.motor_inertia
    without_rotors = robot.replace(drive=replace(robot.drive, motor_inertia=tiny, gear_inertia=0.0))
    model, upright = Model(without_rotors), np.zeros(5)
    W = np.array([model.wheel_speed(upright, rate) for rate in np.eye(5)]).T
    mobilities = np.linalg.eigvalsh(W @ np.linalg.solve(model.mass_matrix(upright), W.T))
    # four wheels can also work against each other without moving anything
    return float(mobilities[mobilities > 1e-9 * mobilities.max()].min())


def _add_wheel(
    body: ET.Element, index: int, frame: Floats, robot: Robot, scenario: Scenario, parts: WheelParts
) -> None:
    """Add a wheel to the body: its index from 0 on, its frame (3, 3) and its parts."""
    name = f"wheel {index + 1}"
    element = add(
        body, "body", name=name, pos=-parts.center_distance * frame[:, 0], xyaxes=(*frame[:, 0], *frame[:, 1])
    )
    friction, half = scenario.friction, scenario.backlash / 2
    add(
        element,
        "joint",
        name=name,
        axis="0 0 1",
        armature=robot.drive.reflected_inertia,
        damping=friction.viscous[index],
        frictionloss=friction.breakaway[index],
    )
    if scenario.compliance:
        add(element, "joint", name=f"play {index + 1}", axis="0 0 1")
    elif scenario.backlash > 0:
        # Teeth are stiff: with MuJoCo's default of 20 ms, the stops yield so slowly that the play loses much of its
        # effect. Two timesteps are the shortest time that MuJoCo takes.
        add(
            element,
            "joint",
            name=f"play {index + 1}",
            axis="0 0 1",
            limited="true",
            range=(-half, half),
            solreflimit=(2.0 * scenario.timestep, 1.0),
            solimplimit=_HARD,
        )
    add(element, "inertial", pos="0 0 0", mass=parts.hub_mass, diaginertia=parts.hub_inertia)
    size = (robot.wheels.radius - 2 * scenario.rollers.radius, scenario.rollers.radius)
    add(element, "geom", type="cylinder", size=size, rgba="0.7 0.7 0.7 1")
    for k, (center, angle) in enumerate(zip(parts.roller_centers, parts.roller_angles, strict=True)):
        _roller(element, f"roller {index + 1}.{k + 1}", center, float(angle), scenario, parts)


def _add_shafts(root: ET.Element, robot: Robot, scenario: Scenario, compliance: Compliance) -> None:
    """Add the springs of drivelines that twist, with which the robot has that resonance."""
    rate = 2 * math.pi * compliance.frequency
    stiffness = rate**2 / (1 / robot.drive.reflected_inertia + _mobility(robot))
    damping = 2 * compliance.damping_ratio * stiffness / rate
    tendons, slack = add(root, "tendon"), (-scenario.backlash / 2, scenario.backlash / 2)
    for i in range(1, robot.wheel_count + 1):
        name = f"shaft {i}"
        shaft = add(tendons, "fixed", name=name, stiffness=stiffness, damping=damping, springlength=slack)
        add(shaft, "joint", joint=f"play {i}", coef="1")


def _roller(
    wheel: ET.Element, name: str, center: Floats, angle: float, scenario: Scenario, parts: WheelParts
) -> None:
    turn = (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2))
    element = add(wheel, "body", name=name, pos=center, quat=turn)
    add(element, "joint", name=name, axis="0 1 0")
    add(element, "inertial", pos="0 0 0", mass=parts.roller_mass, diaginertia=parts.roller_inertia)
    add(
        element,
        "geom",
        name=name,
        type="ellipsoid" if scenario.wheel_contact == "rollers" else "sphere",
        size=(scenario.rollers.radius, parts.roller_half_length, scenario.rollers.radius),
        rgba="0.1 0.1 0.1 1",
    )


#: balancing; the body held, wheels in the air, no ball; the body held upside down, the ball on its wheels
Mounting = Literal["floor", "stand", "upside_down"]

# MuJoCo's impedance d: dry friction gives way like a damper below a speed that grows with (1 - d)/d. Its
# default of 0.9 to 0.95 lets a slowly rolling ball coast on as if in oil; with this it stops.
_HARD = "0.999 0.999 0.001"


def twin_mjcf(robot: Robot, scenario: Scenario, *, mounting: Mounting = "floor") -> str:
    """Return the MJCF document (XML) of a robot in a scenario.

    Upside down, the world's frame is the body's: z points down, and so does gravity along it. Friction that depends on
    speed is not in the document: `ballbot.twin.driveline` sets that at each step, so in MuJoCo's own viewer the
    drivelines have their friction at rest. Motors, supply, pushes, bumps and timing are not in it either.

    InputError if the scenario does not fit the robot, or the robot's wheels do not fit its body.
    """
    check_scenario(scenario, robot)
    root = _document(robot, scenario, mounting)
    if mounting != "stand":
        _add_roller_contacts(root, scenario)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def floor_normal(scenario: Scenario) -> Floats:
    """Return the unit normal (3,) of the floor, R_x(tilt_x) R_y(tilt_y) e_z, in the world's frame."""
    about_x, about_y = scenario.floor_tilt
    cx, sx, cy, sy = math.cos(about_x), math.sin(about_x), math.cos(about_y), math.sin(about_y)
    return np.array([sy, -sx * cy, cx * cy])


def _document(robot: Robot, scenario: Scenario, mounting: Mounting) -> ET.Element:
    wheel, rest = split_robot(robot, scenario.rollers, point=scenario.wheel_contact == "point")
    root = ET.Element("mujoco", model=f"{robot.name} {scenario.name}")
    _options(root, robot, scenario, mounting)
    world = add(root, "worldbody")
    add(world, "light", pos="0 0 3", dir="0 0 -1")
    if mounting == "floor":
        floor = add(world, "geom", name="floor", type="plane", size="5 5 0.1", rgba="0.85 0.85 0.85 1")
        if any(scenario.floor_tilt):
            floor.set("zaxis", number_text(floor_normal(scenario)))
    if mounting != "stand":
        _ball(world, robot, scenario, mounting)
    body = _body(world, robot, rest, mounting)
    if scenario.payload:
        _payload(body, scenario.payload)
    for i, frame in enumerate(wheel_frames(robot)):
        _add_wheel(body, i, frame, robot, scenario, wheel)
    if mounting == "floor":
        _floor_contact(root, robot, scenario)
    if scenario.compliance:
        _add_shafts(root, robot, scenario, scenario.compliance)
    actuators = add(root, "actuator")
    for i in range(robot.wheel_count):
        add(actuators, "motor", name=f"wheel {i + 1}", joint=f"wheel {i + 1}")
    return root


def _options(root: ET.Element, robot: Robot, scenario: Scenario, mounting: Mounting) -> None:
    add(root, "compiler", angle="radian", inertiafromgeom="false")
    down = 1.0 if mounting == "upside_down" else -1.0
    option = add(
        root,
        "option",
        timestep=scenario.timestep,
        gravity=(0.0, 0.0, down * robot.gravity),
        integrator="implicitfast",
        cone="elliptic",
        impratio=_IMPEDANCE_RATIO if scenario.softness and mounting != "stand" else 10.0,
        # twice as fast as "dense" here; MuJoCo 4.0.0 factors some sparse Hessians wrongly (its issue 3767,
        # fixed in 4.0.1); tests/twin/test_physics.py shows that this robot is not affected
        jacobian="sparse",
    )
    # else MuJoCo silently replaces a state that is not finite by the upright one
    add(option, "flag", autoreset="disable")
    default = add(root, "default")
    add(default, "joint", solimpfriction=_HARD, solreffriction="0.002 1", solreflimit="0.002 1")
    add(default, "geom", contype="0", conaffinity="0")


def _ball(world: ET.Element, robot: Robot, scenario: Scenario, mounting: Mounting) -> None:
    ball = robot.ball
    height = ball.radius / floor_normal(scenario)[2] if mounting == "floor" else 0.0
    element = add(world, "body", name="ball", pos=(0.0, 0.0, height))
    add(element, "freejoint", name="ball")
    inertia = (ball.inertia,) * 3
    add(element, "inertial", pos="0 0 0", mass=ball.mass, diaginertia=inertia)
    add(element, "geom", name="ball", type="sphere", size=ball.radius, rgba="0.2 0.3 0.7 1")


def floor_friction(robot: Robot, scenario: Scenario) -> tuple[float, float, float, float, float]:
    """Return MuJoCo's friction of the ball on the floor: sliding twice, pivoting [m], rolling twice [m]."""
    rolling = scenario.friction.rolling * robot.ball.radius  # a force N C_rr at r_b is a moment N C_rr r_b
    pivoting = scenario.friction.pivoting or scenario.pivoting  # a robot file's, where the friction is
    return (scenario.floor_grip, scenario.floor_grip, pivoting, rolling, rolling)


def _floor_contact(root: ET.Element, robot: Robot, scenario: Scenario) -> None:
    rolls = any(scenario.at(t).friction.rolling > 0.0 for t in (0.0, *scenario.changes()))
    pairs = add(root, "contact")
    add(
        pairs,
        "pair",
        geom1="ball",
        geom2="floor",
        condim="6" if rolls else "4",
        friction=floor_friction(robot, scenario.at(0.0)),
        solref=(scenario.contact_time, 1.0),
        solimp=_HARD,
    )


def _body(world: ET.Element, robot: Robot, parts: BodyParts, mounting: Mounting) -> ET.Element:
    held = mounting != "floor"
    height = 0.0 if held else robot.ball.radius
    element = add(world, "body", name="body", pos=(0.0, 0.0, height))
    if not held:
        add(element, "freejoint", name="body")
    J = parts.inertia
    add(
        element,
        "inertial",
        pos=parts.center_of_mass,
        mass=parts.mass,
        fullinertia=(J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]),
    )
    low = robot.ball.radius + 2 * robot.wheels.radius
    high = max(2 * robot.body.center_of_mass, low + 0.05)
    add(
        element,
        "geom",
        name="body",
        type="cylinder",
        size=(robot.ball.radius,),
        fromto=(0.0, 0.0, low, 0.0, 0.0, high),
        rgba="0.6 0.6 0.6 0.5",
    )
    return element


def _payload(body: ET.Element, payload: Payload) -> None:
    element = add(body, "body", name="payload", pos=payload.position)
    inertia = (0.4 * payload.mass * payload.radius**2,) * 3
    add(element, "inertial", pos="0 0 0", mass=payload.mass, diaginertia=inertia)
    add(element, "geom", type="sphere", size=payload.radius, rgba="0.8 0.5 0.2 1")
