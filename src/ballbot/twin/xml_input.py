"""MJCF and URDF from anybody, reduced to what describes a mechanism before MuJoCo reads it.

The XML is parsed here: a document with a document type, which entities need, or with an `include` is refused, and so is
one that is too large, too deep or has elements that make many others. Of what is left only bodies, joints, primitive
shapes, inertias, defaults and motors go on to MuJoCo. Meshes, textures and every other reference to a file are dropped,
so that no file beside the document is opened, whatever path it names. A body whose mass MuJoCo would compute from a
mesh is refused.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from xml.parsers import expat

from ballbot.errors import InputError

#: bytes of a document, elements within one another, elements
LARGEST_MODEL = 10_000_000
_DEEPEST, _MOST = 100, 50_000
#: of MJCF's elements below a body, those that are kept and those that are dropped; others are refused
_KEPT = ("body", "frame", "joint", "freejoint", "geom", "inertial")
_DROPPED = ("site", "camera", "light", "plugin")
#: of MJCF's compiler and option, what concerns masses and angles
_COMPILER = (
    "angle", "eulerseq", "autolimits", "inertiafromgeom", "inertiagrouprange", "balanceinertia", "boundmass",
    "boundinertia", "settotalmass",
)  # fmt: skip
_DEFAULTS = ("joint", "geom", "motor")
#: a number that is none; MuJoCo warns of it in a file
_NOT_FINITE = re.compile(r"(?:^|\s)[+-]?(?:nan|inf|infinity)(?:\s|$)", re.IGNORECASE)
#: characters of an attribute that may hold numbers
_LONGEST_NUMBERS = 1000
#: attributes of a shape that name a file or something that is dropped
_OF_FILES = ("mesh", "hfield", "material", "fitscale")


@dataclass(frozen=True, kw_only=True)
class ModelDocument:
    """What of a document is read."""

    text: str  #: reduced, for MuJoCo
    is_urdf: bool
    robot_file: str | None  #: the robot file that Ballbot wrote into it
    states_gravity: bool


def reduced_model(text: str, *, source: str) -> ModelDocument:
    """Return what describes a mechanism in a text in MJCF or URDF.

    Raises
    ------
    InputError
        If it is neither, is not well formed, has what is refused, or needs a mesh for its masses. The sentence begins
        with `source`.
    """
    root = parse_xml(text, source=source)
    if root.tag == "robot":
        return ModelDocument(
            text=_text(_reduced_urdf(root)),
            is_urdf=True,
            robot_file=root.findtext("ballbot"),
            states_gravity=False,
        )
    if root.tag != "mujoco":
        raise InputError(f"{source} is no model in MJCF or URDF: it begins with <{root.tag[:40]}>.")
    kept = next((one for one in root.iterfind("custom/text") if one.get("name") == "ballbot"), None)
    return ModelDocument(
        text=_text(_reduced_mjcf(root, source)),
        is_urdf=False,
        robot_file=None if kept is None else kept.get("data"),
        states_gravity=any(one.get("gravity") for one in root.iterfind("option")),
    )


def _text(root: ET.Element) -> str:
    return ET.tostring(root, encoding="unicode")


def parse_xml(text: str, *, source: str) -> ET.Element:
    """Return the root of a document in XML.

    Raises
    ------
    InputError
        If it is not well formed, has a document type, or is too large or too deep.
    """
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()
    depth = count = 0

    def start(tag: str, attributes: Mapping[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > _DEEPEST or count > _MOST:
            raise InputError(
                f"{source} is too large a model; at most {_MOST} elements are read, {_DEEPEST} within one another."
            )
        for name, value in attributes.items():
            if _NOT_FINITE.search(value[:_LONGEST_NUMBERS]):
                raise InputError(f"{source} has a number that is not finite: {name[:40]} of <{tag[:40]}>.")
        builder.start(tag, dict(attributes))

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise InputError(f"{source} has a document type (<!DOCTYPE ..>), which is not read; remove it.")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
        return builder.close()
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InputError(f"{source} is not valid XML, line {error.lineno}: {reason}.") from None


def _reduced_urdf(root: ET.Element) -> ET.Element:
    """Return the links with primitive shapes, and the joints; a link without an inertia has no mass, as in ROS."""
    kept = ET.Element("robot", name="model")
    for one in root:
        if one.tag == "link":
            link = ET.SubElement(kept, "link", one.attrib)
            inertia = one.find("inertial")
            if inertia is not None:
                link.append(inertia)
                link.extend(
                    shape for shape in one.iterfind("collision") if shape.find("geometry/mesh") is None
                )
        elif one.tag == "joint":
            kept.append(one)
    return kept


def _reduced_mjcf(root: ET.Element, source: str) -> ET.Element:
    if next(root.iter("include"), None) is not None:
        raise InputError(f"{source} includes another file, which is not read; save the model as one file.")
    kept = ET.Element("mujoco", model="model")
    compiler = {key: one for element in root.iterfind("compiler") for key, one in element.attrib.items()}
    ET.SubElement(kept, "compiler", {key: one for key, one in compiler.items() if key in _COMPILER})
    for option in root.iterfind("option"):
        ET.SubElement(kept, "option", {key: one for key, one in option.attrib.items() if key == "gravity"})
    for defaults in root.iterfind("default"):
        _copy_defaults(defaults, ET.SubElement(kept, "default", defaults.attrib))
    always = compiler.get("inertiafromgeom") == "true"
    for world in root.iterfind("worldbody"):
        _copy_body(world, ET.SubElement(kept, "worldbody"), source, weighs_shapes=False, always=always)
    actuators = ET.SubElement(kept, "actuator")
    actuators.extend(motor for motor in root.iterfind("actuator/motor") if motor.get("joint"))
    return kept


def _copy_defaults(given: ET.Element, kept: ET.Element) -> None:
    for one in given:
        if one.tag == "default":
            _copy_defaults(one, ET.SubElement(kept, "default", one.attrib))
        elif one.tag in _DEFAULTS:
            ET.SubElement(kept, one.tag, _without_files(one))


def _without_files(element: ET.Element) -> dict[str, str]:
    return {key: one for key, one in element.attrib.items() if key not in _OF_FILES}


def _copy_body(
    given: ET.Element, kept: ET.Element, source: str, *, weighs_shapes: bool, always: bool
) -> None:
    """Copy what is below a body; `weighs_shapes` if MuJoCo computes its mass from its shapes, `always` if all."""
    for one in given:
        if one.tag == "body":
            inner = always or one.find("inertial") is None
            _copy_body(
                one, ET.SubElement(kept, "body", one.attrib), source, weighs_shapes=inner, always=always
            )
        elif one.tag == "frame":
            below = ET.SubElement(kept, "frame", one.attrib)
            _copy_body(one, below, source, weighs_shapes=weighs_shapes, always=always)
        elif one.tag == "geom" and (one.get("mesh") or one.get("hfield")):
            if weighs_shapes and one.get("mass") != "0" and one.get("density") != "0":
                name = given.get("name", "without a name")[:80]
                raise InputError(
                    f"{source}: the mass of the body {name!r} comes from a mesh, and meshes are not read; give it "
                    "an <inertial>, or the mesh mass 0."
                )
        elif one.tag in _KEPT:
            ET.SubElement(kept, one.tag, _without_files(one))
        elif one.tag not in _DROPPED:
            raise InputError(
                f"{source} has an element <{one.tag[:40]}> in a body, which is not read; save the model by MuJoCo, "
                "which writes out its parts."
            )
