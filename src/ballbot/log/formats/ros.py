"""ROS bags, read and written by the library rosbags: of ROS 1 (.bag), of ROS 2 as a folder or one file (.db3, .mcap).

A log is written as standard messages, and once more without loss:

/imu              sensor_msgs/Imu: gyro, accelerometer, attitude
/joint_states     sensor_msgs/JointState: wheel angles and speeds; effort has the torques
/odom             nav_msgs/Odometry: position and attitude in `odom`, velocity in `base_link`
/tf               tf2_msgs/TFMessage: `base_link` in `odom`; both have their origin at the height of the ball's centre
/reference        geometry_msgs/PoseStamped: ref_x, ref_y, ref_psi
/ballbot/names    std_msgs/String: the columns' names, a list in JSON
/ballbot/values   std_msgs/Float64MultiArray: a row of the log, from which the log is read back to the bit

A topic is left out if the log has no column for it. `ros2 bag play FILE.db3` plays such a file.

A bag of others is read by the times and names of its messages (`ballbot.log.formats.messages`), by the definitions
that it carries, or those of ROS 2 if it has none. A quaternion is given as its roll, pitch and yaw.
"""

from __future__ import annotations

import json
import math
import sqlite3
import tempfile
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.files import write_bytes
from ballbot.log.columns import Columns
from ballbot.log.formats.json import flattened
from ballbot.log.formats.messages import Topic, first_time, joined, nanoseconds

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_NAMES, _VALUES = "/ballbot/names", "/ballbot/values"
_WORLD, _BODY = "odom", "base_link"
_ANGLES = ("theta", "phi", "psi")
#: first element of the covariance of a quantity that an IMU does not measure
_NOT_MEASURED = -1.0


def read_bag(path: Path) -> Columns:
    """Return the columns of a log, or the joined topics of another bag.

    Parameters
    ----------
    path : Path
        A bag in one file (.bag of ROS 1, .db3, .mcap), or the folder of a ROS 2 bag.
    """
    from rosbags.highlevel import AnyReader

    names: list[str] = []
    rows: list[NDArray[np.float64]] = []
    topics: dict[str, Topic] = {}
    with AnyReader([path], default_typestore=_store()) as reader:
        known = [one for one in reader.connections if one.msgtype in reader.typestore.types]
        for connection, time, data in reader.messages(known) if known else ():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic in (_NAMES, _VALUES):
                content = getattr(message, "data")  # noqa: B009 - the class is made by rosbags
                if connection.topic == _NAMES:
                    names = names or [str(one) for one in json.loads(content)]
                else:
                    rows.append(content)
                continue
            fields_ = _fields_of(message)
            stamp = _stamp(fields_.pop("header", None))
            topic = topics.setdefault(connection.topic, Topic(name=connection.topic))
            topic.times.append(stamp or time)
            topic.messages.append(flattened(fields_))
    if names:
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(names))
        return {name: np.ascontiguousarray(column) for name, column in zip(names, table.T, strict=True)}
    return joined(topics.values())


@cache
def _store() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def _fields_of(message: object) -> dict[str, object]:
    """Return a message's numbers as nested dicts; arrays that have names are told apart by these."""
    found: dict[str, object] = {}
    for one in fields(message) if is_dataclass(message) else ():
        if one.name == "__msgtype__" or one.name.endswith("covariance"):
            continue
        value = getattr(message, one.name)
        covariance = getattr(message, f"{one.name}_covariance", None)
        if covariance is not None and len(covariance) and covariance[0] == _NOT_MEASURED:
            continue
        if is_dataclass(value):
            found[one.name] = _fields_of(value)
        elif isinstance(value, np.ndarray):
            found[one.name] = value.tolist()
        elif isinstance(value, list) and value and is_dataclass(value[0]):
            frames = [getattr(part, "child_frame_id", "") or str(k) for k, part in enumerate(value, start=1)]
            parts = [
                {key: field for key, field in _fields_of(part).items() if key != "header"} for part in value
            ]
            found[one.name] = dict(zip(frames, parts, strict=True))
        else:
            found[one.name] = value
    if set(found) == {"x", "y", "z", "w"}:
        from ballbot.mechanics.geometry import roll_pitch_yaw

        angles = roll_pitch_yaw(*(float(getattr(message, name)) for name in "wxyz"))
        return dict(zip(("roll", "pitch", "yaw"), angles.tolist(), strict=True))
    return _by_given_names(found)


def _by_given_names(message: dict[str, object]) -> dict[str, object]:
    """Return a message whose arrays have the names in its list `name`, as those of JointState."""
    names = message.get("name")
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
        return message
    return {
        key: dict(zip(names, value, strict=True)) if isinstance(value, list) and len(value) == len(names) else value
        for key, value in message.items()
        if key != "name"
    }  # fmt: skip


def _stamp(header: object) -> int:
    """Return the time of measurement [ns] that a header states; zero if it states none."""
    stamp = header.get("stamp") if isinstance(header, dict) else None
    if not isinstance(stamp, dict):
        return 0
    return int(stamp["sec"]) * 1_000_000_000 + int(stamp["nanosec"])


def write_ros_bag(path: Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) to a bag in one file, whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = _store()
    first = next(iter(columns.values()))
    t = columns.get("t", np.arange(len(first), dtype=np.float64))
    stamps = nanoseconds(t, origin=first_time(columns))
    try:
        with tempfile.TemporaryDirectory() as folder:
            with Writer(Path(folder) / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
                topics = {
                    topic: (writer.add_connection(topic, kind, typestore=store), kind)
                    for topic, kind in _kinds(columns).items()
                }
                rows = zip(*(values.tolist() for values in columns.values()), strict=True)
                for number, (cells, stamp) in enumerate(zip(rows, stamps, strict=True)):
                    row = _Row(store, dict(zip(columns, cells, strict=True)), stamp)
                    makers = _MAKERS if number else {_NAMES: _Row.names, **_MAKERS}
                    for topic in makers.keys() & topics.keys():
                        connection, kind = topics[topic]
                        writer.write(connection, stamp, store.serialize_cdr(makers[topic](row), kind))
            content = next(Path(folder).glob("bag/*.db3")).read_bytes()
    except (OSError, sqlite3.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path} cannot be written: {reason}.") from None
    write_bytes(path, content)


def _kinds(columns: Mapping[str, object]) -> dict[str, str]:
    """Return the topics that a log with these columns has, with the types of their messages."""
    pose = {"x", "y", *_ANGLES} <= set(columns)
    wheels = {"wheel1", "wheel1_dot", "u1"} & set(columns)
    sensed = [one for one in _SENSED if _has(columns, one)]
    kinds = {
        "/imu": "sensor_msgs/msg/Imu" if sensed else "",
        "/joint_states": "sensor_msgs/msg/JointState" if wheels else "",
        "/odom": "nav_msgs/msg/Odometry" if pose else "",
        "/tf": "tf2_msgs/msg/TFMessage" if pose else "",
        "/reference": "geometry_msgs/msg/PoseStamped" if {"ref_x", "ref_y"} <= set(columns) else "",
        _NAMES: "std_msgs/msg/String",
        _VALUES: "std_msgs/msg/Float64MultiArray",
    }
    return {topic: kind for topic, kind in kinds.items() if kind}


#: columns that an IMU measures, by the field of its message
_SENSED = {
    "angular_velocity": ("gyro_x", "gyro_y", "gyro_z"),
    "linear_acceleration": ("acc_x", "acc_y", "acc_z"),
    "orientation": _ANGLES,
}


def _has(columns: Mapping[str, object], field: str) -> bool:
    return set(_SENSED[field]) <= set(columns)


class _Row:
    """A row of a log, from which messages are made."""

    def __init__(self, store: Typestore, row: Mapping[str, float], stamp: int) -> None:
        self._store, self._row = store, row
        seconds, rest = divmod(stamp, 1_000_000_000)
        self._time = self._make("builtin_interfaces/msg/Time", {"sec": seconds, "nanosec": rest})
        self._angles = tuple(row.get(name, math.nan) for name in _ANGLES)

    def _make(self, kind: str, fields: Mapping[str, object]) -> object:
        return self._store.types[kind](**fields)  # pyright: ignore[reportArgumentType]

    def _header(self, frame: str) -> object:
        return self._make("std_msgs/msg/Header", {"stamp": self._time, "frame_id": frame})

    def _vector(self, x: float, y: float, z: float, *, kind: str = "Vector3") -> object:
        return self._make(f"geometry_msgs/msg/{kind}", {"x": x, "y": y, "z": z})

    def _turn(self, theta: float, phi: float, psi: float) -> object:
        from ballbot.mechanics.geometry import quaternion_of

        w, x, y, z = quaternion_of(theta, phi, psi).tolist()
        return self._make("geometry_msgs/msg/Quaternion", {"x": x, "y": y, "z": z, "w": w})

    def _pose(self, x: float, y: float, turn: object) -> object:
        place = self._vector(x, y, 0.0, kind="Point")
        return self._make("geometry_msgs/msg/Pose", {"position": place, "orientation": turn})

    def imu(self) -> object:
        """Return the gyro's and the accelerometer's vectors and the attitude; what is unknown has ROS's mark."""
        found: dict[str, object] = {"header": self._header(_BODY)}
        for field, names in _SENSED.items():
            known = all(name in self._row for name in names)
            values = [self._row.get(name, 0.0) for name in names]
            found[field] = self._turn(*values) if field == "orientation" else self._vector(*values)
            found[f"{field}_covariance"] = np.array([0.0 if known else _NOT_MEASURED] + [0.0] * 8)
        return self._make("sensor_msgs/msg/Imu", found)

    def joints(self) -> object:
        """Return the wheels' angles [rad], speeds [rad/s] and torques [N m]; a quantity without columns is empty."""
        count = sum(f"wheel{i}" in self._row or f"u{i}" in self._row for i in range(1, len(self._row)))
        numbers = range(1, count + 1)

        def values(pattern: str) -> NDArray[np.float64]:
            names = [pattern.format(i) for i in numbers]
            return np.array([self._row[name] for name in names if name in self._row])

        arrays = {"position": "wheel{}", "velocity": "wheel{}_dot", "effort": "u{}"}
        found = {field: values(pattern) for field, pattern in arrays.items()}
        named = {"header": self._header(""), "name": [f"wheel{i}" for i in numbers]}
        return self._make("sensor_msgs/msg/JointState", named | found)

    def odometry(self) -> object:
        """Return pose in `odom` and velocity in `base_link`; rates that the log has not are zero."""
        from ballbot.mechanics.geometry import body_rates_matrix, rotation

        row = self._row
        velocity = rotation(*self._angles).T @ (row.get("x_dot", 0.0), row.get("y_dot", 0.0), 0.0)
        rates = body_rates_matrix(*self._angles) @ [row.get(f"{name}_dot", 0.0) for name in _ANGLES]
        twist = {"linear": self._vector(*velocity.tolist()), "angular": self._vector(*rates.tolist())}
        pose = self._pose(row["x"], row["y"], self._turn(*self._angles))
        unknown = np.zeros(36)
        parts: dict[str, object] = {
            "pose": self._make("geometry_msgs/msg/PoseWithCovariance", {"pose": pose, "covariance": unknown}),
            "twist": self._make(
                "geometry_msgs/msg/TwistWithCovariance",
                {"twist": self._make("geometry_msgs/msg/Twist", twist), "covariance": unknown},
            ),
        }
        return self._make(
            "nav_msgs/msg/Odometry", {"header": self._header(_WORLD), "child_frame_id": _BODY, **parts}
        )

    def transforms(self) -> object:
        """Return the body's frame in `odom`; nothing if the pose is missing, which tf2 refuses."""
        pose = (self._row["x"], self._row["y"], *self._angles)
        known = all(map(math.isfinite, pose))
        place = self._vector(pose[0], pose[1], 0.0)
        transform = {"translation": place, "rotation": self._turn(*self._angles)}
        one = {
            "header": self._header(_WORLD),
            "child_frame_id": _BODY,
            "transform": self._make("geometry_msgs/msg/Transform", transform),
        }
        stamped = [self._make("geometry_msgs/msg/TransformStamped", one)] if known else []
        return self._make("tf2_msgs/msg/TFMessage", {"transforms": stamped})

    def reference(self) -> object:
        """Return the pose to hold."""
        turn = self._turn(0.0, 0.0, self._row.get("ref_psi", 0.0))
        pose = self._pose(self._row["ref_x"], self._row["ref_y"], turn)
        return self._make("geometry_msgs/msg/PoseStamped", {"header": self._header(_WORLD), "pose": pose})

    def values(self) -> object:
        """Return the whole row."""
        layout = self._make("std_msgs/msg/MultiArrayLayout", {"dim": [], "data_offset": 0})
        data = np.array(list(self._row.values()))
        return self._make("std_msgs/msg/Float64MultiArray", {"layout": layout, "data": data})

    def names(self) -> object:
        """Return the columns' names."""
        return self._make("std_msgs/msg/String", {"data": json.dumps(list(self._row))})


#: what makes the messages of each topic
_MAKERS = {
    _VALUES: _Row.values,
    "/imu": _Row.imu,
    "/joint_states": _Row.joints,
    "/odom": _Row.odometry,
    "/tf": _Row.transforms,
    "/reference": _Row.reference,
}
