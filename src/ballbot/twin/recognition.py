"""The ball, the body and the omni-wheels among the parts of a mechanism, and the robot's parameters that they give.

The ball is the one body that floats or stands apart from the robot, has no parts and has a sphere as its shape. The
robot is what carries three or four wheels. A wheel is a hinge on the robot's body whose axis passes the ball's centre c
at the distance of a wheel, at right angles and along the ball's meridian:

    n = (p - c - ((p - c) . a) a) / |..|     towards the wheel, p on the axis a
    |a . (z x n)| small                      the axle lies in the plane of n and the vertical

Wheels of one robot have the same distance and tilt. Rollers are hinges on a wheel; they give the wheel's radius, their
own, and their rows. Without rollers the wheel touches the ball, and its radius is the distance less the ball's.
Everything else that moves with the body, such as an arm, counts as part of it, in the pose of the document.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.robot.parameters import Value
from ballbot.twin.engine import Mechanism

#: largest sine of the angle between an axle and the plane that it must lie in
_ASLANT = 0.02
#: how much distances and tilts of one robot's wheels may differ [m, rad]
_UNEQUAL, _UNEQUAL_TILT = 1e-3, 0.02
#: how much a wheel's radius by its shape or rollers may differ from the distance to the ball, over the radius
_GAP = 0.05
#: how much a ball's moments of inertia may differ, over their mean
_UNROUND = 0.01
#: offset of the centre of mass from the ball's axis that is worth a note [m]
_OFF_AXIS = 0.002
#: shapes of a wheel that show its radius, by the kind
_ROUND = ("sphere", "cylinder", "ellipsoid", "capsule")
_FEWEST_ROLLERS = 3
#: SI units; no robot's mass, inertia or size comes near
_LARGEST = 1e9
#: of an azimuth of zero [rad]
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Recognized:
    """What a mechanism states of a robot."""

    values: dict[str, Value]  #: of parameters by their dotted names; the inertia is about the ball's centre
    reflected_inertia: float  #: of rotor and gear at a wheel [kg m^2]; zero if not stated
    notes: tuple[str, ...]  #: what a robot file cannot hold, as sentences


@dataclass(frozen=True, kw_only=True, eq=False)
class _Wheel:
    joint: int
    body: int
    axis: NDArray[np.float64]  #: (3,)
    center: NDArray[np.float64]  #: (3,) from the ball's centre [m]

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.center))

    @property
    def tilt(self) -> float:
        return math.acos(max(-1.0, min(1.0, float(self.center[2]) / self.distance)))


@dataclass(frozen=True, kw_only=True)
class _WheelSize:
    radius: float
    rollers: dict[str, Value]  #: parameters of the rollers; empty if the wheel has none


def recognize(mechanism: Mechanism) -> Recognized:
    """Return the parameters of the ball-balancing robot that a mechanism is.

    Raises
    ------
    InputError
        If its ball, body or wheels cannot be recognized; the sentence says what is missing.
    """
    _check_sizes(mechanism)
    ball, ball_radius = _ball(mechanism)
    center = mechanism.centers[ball]
    wheels = _wheels(mechanism, ball, ball_radius)
    body = _root(mechanism, wheels[0].body)
    sizes = [_wheel_size(mechanism, wheel, center, ball_radius) for wheel in wheels]
    notes: list[str] = []
    values = {
        **_ball_values(mechanism, ball, ball_radius),
        **_body_values(mechanism, body, center, notes),
        **_wheel_values(mechanism, wheels, sizes, center),
        **_friction_values(mechanism, wheels),
    }
    limits = mechanism.torque_limits[[wheel.joint for wheel in wheels]]
    if np.isfinite(limits).all():
        values["drive.torque_limit"] = float(limits.min())
    armature = float(np.mean(mechanism.armatures[[wheel.joint for wheel in wheels]]))
    return Recognized(values=values, reflected_inertia=armature, notes=tuple(notes))


def _check_sizes(mechanism: Mechanism) -> None:
    """Refuse numbers with which sums of the parts would not be numbers."""
    arrays = (
        mechanism.masses,
        mechanism.centers,
        mechanism.inertias,
        mechanism.anchors,
        mechanism.shape_sizes,
    )
    if not all((np.abs(one) < _LARGEST).all() for one in arrays):
        raise InputError(f"It has a mass, an inertia or a place of {_LARGEST:g} or more.")


def _below(mechanism: Mechanism, body: int) -> list[int]:
    """Return a body and all that it carries."""
    found = {body}
    for k in range(body + 1, len(mechanism.parents)):  # a body comes after its parent
        if int(mechanism.parents[k]) in found:
            found.add(k)
    return sorted(found)


def _root(mechanism: Mechanism, body: int) -> int:
    """Return the body below the world that carries a body."""
    while mechanism.parents[body] != 0:
        body = int(mechanism.parents[body])
    return body


def _ball(mechanism: Mechanism) -> tuple[int, float]:
    """Return the ball's body and radius."""
    found = []
    for k in range(1, len(mechanism.names)):
        radii = [
            float(size[0])
            for kind, owner, size in zip(
                mechanism.shapes, mechanism.shape_bodies, mechanism.shape_sizes, strict=True
            )
            if owner == k and kind == "sphere"
        ]
        if mechanism.parents[k] == 0 and radii and _below(mechanism, k) == [k]:
            found.append((k, max(radii)))
    if len(found) != 1:
        count = "no ball" if not found else f"{len(found)} bodies that could be the ball"
        raise InputError(
            f"It has {count}: a robot's ball is the one body in the world, apart from the robot, with a sphere as its "
            "shape and without parts."
        )
    return found[0]


def _wheels(mechanism: Mechanism, ball: int, ball_radius: float) -> list[_Wheel]:
    """Return three or four wheels, in the document's order."""
    center = mechanism.centers[ball]
    moving = {int(body) for body in mechanism.joint_bodies}
    found: list[_Wheel] = []
    for joint in np.flatnonzero(mechanism.hinges).tolist():
        body, parent = (
            int(mechanism.joint_bodies[joint]),
            int(mechanism.parents[mechanism.joint_bodies[joint]]),
        )
        root = _root(mechanism, body)
        while parent not in moving and parent != 0:
            parent = int(mechanism.parents[parent])
        if root != body and parent in (root, 0):
            axis = mechanism.axes[joint]
            arm = mechanism.anchors[joint] - center
            if not any(one.body == body for one in found):  # a second hinge of a wheel is its gear's play
                found.append(_Wheel(joint=joint, body=body, axis=axis, center=arm - (arm @ axis) * axis))
    candidates = [one for one in found if one.distance > ball_radius and _is_along_meridian(one)]
    groups = (
        [
            one
            for one in candidates
            if _alike(one, first) and _root(mechanism, one.body) == _root(mechanism, first.body)
        ]
        for first in candidates
    )
    best = max(groups, key=len, default=[])
    if len(best) not in (3, 4):
        names = (
            ", ".join(mechanism.joint_names[one.joint][:40] or "without a name" for one in found[:8])
            or "none"
        )
        raise InputError(
            f"It has {len(best)} wheels on the ball, and a robot has three or four of the same tilt: hinges on the "
            "body whose axles lie at right angles to the line from the ball's centre, in the plane of that line and "
            f"the vertical (hinges on the body: {names})."
        )
    return best


def _is_along_meridian(wheel: _Wheel) -> bool:
    n = wheel.center / wheel.distance
    across = np.array([-n[1], n[0], 0.0])
    size = float(np.linalg.norm(across))
    return size > _ASLANT and abs(float(wheel.axis @ across)) / size < _ASLANT


def _alike(one: _Wheel, other: _Wheel) -> bool:
    return abs(one.distance - other.distance) < _UNEQUAL and abs(one.tilt - other.tilt) < _UNEQUAL_TILT


def _wheel_size(
    mechanism: Mechanism, wheel: _Wheel, center: NDArray[np.float64], ball_radius: float
) -> _WheelSize:
    gap = wheel.distance - ball_radius
    rollers = [
        joint
        for joint in np.flatnonzero(mechanism.hinges).tolist()
        if mechanism.parents[mechanism.joint_bodies[joint]] == wheel.body
    ]
    if len(rollers) >= _FEWEST_ROLLERS:
        size = _by_rollers(mechanism, wheel, center, rollers)
        radius, what = size.radius, "rollers"
    else:
        shapes = _radii(mechanism, wheel.body)
        size = _WheelSize(radius=gap, rollers={})
        radius, what = max(shapes, default=gap), "shape"
    if abs(radius - gap) > _GAP * gap:
        raise InputError(
            f"The wheel {_name(mechanism, wheel)} has a radius of {1e3 * radius:.4g} mm by its {what}, "
            f"but {1e3 * gap:.4g} mm lie between its axle and the ball."
        )
    return size


def _name(mechanism: Mechanism, wheel: _Wheel) -> str:
    return repr(mechanism.joint_names[wheel.joint][:40])


def _radii(mechanism: Mechanism, body: int) -> list[float]:
    """Return the radii of a body's round shapes [m]; of an ellipsoid, the smallest half axis."""
    found = []
    for kind, owner, size in zip(
        mechanism.shapes, mechanism.shape_bodies, mechanism.shape_sizes, strict=True
    ):
        if owner == body and kind in _ROUND:
            found.append(float(size.min() if kind == "ellipsoid" else size[0]))
    return found


def _by_rollers(
    mechanism: Mechanism, wheel: _Wheel, center: NDArray[np.float64], rollers: list[int]
) -> _WheelSize:
    bodies = mechanism.joint_bodies[rollers]
    places = mechanism.centers[bodies] - center - wheel.center
    along = places @ wheel.axis
    ring = float(np.mean(np.linalg.norm(places - along[:, None] * wheel.axis, axis=1)))
    radii = [radius for body in bodies.tolist() for radius in _radii(mechanism, body)]
    if not radii:
        raise InputError(
            f"The rollers of the wheel {_name(mechanism, wheel)} have no shape that shows their radius: "
            "a sphere, a cylinder, a capsule or an ellipsoid."
        )
    radius = float(np.mean(radii))
    levels = np.unique(np.round(along, 4))
    rows = len(levels)
    parts: dict[str, Value] = {
        "wheels.rollers.rows": rows,
        "wheels.rollers.per_row": len(rollers) // rows,
        "wheels.rollers.radius": radius,
    }
    if rows > 1:
        parts["wheels.rollers.row_spacing"] = float(np.ptp(along) / (rows - 1))
    return _WheelSize(radius=ring + radius, rollers=parts)


def _ball_values(mechanism: Mechanism, ball: int, radius: float) -> dict[str, Value]:
    moments = np.linalg.eigvalsh(mechanism.inertias[ball])
    mean = float(moments.mean())
    if np.ptp(moments) > _UNROUND * mean:
        raise InputError(
            f"The ball has the principal moments of inertia {', '.join(f'{one:.4g}' for one in moments)} kg m^2; they "
            "must be equal."
        )
    return {"ball.radius": radius, "ball.mass": float(mechanism.masses[ball]), "ball.inertia": mean}


def _mass_properties(
    mechanism: Mechanism, bodies: list[int], about: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return mass, centre of mass (3,) from a point, and inertia (3, 3) about that point of bodies as one."""
    masses, arms = mechanism.masses[bodies], mechanism.centers[bodies] - about
    whole = float(masses.sum())
    squares = np.einsum("bi,bi->b", arms, arms)
    points = squares[:, None, None] * np.eye(3) - np.einsum("bi,bj->bij", arms, arms)
    inertia = mechanism.inertias[bodies].sum(axis=0) + np.einsum("b,bij->ij", masses, points)
    return whole, masses @ arms / whole if whole > 0.0 else np.zeros(3), inertia


def _body_values(
    mechanism: Mechanism, body: int, center: NDArray[np.float64], notes: list[str]
) -> dict[str, Value]:
    mass, middle, inertia = _mass_properties(mechanism, _below(mechanism, body), center)
    if not mass > 0.0:
        raise InputError("The robot on the ball has no mass; its bodies need masses and inertias.")
    off = float(np.hypot(middle[0], middle[1]))
    if off > _OFF_AXIS:
        notes.append(
            f"The body's centre of mass lies {1e3 * off:.3g} mm beside the vertical through the ball's centre; a robot "
            "file has it on that line."
        )
    elements = {
        "xx": (0, 0),
        "yy": (1, 1),
        "zz": (2, 2),
        "xy": (0, 1),
        "xz": (0, 2),
        "yz": (1, 2),
    }
    parts: dict[str, Value] = {
        f"body.inertia.{name}": float(inertia[place]) for name, place in elements.items()
    }
    return {"body.mass": mass, "body.center_of_mass": float(middle[2]), **parts}


def _wheel_values(
    mechanism: Mechanism, wheels: list[_Wheel], sizes: list[_WheelSize], center: NDArray[np.float64]
) -> dict[str, Value]:
    about_axles = []
    for wheel in wheels:
        _, _, inertia = _mass_properties(mechanism, _below(mechanism, wheel.body), center + wheel.center)
        about_axles.append(float(wheel.axis @ inertia @ wheel.axis))
    for one, other in combinations(about_axles, 2):
        if abs(one - other) > _GAP * max(one, other):
            raise InputError(
                f"The wheels have different inertias, {one:.4g} and {other:.4g} kg m^2 about their axles."
            )
    # from 0 to below a turn, but for rounding
    azimuths = tuple(
        (math.atan2(wheel.center[1], wheel.center[0]) + _ROUNDING) % (2.0 * math.pi) - _ROUNDING
        for wheel in wheels
    )
    return {
        "wheels.radius": float(np.mean([one.radius for one in sizes])),
        "wheels.inertia": float(np.mean(about_axles)),
        "wheels.tilt": float(np.mean([wheel.tilt for wheel in wheels])),
        "wheels.azimuths": azimuths,
        **sizes[0].rollers,
    }


def _friction_values(mechanism: Mechanism, wheels: list[_Wheel]) -> dict[str, Value]:
    joints = [wheel.joint for wheel in wheels]
    return {
        "friction.viscous": tuple(mechanism.damping[joints].tolist()),
        "friction.coulomb": tuple(mechanism.dry_friction[joints].tolist()),
    }
