"""Twins with one fault and nothing else, and wheels in the air, which the tests of the faults share."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from ballbot.arrays import Floats
from ballbot.robot import Robot
from ballbot.twin import Scenario, twin_mjcf
from ballbot.twin.driveline import TwinDriveline
from ballbot.twin.engine import Engine

_PRESET = Robot.load("alten")
ALTEN = _PRESET.replace(drive=replace(_PRESET.drive, resistance=0.6))
IDEAL = Scenario.ideal(ALTEN)
ROTOR = 27.6**2 * (2.42e-6 + 1.6e-7)  # Appendix III
INERTIA = 1e-3 + ROTOR


def ideal(**faults: Any) -> Scenario:
    return replace(IDEAL, **faults)


def wheels_in_the_air(scenario: Scenario) -> tuple[Engine, TwinDriveline]:
    engine = Engine(twin_mjcf(ALTEN, scenario, mounting="stand"))
    return engine, TwinDriveline(ALTEN, scenario, engine)


def mass_matrix(engine: Engine) -> Floats:
    full = np.zeros((engine.model.nv, engine.model.nv))
    mujoco.mj_forward(engine.model, engine.data)
    mujoco.mj_fullM(engine.model, engine.data, full)
    return full


def block_of(engine: Engine, joint: str) -> Floats:
    """Return the mass matrix (6, 6) of a free joint: three translations, then three rotations about its origin."""
    first = engine.model.joint(joint).dofadr[0]
    return mass_matrix(engine)[first : first + 6, first : first + 6]


def turn(engine: Engine, driveline: TwinDriveline, torques: Floats, steps: int) -> list[list[float]]:
    driveline.command(torques)
    speeds = []
    for _ in range(steps):
        driveline.prepare_step()
        engine.step()
        speeds.append(driveline.speeds.tolist())
    return speeds


def lone_ball(robot: Robot, scenario: Scenario) -> Engine:
    """Return the twin's ball on its floor, without the robot on it."""
    root = ET.fromstring(twin_mjcf(robot, scenario))
    world, pairs = root.find("worldbody"), root.find("contact")
    assert world is not None
    assert pairs is not None
    world.remove(next(body for body in world.findall("body") if body.get("name") == "body"))
    for pair in pairs.findall("pair")[1:]:  # of the rollers
        pairs.remove(pair)
    root.remove(root.find("actuator"))  # type: ignore[arg-type]
    return Engine(ET.tostring(root, encoding="unicode"))
