"""The robot, its ball and its wheels as topics of an MCAP file, for the 3D panel of Foxglove.

/scene       foxglove.SceneUpdate: every shape once, each locked to its frame
/tf          foxglove.FrameTransforms: where the frames are, at most 50 times a second

    world                 z = 0 is the floor
    |- ball               origin at the ball's centre; turns with the ball
    |- body               origin at the ball's centre
    |  `- wheel 1 ..      origin at the wheel's centre, z along the hinge; turns with the wheel
    `- reference          on the floor, if the log has one

The motion is that of `ballbot.viewer.motion`. A robot file does not describe the body's shape: it is a cylinder of the
size that `ballbot.robot.drawing` gives it. Foxglove knows messages by the names of their schemas; the fields are those
of its documentation (docs.foxglove.dev, message schemas).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names
from ballbot.log.formats import written_format
from ballbot.log.formats.mcap import Channel, write_mcap
from ballbot.log.formats.messages import first_time, nanoseconds
from ballbot.robot import Robot
from ballbot.robot.drawing import BodyShape, WheelShape, wheel_shapes
from ballbot.viewer.motion import Motion, motion_of
from ballbot.viewer.page import shown_body

#: a tenth of a millimetre and a hundredth of a degree are finer than a picture shows
_DIGITS = 6
_BLUE, _LIGHT, _GREY, _DARK, _GREEN = (
    (0.20, 0.36, 0.70, 1.0),
    (0.93, 0.95, 1.0, 1.0),
    (0.60, 0.62, 0.66, 0.55),
    (0.18, 0.19, 0.22, 1.0),
    (0.16, 0.60, 0.36, 1.0),
)
_STRIP, _LOOP = 0, 1  # kinds of lines

Color = tuple[float, float, float, float]
Message = dict[str, object]


def write_with_scene(path: str | Path, log: Log, robot: Robot | None) -> str:
    """Write a log in the format of the suffix of `path`; an MCAP file also shows the robot, if it can be shown.

    Parameters
    ----------
    path : str or Path
    log : Log
    robot : Robot, optional

    Returns
    -------
    str
        Why an MCAP file shows no robot, as a sentence; empty if it does, or if the file is another.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    reason = ""
    channels: tuple[Channel, ...] = ()
    if written_format(path).write is write_mcap:
        if robot is None:
            reason = "The file has no 3-D scene, because the robot is not known. Name it with --robot."
        else:
            try:
                channels = scene_channels(log, robot)
            except InputError as error:
                reason = f"The file has no 3-D scene. {error}"
    if channels:
        write_mcap(Path(path), log.columns, channels)
    else:
        log.write(path)
    return reason


def scene_channels(log: Log, robot: Robot) -> tuple[Channel, ...]:
    """Return the topics of a log of a balancing robot.

    Raises
    ------
    InputError
        If the log cannot be shown (`ballbot.viewer.motion.motion_of`).
    """
    motion, wheels = motion_of(log, robot), wheel_shapes(robot)
    t = log.t[0] + motion.interval * np.arange(motion.rows)
    times = [_time(one) for one in nanoseconds(t, origin=first_time(log.columns))]
    scene: Message = {"deletions": [], "entities": list(_entities(motion, robot, wheels, times[0]))}
    transforms = _transforms(motion, robot, wheels)
    return (
        Channel(topic="/scene", schema="foxglove.SceneUpdate", definition=_SCENE, t=t[:1], messages=[scene]),
        Channel(
            topic="/tf",
            schema="foxglove.FrameTransforms",
            definition=_TRANSFORMS,
            t=t,
            messages=[
                {"transforms": [{"timestamp": time, **one[row]} for one in transforms]}
                for row, time in enumerate(times)
            ],
        ),
    )


def _time(nanoseconds: int) -> Message:
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return {"sec": seconds, "nsec": rest}


def _transforms(motion: Motion, robot: Robot, wheels: Sequence[WheelShape]) -> list[list[Message]]:
    """Return the frames, each as its transforms (K) without their times."""
    from scipy.spatial.transform import Rotation

    columns, zero = motion.columns, np.zeros(motion.rows)
    centre = np.column_stack((columns["x"], columns["y"], zero + robot.ball.radius))
    attitude = Rotation.from_euler(
        "XYZ", np.column_stack([columns[name] for name in ("theta", "phi", "psi")])
    )
    turned = np.column_stack([columns[f"ball_{name}"] for name in "xyzw"])
    frames = [
        _frame("world", "ball", centre, turned),
        _frame("world", "body", centre, attitude.as_quat()),
    ]
    for number, (shape, name) in enumerate(zip(wheels, wheel_angle_names(len(wheels)), strict=True), start=1):
        mounted = Rotation.from_matrix(np.column_stack((-shape.contact, shape.rolling, -shape.axle)))
        turns = (mounted * Rotation.from_euler("z", columns[name][:, None])).as_quat()
        places = np.broadcast_to(shape.center, (motion.rows, 3))
        frames.append(_frame("body", f"wheel {number}", places, turns))
    if "ref_x" in columns:
        heading = Rotation.from_euler("z", columns.get("ref_psi", zero)[:, None]).as_quat()
        places = np.column_stack((columns["ref_x"], columns["ref_y"], zero))
        frames.append(_frame("world", "reference", places, heading))
    return frames


def _frame(
    parent: str, child: str, places: NDArray[np.float64], quaternions: NDArray[np.float64]
) -> list[Message]:
    return [
        {
            "parent_frame_id": parent,
            "child_frame_id": child,
            "translation": _vector(place),
            "rotation": dict(zip("xyzw", turn, strict=True)),
        }
        for place, turn in zip(
            np.round(places, _DIGITS).tolist(), np.round(quaternions, _DIGITS).tolist(), strict=True
        )
    ]


def _entities(motion: Motion, robot: Robot, wheels: Sequence[WheelShape], time: Message) -> Iterator[Message]:
    columns, ball = motion.columns, robot.ball.radius
    rings = [
        _line(_ring(1.002 * ball, first, second), _LIGHT, 0.03 * ball, kind=_LOOP)
        for first, second in _PLANES
    ]
    yield _entity("ball", "ball", time, spheres=[_sphere(ball)], lines=rings)
    yield _entity("body", "body", time, cylinders=[_body(shown_body(robot))])
    rollers = robot.wheels.rollers
    width = (rollers.rows - 1) * rollers.row_spacing + 2.0 * rollers.radius
    wheel = _cylinder(robot.wheels.radius, width, 0.0, _DARK)
    face = 0.51 * width
    spoke = np.array([[-robot.wheels.radius, 0.0, face], [robot.wheels.radius, 0.0, face]])
    for number in range(1, len(wheels) + 1):
        line = _line(spoke, _LIGHT, 0.1 * robot.wheels.radius, kind=_STRIP)
        yield _entity(f"wheel {number}", f"wheel {number}", time, cylinders=[wheel], lines=[line])
    path = np.column_stack((columns["x"], columns["y"], np.full(motion.rows, 0.001)))
    yield _entity("path", "world", time, lines=[_line(path, _BLUE, 0.05 * ball, kind=_STRIP)])
    if "ref_x" in columns:
        wanted = np.column_stack((columns["ref_x"], columns["ref_y"], np.full(motion.rows, 0.0005)))
        yield _entity(
            "reference path", "world", time, lines=[_line(wanted, _GREEN, 0.05 * ball, kind=_STRIP)]
        )
        mark = _cylinder(0.3 * ball, 0.004, 0.002, _GREEN)
        yield _entity("reference", "reference", time, cylinders=[mark])


#: axes of the great circles on the ball
_PLANES = ((0, 1), (1, 2), (2, 0))


def _ring(radius: float, first: int, second: int) -> NDArray[np.float64]:
    """Return a circle (n, 3) about the origin in the plane of two axes."""
    angle = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
    points = np.zeros((len(angle), 3))
    points[:, first], points[:, second] = radius * np.cos(angle), radius * np.sin(angle)
    return points


def _entity(
    name: str,
    frame: str,
    time: Message,
    *,
    spheres: Sequence[Message] = (),
    cylinders: Sequence[Message] = (),
    lines: Sequence[Message] = (),
) -> Message:
    others: Message = {kind: [] for kind in ("metadata", "arrows", "cubes", "triangles", "texts", "models")}
    shapes: Message = {"spheres": list(spheres), "cylinders": list(cylinders), "lines": list(lines)}
    kept: Message = {"lifetime": {"sec": 0, "nsec": 0}, "frame_locked": True}
    return {"timestamp": time, "frame_id": frame, "id": name, **kept, **others, **shapes}


def _sphere(radius: float) -> Message:
    return {"pose": _pose(0.0), "size": _vector([2.0 * radius] * 3), "color": _color(_BLUE)}


def _body(shape: BodyShape) -> Message:
    return _cylinder(shape.radius, shape.top - shape.bottom, 0.5 * (shape.top + shape.bottom), _GREY)


def _cylinder(radius: float, length: float, height: float, color: Color) -> Message:
    size = _vector([2.0 * radius, 2.0 * radius, length])
    return {
        "pose": _pose(height),
        "size": size,
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": _color(color),
    }


def _line(points: NDArray[np.float64], color: Color, thickness: float, *, kind: int) -> Message:
    listed = [_vector(one) for one in np.round(points, _DIGITS).tolist()]
    drawn: Message = {
        "thickness": thickness,
        "scale_invariant": False,
        "points": listed,
        "color": _color(color),
    }
    return {"type": kind, "pose": _pose(0.0), **drawn, "colors": [], "indices": []}


def _pose(height: float) -> Message:
    upright: Message = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    return {"position": _vector([0.0, 0.0, height]), "orientation": upright}


def _vector(values: Sequence[float]) -> Message:
    return dict(zip("xyz", values, strict=True))


def _color(color: Color) -> Message:
    return dict(zip("rgba", color, strict=True))


def _record(title: str, properties: Mapping[str, object]) -> Message:
    return {"title": title, "type": "object", "properties": dict(properties)}


def _list(items: object) -> Message:
    return {"type": "array", "items": items}


_NUMBER: Message = {"type": "number"}
_TEXT: Message = {"type": "string"}
_WHOLE: Message = {"type": "integer"}
_TIME = _record("time", {"sec": _WHOLE, "nsec": _WHOLE})
_VECTOR = _record("foxglove.Vector3", dict.fromkeys("xyz", _NUMBER))
_POINT = _record("foxglove.Point3", dict.fromkeys("xyz", _NUMBER))
_TURN = _record("foxglove.Quaternion", dict.fromkeys("xyzw", _NUMBER))
_POSE = _record("foxglove.Pose", {"position": _VECTOR, "orientation": _TURN})
_COLOR = _record("foxglove.Color", dict.fromkeys("rgba", _NUMBER))
_SHAPE = {"pose": _POSE, "size": _VECTOR, "color": _COLOR}
_TAPERED = {**_SHAPE, "bottom_scale": _NUMBER, "top_scale": _NUMBER}
_LINE = {
    "type": _WHOLE,
    "pose": _POSE,
    "thickness": _NUMBER,
    "scale_invariant": {"type": "boolean"},
    "points": _list(_POINT),
    "color": _COLOR,
    "colors": _list(_COLOR),
    "indices": _list(_WHOLE),
}
_ENTITY = {
    "timestamp": _TIME,
    "frame_id": _TEXT,
    "id": _TEXT,
    "lifetime": _record("duration", {"sec": _WHOLE, "nsec": _WHOLE}),
    "frame_locked": {"type": "boolean"},
    "spheres": _list(_record("foxglove.SpherePrimitive", _SHAPE)),
    "cylinders": _list(_record("foxglove.CylinderPrimitive", _TAPERED)),
    "lines": _list(_record("foxglove.LinePrimitive", _LINE)),
}
_SCENE = _record("foxglove.SceneUpdate", {"entities": _list(_record("foxglove.SceneEntity", _ENTITY))})
_TRANSFORM = {
    "timestamp": _TIME,
    "parent_frame_id": _TEXT,
    "child_frame_id": _TEXT,
    "translation": _VECTOR,
    "rotation": _TURN,
}
_TRANSFORMS = _record(
    "foxglove.FrameTransforms", {"transforms": _list(_record("foxglove.FrameTransform", _TRANSFORM))}
)
