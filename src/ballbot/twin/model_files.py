"""Robots to and from the model files of others: MJCF (.xml, .mjcf) and URDF (.urdf).

A model that is written has the twin's parts: each roller is a body of its own with one contact, an ellipsoid in MJCF
and a cylinder in URDF, and a comment in the file says so. It also holds the robot file, since a model has no place for
gears, motors, sensors and sources.

A model that MuJoCo reads gives the parameters that it states (`ballbot.twin.recognition`). Of a file that Ballbot
wrote, a parameter that still has its value keeps its source and its last digit. What a model does not state is taken
from another robot and marked as assumed.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbot.errors import InputError, either
from ballbot.files import read_text, write_text
from ballbot.printable import printable_line
from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME, PARAMETERS
from ballbot.robot.derived import reflected_rotor_inertia
from ballbot.robot.file import parse_robot, robot_text
from ballbot.robot.parameters import Value, build, value_of
from ballbot.robot.robot import MODEL_SUFFIXES, is_model_file
from ballbot.twin.engine import mechanism_of
from ballbot.twin.mjcf import twin_mjcf
from ballbot.twin.recognition import Recognized, recognize
from ballbot.twin.scenario import Scenario
from ballbot.twin.urdf import robot_urdf

#: bytes of a document
LARGEST_MODEL = 10_000_000
_URDF = ".urdf"
#: relative difference below which a number of a model is the one that was written: sums over a hundred parts
_SAME = 1e-7
#: a component below this, or below this share of the largest, is the error of a sum or a sine: a few bits of one
_ROUNDING = 1e-15


@dataclass(frozen=True, kw_only=True)
class ReadModel:
    """A robot from a model file."""

    robot: Robot
    stated: tuple[str, ...]  #: parameters that the model states, by their dotted names
    assumed: tuple[str, ...]  #: parameters that are assumed as in another robot
    notes: tuple[str, ...]  #: what a robot file cannot hold, as sentences


def write_model(robot: Robot, path: str | Path) -> None:
    """Write a robot as MJCF or URDF, by the suffix of `path`.

    Raises
    ------
    InputError
        If the suffix is another, the robot's wheels do not fit its body, or the file cannot be written.
    """
    if not is_model_file(path):
        raise InputError(f"{path} is no name of a model file; it must end in {either(MODEL_SUFFIXES)}.")
    if Path(path).suffix.lower() == _URDF:
        root = robot_urdf(robot)
        ET.SubElement(root, "ballbot").text = robot_text(robot)
    else:
        scenario = replace(Scenario.ideal(robot), name="model", friction=robot.friction)
        root = ET.fromstring(twin_mjcf(robot, scenario))
        root.insert(0, ET.Comment(_ABOUT_MJCF))
        ET.SubElement(ET.SubElement(root, "custom"), "text", name="ballbot", data=robot_text(robot))
    write_text(path, model_text(root))


def model_text(root: ET.Element) -> str:
    """Return a model as the text of a file: indented, and with zero where a vector has a rounding error of sums.

    A simulation of the twin keeps such errors (1e-18 m), as its results depend on every bit; to a reader they say
    nothing.
    """
    for element in root.iter():
        if element.tag == "inertia":  # of URDF, one tensor in six attributes
            components = _without_rounding_errors(" ".join(element.attrib.values())).split()
            element.attrib.update(zip(element.attrib, components, strict=True))
        for name, text in element.items():
            element.set(name, _without_rounding_errors(text))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def _without_rounding_errors(text: str) -> str:
    """Return the text of a vector with zeros for its rounding errors; another text as it is."""
    words = text.split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        return text
    if len(values) < 2 or not all(map(math.isfinite, values)):
        return text
    least = _ROUNDING * max(1.0, *map(abs, values))
    return " ".join("0.0" if abs(value) < least else word for word, value in zip(words, values, strict=True))


_ABOUT_MJCF = """
Each roller of an omni-wheel is a body of its own with one contact: an ellipsoid, which curves along the wheel's rim in
its middle. Dry friction is that at rest; friction that depends on speed is only in the text ballbot, which holds the
whole robot file.
"""


def read_model(path: str | Path, *, like: Robot) -> ReadModel:
    """Return the robot that a model file describes.

    Parameters
    ----------
    path : str or Path
        MJCF or URDF, with its ball, the robot upright on it, z up and x forward.
    like : Robot
        What the model does not state is assumed to be as in this robot; friction that it does not state is zero.

    Raises
    ------
    InputError
        If the file cannot be read, is refused, or is not that of a ball-balancing robot.
    """
    source = str(path)
    text = read_text(path, largest=LARGEST_MODEL)
    mechanism = mechanism_of(text, source=source)
    root = ET.fromstring(text)
    texts = {one.get("name"): one.get("data") for one in root.iterfind("custom/text")}
    try:
        found = recognize(mechanism)
        states_gravity = any(one.get("gravity") for one in root.iterfind("option"))
        values = found.values | ({"gravity": mechanism.gravity} if states_gravity else {})
        written = _written_robot(texts.get("ballbot", root.findtext("ballbot")), values, source=source)
        if written is not None:
            return _changed(written, replace(found, values=values), source)
        return _assumed_like(like, replace(found, values=values), source)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(source) else f"{source}: {text}") from None


def _written_robot(text: str | None, values: Mapping[str, Value], *, source: str) -> Robot | None:
    """Return the robot whose file Ballbot wrote into a model; None if there is none or the wheels are others."""
    if text is None:
        return None
    robot = parse_robot(text, Robot, source=f"the robot file in {source}")
    azimuths = values["wheels.azimuths"]
    return robot if isinstance(azimuths, tuple) and len(azimuths) == robot.wheel_count else None


def _as_model(robot: Robot) -> dict[str, Value]:
    """Return a robot's parameters as a model states them: its inertia about the ball's centre, friction at rest."""
    inertia = robot.body.inertia_about_ball_center()
    places = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    friction = robot.friction
    at_rest = tuple(c + s for c, s in zip(friction.coulomb, friction.stribeck, strict=True))
    return {
        **{one.name: value_of(robot, one) for one in PARAMETERS},
        **{f"body.inertia.{name}": float(inertia[place]) for name, place in places.items()},
        "friction.coulomb": at_rest,
        # a model has them from 0 to below a turn
        "wheels.azimuths": tuple(one % (2.0 * math.pi) for one in robot.wheels.azimuths),
    }


def _same(one: Value, other: Value, *, scale: float) -> bool:
    """Return whether values are equal up to rounding, of their own size or of `scale`."""
    a, b = np.atleast_1d(np.asarray(one, float)), np.atleast_1d(np.asarray(other, float))
    return a.shape == b.shape and bool((np.abs(a - b) <= _SAME * np.maximum(np.abs(b), scale)).all())


def _changed(robot: Robot, found: Recognized, source: str) -> ReadModel:
    """Return the robot that Ballbot wrote, with what was changed in the model since."""
    before = _as_model(robot)
    largest = max(
        abs(float(value))
        for name, value in before.items()
        if "inertia." in name and not isinstance(value, tuple)
    )
    changes = {
        name: value
        for name, value in found.values.items()
        if not _same(value, before[name], scale=largest if name.startswith("body.inertia") else 1e-6)
    }
    drive = robot.drive
    reflected = reflected_rotor_inertia(
        gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )
    if found.reflected_inertia and not _same(found.reflected_inertia, reflected, scale=0.0):
        changes |= _rotor(robot, found.reflected_inertia)
    if any(name.startswith("body.inertia") for name in changes):  # all of them about one point
        changes |= {name: value for name, value in found.values.items() if name.startswith("body.inertia")}
    if "friction.coulomb" in changes:
        changes["friction.stribeck"] = (0.0,) * robot.wheel_count
    changed = _with(robot, changes, dict.fromkeys(changes, _source(source))) if changes else robot
    return ReadModel(robot=changed, stated=tuple(changes), assumed=(), notes=found.notes)


def _assumed_like(like: Robot, found: Recognized, source: str) -> ReadModel:
    """Return the robot of another's model."""
    values, assumed = dict(found.values), {}
    count = len(values["wheels.azimuths"]) if isinstance(values["wheels.azimuths"], tuple) else 0
    if found.reflected_inertia:
        values |= _rotor(like, found.reflected_inertia)
    stated = dict.fromkeys(values, _source(source))
    if not np.any([values["friction.viscous"], values["friction.coulomb"]]):
        assumed |= dict.fromkeys(
            ("friction.viscous", "friction.coulomb"), "assumed: the model states no friction"
        )
    none = {"friction.stribeck": (0.0,) * count, "friction.rolling": 0.0}
    none |= {f"friction.{name}": () for name in ("coulomb_asymmetry", "stribeck_asymmetry", "load")}
    assumed |= dict.fromkeys(none, "assumed: the model does not state it")
    name = printable_line(like.name)
    rest = [one.name for one in PARAMETERS if one.name not in values and one.name not in none]
    assumed |= dict.fromkeys(rest, f"assumed: as in {name}")
    robot = _with(like, values | none, stated | assumed)
    return ReadModel(
        robot=robot,
        stated=tuple(key for key in values if key not in assumed),
        assumed=tuple(assumed),
        notes=found.notes,
    )


def _source(path: str) -> str:
    return f"calculated: from the model {printable_line(Path(path).name)}"


def _rotor(robot: Robot, reflected: float) -> dict[str, Value]:
    """Return the inertias of motor and gear that give a reflected inertia [kg m^2] with the robot's gear ratio."""
    return {"drive.motor_inertia": reflected / robot.drive.gear_ratio**2, "drive.gear_inertia": 0.0}


def _with(robot: Robot, changes: Mapping[str, Value], sources: Mapping[str, str]) -> Robot:
    """Return a robot with other values and their sources; what stays keeps its source and standard deviation."""
    values = {one.name: value_of(robot, one) for one in PARAMETERS} | dict(changes)
    about = (
        "ball_center"
        if any(name.startswith("body.inertia") for name in changes)
        else robot.body.inertia_about
    )
    kept = {name: value for name, value in robot.sources.items() if name not in sources}
    changed = build(
        Robot,
        {**values, "name": robot.name, "body.inertia_about": about, "sources": {**kept, **sources}},
    )
    deviations = {
        name: value
        for name, value in robot.standard_deviations.items()
        if name not in sources and name in BY_NAME
    }
    return changed.annotated(standard_deviations=deviations, correlation=robot.correlation)
