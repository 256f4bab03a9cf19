"""A server for Foxglove, and for PlotJuggler's Foxglove Bridge, by the Foxglove SDK (`ballbot.link.stream`)."""

import json
import logging
import math
from collections.abc import Sequence

import foxglove
from foxglove.channels import FrameTransformsChannel, LogChannel, SceneUpdateChannel
from foxglove.messages import (
    Color,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    Log,
    LogLevel,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    Timestamp,
    Vector3,
)
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log.formats.mcap import LOG_TOPIC, log_schema
from ballbot.robot import Robot
from ballbot.robot.drawing import body_shape

#: between two poses, and between two pictures of the robot for clients that come later [ns]
_POSE, _PICTURE = 20_000_000, 1_000_000_000
_UPRIGHT = Quaternion(w=1.0)


class FoxgloveServer:
    """Channels that clients can only read; a client that reads too slowly loses its oldest messages.

    InputError if the port is used, or the host is not this computer.
    """

    def __init__(self, host: str, port: int, columns: Sequence[str], described: Robot | None) -> None:
        foxglove.set_log_level(logging.ERROR)
        self._context = context = foxglove.Context()  # its channels end with it
        try:
            self._server = foxglove.start_server(name="ballbot", host=host, port=port, context=context)
        except RuntimeError as error:
            reason = str(error).rpartition(": ")[2].partition(" (os error")[0]
            raise InputError(
                f"A server at ws://{host}:{port} cannot be opened: {reason}. Give another address to --stream."
            ) from None
        described_row = json.dumps(log_schema(columns)).encode()
        schema = foxglove.Schema(name="ballbot.log", encoding="jsonschema", data=described_row)
        self._log = foxglove.Channel(LOG_TOPIC, message_encoding="json", schema=schema, context=context)
        self._events = LogChannel("/events", context=context)
        self._frames = FrameTransformsChannel("/tf", context=context)
        self._scene = SceneUpdateChannel("/scene", context=context)
        self._described, self._last_pose, self._last_picture = described, 0, 0

    def send_row(self, time: int, message: bytes, pose: Sequence[float]) -> None:
        """Send a row, and the pose if the last one is old."""
        self._log.log(message, log_time=time)
        if time - self._last_pose < _POSE or not all(map(math.isfinite, pose)):
            return
        self._last_pose = time
        self._frames.log(self._transforms(time, pose), log_time=time)
        if self._described is not None and time - self._last_picture >= _PICTURE:
            self._last_picture = time
            self._scene.log(_picture(self._described, time), log_time=time)

    def send_event(self, time: int, text: str) -> None:
        """Send a sentence on what happened."""
        message = Log(timestamp=_stamp(time), level=LogLevel.Info, message=text, name="ballbot")
        self._events.log(message, log_time=time)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    def _transforms(self, time: int, pose: Sequence[float]) -> FrameTransforms:
        """Return the frame of the ball, which does not turn, in the world, and that of the body in the ball's."""
        x, y, *angles = pose
        height = self._described.ball.radius if self._described else 0.0
        i, j, k, w = Rotation.from_euler("XYZ", angles).as_quat().tolist()
        frames = (
            ("world", "ball", Vector3(x=x, y=y, z=height), _UPRIGHT),
            ("ball", "body", Vector3(), Quaternion(x=i, y=j, z=k, w=w)),
        )
        return FrameTransforms(
            transforms=[
                FrameTransform(
                    timestamp=_stamp(time),
                    parent_frame_id=parent,
                    child_frame_id=child,
                    translation=translation,
                    rotation=rotation,
                )
                for parent, child, translation, rotation in frames
            ]
        )


def _picture(robot: Robot, time: int) -> SceneUpdate:
    """Return the ball as a sphere in its frame, and the outline of the body as a cylinder in the body's."""
    shape, width = body_shape(robot.body), 2.0 * robot.ball.radius
    ball = SpherePrimitive(
        pose=Pose(position=Vector3(), orientation=_UPRIGHT),
        size=Vector3(x=width, y=width, z=width),
        color=Color(r=0.9, g=0.5, b=0.1, a=1.0),
    )
    body = CylinderPrimitive(
        pose=Pose(position=Vector3(z=0.5 * (shape.bottom + shape.top)), orientation=_UPRIGHT),
        size=Vector3(x=2.0 * shape.radius, y=2.0 * shape.radius, z=shape.top - shape.bottom),
        bottom_scale=1.0,
        top_scale=1.0,
        color=Color(r=0.3, g=0.4, b=0.6, a=0.6),
    )
    stamp = _stamp(time)
    return SceneUpdate(
        entities=[
            SceneEntity(timestamp=stamp, frame_id="ball", id="ball", frame_locked=True, spheres=[ball]),
            SceneEntity(timestamp=stamp, frame_id="body", id="body", frame_locked=True, cylinders=[body]),
        ]
    )


def _stamp(time: int) -> Timestamp:
    return Timestamp(*divmod(time, 1_000_000_000))
