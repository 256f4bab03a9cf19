"""Robots as URDF, and from the models of others in MJCF or URDF, as MuJoCo compiles them.

A model that is read must show a ball, a body and omni-wheels. The ball is the one body that stands apart from the
robot, has no parts and has a sphere as its shape. A wheel is a hinge on the robot whose axis a passes the ball's
centre c at right angles and along the ball's meridian:

    n = (p - c - ((p - c) . a) a) / |..|     towards the wheel, p on the axis a
    |a . (z x n)| small                      the axle lies in the plane of n and the vertical

Rollers are hinges on a wheel; without them the wheel's radius is its axle's distance from the ball. Everything else
that moves with the body, such as an arm, counts as part of it, in the pose of the document.

URDF has no ellipsoid: a roller is a cylinder of its radius, as long as fits between its neighbours without touching
them, so that the wheel's outline has corners. Nor has URDF a rotor's reflected inertia, or friction by speed.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.errors import InputError, about
from ballbot.files import read_text
from ballbot.printable import printable_line
from ballbot.robot import Friction, Robot
from ballbot.robot.components import PARAMETERS
from ballbot.robot.parameters import Value, build, value_of
from ballbot.twin.engine import Engine, foreign_model
from ballbot.twin.mjcf import add, twin_mjcf
from ballbot.twin.parts import point_inertia
from ballbot.twin.scenario import Scenario

#: bytes of a document
LARGEST_MODEL = 10_000_000
#: largest sine of the angle between an axle and the plane that it must lie in
_ASLANT = 0.02
#: how much distances and tilts of one robot's wheels may differ [m, rad]
_UNEQUAL, _UNEQUAL_TILT = 1e-3, 0.02
#: how much a wheel's radius by its rollers or shape may differ from the distance to the ball, over the radius
_GAP = 0.05
#: offset of the centre of mass from the ball's axis that is worth a note [m]
_OFF_AXIS = 0.002
#: MuJoCo's numbers of joints and of round shapes, with the half size that is their radius
_FREE, _HINGE = 0, 3
_SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER = 2, 3, 4, 5
_FEWEST_ROLLERS = 3


@dataclass(frozen=True, kw_only=True)
class ReadModel:
    """A robot from a model file."""

    robot: Robot
    stated: tuple[str, ...]  #: parameters that the model states, by their dotted names
    assumed: tuple[str, ...]  #: parameters that are assumed as in another robot, or zero friction
    notes: tuple[str, ...]  #: what a robot file cannot hold, as sentences


def read_model(path: str | Path, *, like: Robot) -> ReadModel:
    """Return the robot of a model file, MJCF or URDF, with its ball, the robot upright on it, z up and x forward.

    What the model does not state is assumed to be as in the robot `like`; friction that it does not state is zero.
    InputError if the file cannot be read, is refused, or is not that of a ball-balancing robot.
    """
    text = read_text(path, largest=LARGEST_MODEL)
    model, data = foreign_model(text, source=str(path))
    with about(path):
        stated, notes = _recognized(model, data, gear_ratio=like.drive.gear_ratio)
        return _completed(like, stated, notes, Path(path).name)


def _completed(like: Robot, stated: dict[str, Value], notes: tuple[str, ...], source: str) -> ReadModel:
    """Return the robot with what a model states, and the rest as in another one."""
    friction = Friction.none(np.size(stated["wheels.azimuths"]))
    terms = (
        *("viscous", "coulomb", "stribeck", "rolling", "pivoting"),
        *("coulomb_asymmetry", "stribeck_asymmetry", "load"),
    )
    none = {f"friction.{term}": getattr(friction, term) for term in terms if f"friction.{term}" not in stated}
    rest = [row for row in PARAMETERS if row.name not in stated and row.name not in none]
    sources = {
        **dict.fromkeys(stated, f"calculated: from the model {printable_line(source)}"),
        **dict.fromkeys(none, "assumed: the model does not state it"),
        **{row.name: f"assumed: as in {printable_line(like.name)}" for row in rest},
    }
    values = {row.name: value_of(like, row) for row in rest} | none | stated
    robot = build(
        Robot, {**values, "name": like.name, "body.inertia_about": "ball_center", "sources": sources}
    )
    assumed = (*none, *(row.name for row in rest))
    return ReadModel(robot=robot, stated=tuple(stated), assumed=assumed, notes=notes)


def _recognized(model, data, *, gear_ratio: float) -> tuple[dict[str, Value], tuple[str, ...]]:
    """Return the parameters that a compiled model (MjModel, with its MjData) states, and notes."""
    ball, radius = _ball(model)
    center = data.xipos[ball]
    wheels = _wheels(model, data, center, radius)
    joints = [wheel.joint for wheel in wheels]
    root = int(model.body_rootid[model.jnt_bodyid[joints[0]]])
    mass = float(model.body_subtreemass[root])
    middle = data.subtree_com[root] - center
    J = _inertia_about(model, data, root, center)
    axles = [
        float(
            wheel.axis
            @ _inertia_about(model, data, model.jnt_bodyid[wheel.joint], center + wheel.position)
            @ wheel.axis
        )
        for wheel in wheels
    ]
    velocities = model.jnt_dofadr[joints]
    sizes = [_size(model, data, wheel, center, radius) for wheel in wheels]
    values: dict[str, Value] = {
        "gravity": float(np.linalg.norm(model.opt.gravity)),
        "ball.radius": radius,
        "ball.mass": float(model.body_mass[ball]),
        "ball.inertia": float(model.body_inertia[ball].mean()),
        "body.mass": mass,
        "body.center_of_mass": float(middle[2]),
        **{f"body.inertia.{a}{b}": float(J["xyz".index(a), "xyz".index(b)]) for a, b in _ELEMENTS},
        "wheels.radius": float(np.mean([size["wheels.radius"] for size in sizes])),
        "wheels.inertia": float(np.mean(axles)),
        "wheels.tilt": float(np.mean([wheel.tilt for wheel in wheels])),
        # from 0 to below a turn, but for rounding
        "wheels.azimuths": tuple(
            (math.atan2(wheel.position[1], wheel.position[0]) + 1e-9) % (2.0 * math.pi) - 1e-9
            for wheel in wheels
        ),
        **{name: value for name, value in sizes[0].items() if name != "wheels.radius"},
    }
    friction = {"viscous": model.dof_damping[velocities], "coulomb": model.dof_frictionloss[velocities]}
    values |= {f"friction.{name}": tuple(part.tolist()) for name, part in friction.items() if part.any()}
    if (limit := min(_torque_limit(model, joint) for joint in joints)) < math.inf:
        values["drive.torque_limit"] = limit
    if (reflected := float(model.dof_armature[velocities].mean())) > 0.0:
        values |= {"drive.motor_inertia": reflected / gear_ratio**2, "drive.gear_inertia": 0.0}
    off = float(np.hypot(middle[0], middle[1]))
    note = (
        f"The body's centre of mass lies {1e3 * off:.3g} mm beside the vertical through the ball's centre; a robot "
        "file has it on that line."
    )
    return values, (note,) if off > _OFF_AXIS else ()


_ELEMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")


def _inertia_about(model, data, body: int, point: Floats) -> Floats:
    """Return the inertia (3, 3) of a body with all that it carries about a point, in the world's axes."""
    xx, yy, zz, xy, xz, yz, *moment, mass = data.crb[body].tolist()
    about = data.subtree_com[model.body_rootid[body]]  # MuJoCo's own point
    middle = np.array(moment) / mass if mass > 0.0 else np.zeros(3)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * point_inertia(middle)
    return inertia + mass * point_inertia(about + middle - point)


def _ball(model) -> tuple[int, float]:
    """Return the ball's body and radius."""
    carried = set(model.body_parentid[1:].tolist())
    balls = {
        int(owner): float(size[0])
        for owner, kind, size in zip(model.geom_bodyid, model.geom_type, model.geom_size, strict=True)
        if kind == _SPHERE and owner and model.body_parentid[owner] == 0 and int(owner) not in carried
    }
    if len(balls) != 1:
        raise InputError(
            f"It has {len(balls) or 'no'} bodies that could be the ball: a robot's ball is the one body in the world, "
            "apart from the robot, with a sphere as its shape and without parts."
        )
    return next(iter(balls.items()))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Hinge:
    joint: int
    axis: Floats  #: (3,)
    position: Floats  #: (3,) of its middle from the ball's centre [m]

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.position))

    @property
    def tilt(self) -> float:
        return math.acos(float(self.position[2]) / self.distance)


def _wheels(model, data, center: Floats, ball_radius: float) -> list[_Hinge]:
    """Return three or four wheels, in the document's order."""
    hinges = np.flatnonzero(model.jnt_type == _HINGE).tolist()
    turning = set(model.jnt_bodyid[hinges].tolist())
    hubs: dict[int, _Hinge] = {}  # by the body; a second hinge of a wheel is its gear's play
    for joint in hinges:
        body = int(model.jnt_bodyid[joint])
        if not _ancestors(model, body) & turning:
            axis, arm = data.xaxis[joint], data.xanchor[joint] - center
            hubs.setdefault(body, _Hinge(joint=joint, axis=axis, position=arm - (arm @ axis) * axis))
    wheels = [wheel for wheel in hubs.values() if wheel.distance > ball_radius and _is_along_meridian(wheel)]
    spread = [np.ptp([getattr(wheel, name) for wheel in wheels] or [0.0]) for name in ("distance", "tilt")]
    if len(wheels) not in (3, 4) or spread[0] > _UNEQUAL or spread[1] > _UNEQUAL_TILT:
        names = ", ".join(model.joint(wheel.joint).name[:40] or "?" for wheel in list(hubs.values())[:8])
        raise InputError(
            f"It has {len(wheels)} wheels on the ball, and a robot has three or four of the same tilt: hinges on the "
            "body whose axles lie at right angles to the line from the ball's centre, in the plane of that line and "
            f"the vertical (hinges on the body: {names or 'none'})."
        )
    return wheels


def _ancestors(model, body: int) -> set[int]:
    """Return the bodies that carry a body."""
    ancestors = set[int]()
    while body := int(model.body_parentid[body]):
        ancestors.add(body)
    return ancestors


def _is_along_meridian(wheel: _Hinge) -> bool:
    across = np.array([-wheel.position[1], wheel.position[0], 0.0]) / wheel.distance
    size = float(np.linalg.norm(across))
    return size > _ASLANT and abs(float(wheel.axis @ across)) < _ASLANT * size


def _size(model, data, wheel: _Hinge, center: Floats, ball_radius: float) -> dict[str, Value]:
    """Return the radius of a wheel, and its rollers if it has any."""
    body, gap = int(model.jnt_bodyid[wheel.joint]), wheel.distance - ball_radius
    rollers = [
        owner
        for owner, kind in zip(model.jnt_bodyid.tolist(), model.jnt_type, strict=True)
        if kind == _HINGE and model.body_parentid[owner] == body
    ]
    sizes: dict[str, Value] = {}
    radius = max(_radii(model, [body]), default=gap)
    if len(rollers) >= _FEWEST_ROLLERS and (radii := _radii(model, rollers)):
        positions = data.xipos[rollers] - center - wheel.position
        along = positions @ wheel.axis
        rows = len(np.unique(np.round(along, 4)))
        sizes = {
            "wheels.rollers.rows": rows,
            "wheels.rollers.per_row": len(rollers) // rows,
            "wheels.rollers.radius": float(np.mean(radii)),
        }
        if rows > 1:
            sizes["wheels.rollers.row_spacing"] = float(np.ptp(along) / (rows - 1))
        ring = np.linalg.norm(positions - np.outer(along, wheel.axis), axis=1)
        radius = float(ring.mean() + np.mean(radii))
    if abs(radius - gap) > _GAP * gap:
        raise InputError(
            f"The wheel {model.joint(wheel.joint).name[:40]!r} has a radius of {1e3 * radius:.4g} mm by its rollers "
            f"or shape, but {1e3 * gap:.4g} mm lie between its axle and the ball."
        )
    return {"wheels.radius": radius if sizes else gap, **sizes}


def _radii(model, bodies: Iterable[int]) -> list[float]:
    """Return the radii of the round shapes of bodies [m]; of an ellipsoid, the smallest half axis."""
    return [
        float(size.min() if kind == _ELLIPSOID else size[0])
        for owner, kind, size in zip(model.geom_bodyid, model.geom_type, model.geom_size, strict=True)
        if owner in bodies and kind in (_SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER)
    ]


def _torque_limit(model, joint: int) -> float:
    """Return the largest torque [N m] that a joint's own limits and those of its motors allow; inf if none."""
    limits = [float(model.jnt_actfrcrange[joint, 1])] if model.jnt_actfrclimited[joint] else []
    for k in range(model.nu):
        if model.actuator_trntype[k] == 0 and model.actuator_trnid[k, 0] == joint:  # 0: it drives a joint
            gear = abs(float(model.actuator_gear[k, 0]))
            for limited, span in (
                (model.actuator_ctrllimited[k], model.actuator_ctrlrange[k]),
                (model.actuator_forcelimited[k], model.actuator_forcerange[k]),
            ):
                limits += [gear * float(span[1])] if limited else []
    return min(limits, default=math.inf)


_ABOUT = """
Each roller of an omni-wheel is a link of its own with one contact: a cylinder. With them the robot can move in all
directions; the outline of a wheel has corners, which a real wheel has not. The twin of Ballbot has rounded rollers
(MJCF). Friction is that at rest; the rotors' inertia is left out.
"""
#: of the length at which rollers touch
_CLEAR = 0.98


def robot_urdf(robot: Robot) -> str:
    """Return a robot with its own friction as URDF: the twin's bodies, as MuJoCo compiles them.

    Raises
    ------
    InputError
        If MuJoCo is not installed, or the robot's wheels do not fit its body.
    """
    scenario = replace(Scenario.ideal(robot), name="model", friction=robot.friction)
    model, rollers, drive = Engine(twin_mjcf(robot, scenario)).model, robot.wheels.rollers, robot.drive
    # its inner edge stays within the roller's part of a turn
    turn = math.pi / (rollers.per_row * rollers.rows)
    half = _CLEAR * (robot.wheels.radius - 2.0 * rollers.radius) * math.tan(turn)
    root = ET.Element("robot", name=robot.name)
    root.append(ET.Comment(_ABOUT))
    names = ["world", *(model.body(k).name.replace(" ", "_") for k in range(1, model.nbody))]
    for name in names:
        add(root, "link", name=name)
    links = dict(zip(names, root.iterfind("link"), strict=True))
    for k in range(1, model.nbody):
        inertial = add(links[names[k]], "inertial")
        _origin(inertial, model.body_ipos[k], Rotation.identity())
        add(inertial, "mass", value=float(model.body_mass[k]))
        R = _rotation(model.body_iquat[k]).as_matrix()
        inertia = R @ np.diag(model.body_inertia[k]) @ R.T
        elements = {f"i{a}{b}": float(inertia["xyz".index(a), "xyz".index(b)]) for a, b in _ELEMENTS}
        add(inertial, "inertia", **elements)
        first = int(model.body_jntadr[k])
        kind = "floating" if model.jnt_type[first] == _FREE else "continuous"
        joint = add(root, "joint", name=names[k], type=kind)
        add(joint, "parent", link=names[model.body_parentid[k]])
        add(joint, "child", link=names[k])
        _origin(joint, model.body_pos[k], _rotation(model.body_quat[k]))
        if kind == "continuous":
            add(joint, "axis", xyz=model.jnt_axis[first])
        if names[k].startswith("wheel"):
            add(joint, "limit", effort=drive.torque_limit, velocity=drive.top_speed)
            index = int(model.jnt_dofadr[first])
            damping, friction = float(model.dof_damping[index]), float(model.dof_frictionloss[index])
            add(joint, "dynamics", damping=damping, friction=friction)
    for k in np.flatnonzero(model.geom_bodyid).tolist():
        touches = k in model.pair_geom1 or k in model.pair_geom2
        for use in ("visual", "collision")[: 2 if touches else 1]:
            shape = add(links[names[model.geom_bodyid[k]]], use)
            kind, (radius, length, _) = model.geom_type[k], model.geom_size[k].tolist()
            turn = _rotation(model.geom_quat[k])
            if kind == _ELLIPSOID:  # of a roller; its own axis is y, a cylinder's is z
                turn, length = turn * Rotation.from_euler("x", -0.5 * math.pi), half
            _origin(shape, model.geom_pos[k], turn)
            geometry = add(shape, "geometry")
            if kind == _SPHERE:
                add(geometry, "sphere", radius=radius)
            else:
                add(geometry, "cylinder", radius=radius, length=2.0 * length)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _rotation(quaternion_wxyz: Floats) -> Rotation:
    return Rotation.from_quat(np.roll(quaternion_wxyz, -1))


def _origin(element: ET.Element, position: Floats, turn: Rotation) -> None:
    angles = turn.as_euler("xyz")
    add(element, "origin", xyz=position, rpy=angles)
