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

A bag of others is read by the times and names of its messages, by the definitions that it carries, or those of ROS 2 if
it has none. A quaternion is given as its roll, pitch and yaw. Topics have their own times: the table has the times of
the topic with the most messages, and the latest value of every other topic at each of them, as a controller that
listens to these topics would know. Before a topic's first message its values are missing. Nothing is interpolated, so
that a slow sensor still looks like one.
"""

from __future__ import annotations

import json
import math
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.files import write_bytes
from ballbot.log.columns import Columns, Floats
from ballbot.log.formats.json import flattened

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_NAMES, _VALUES = "/ballbot/names", "/ballbot/values"
_WORLD, _BODY = "odom", "base_link"
_ANGLES = ("theta", "phi", "psi")
#: first element of the covariance of a quantity that an IMU does not measure
_NOT_MEASURED = -1.0


def read_bag(path: Path) -> Columns:
    """Return the columns of a log, or the joined topics of another bag, in one file or a folder."""
    from rosbags.highlevel import AnyReader

    names: list[str] = []
    rows: list[Floats] = []
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
            parts = [{key: one for key, one in _fields_of(part).items() if key != "header"} for part in value]
            found[one.name] = dict(zip(frames, parts, strict=True))
        else:
            found[one.name] = value
    if set(found) == {"x", "y", "z", "w"}:
        from ballbot.mechanics.geometry import roll_pitch_yaw

        angles = roll_pitch_yaw(*(float(getattr(message, name)) for name in "wxyz"))
        return dict(zip(("roll", "pitch", "yaw"), angles.tolist(), strict=True))
    names = found.get("name")
    if isinstance(names, list) and names:  # those of arrays, as JointState's
        del found["name"]
        for key, value in found.items():
            if isinstance(value, list) and len(value) == len(names):
                found[key] = dict(zip(map(str, names), value, strict=True))
    return found


def _stamp(header: object) -> int:
    """Return the time of measurement [ns] that a header states; zero if it states none."""
    stamp = header.get("stamp") if isinstance(header, dict) else None
    if not isinstance(stamp, dict):
        return 0
    return int(stamp["sec"]) * 1_000_000_000 + int(stamp["nanosec"])


_NANOSECONDS = 1e9
#: times of files are whole nanoseconds of 63 bits
_LATEST = 2**63 - 1


@dataclass(kw_only=True)
class Topic:
    """The messages of a topic, in their order in the file."""

    name: str
    times: list[int] = field(default_factory=list[int])  #: [ns]
    messages: list[Mapping[str, float]] = field(default_factory=list[Mapping[str, float]])


def joined(topics: Iterable[Topic]) -> Columns:
    """Return one table of the messages of all topics with numbers: `t` [s] from its first row on, and `topic.field`.

    InputError if two fields get the same name.
    """
    tables = [_table(one) for one in topics if any(one.messages)]
    if not tables:
        return {}
    times = max((one for one, _ in tables), key=len)
    columns: Columns = {"t": (times - times[0]) / _NANOSECONDS}
    for own_times, own in tables:
        latest = np.searchsorted(own_times, times, side="right") - 1
        for name, values in own.items():
            if name in columns:
                raise InputError(f"two topics have a field that would be called {name[:80]!r}")
            columns[name] = np.where(latest >= 0, values[np.maximum(latest, 0)], np.nan)
    return columns


def _table(topic: Topic) -> tuple[NDArray[np.int64], Columns]:
    """Return a topic's times [ns] in ascending order and its fields, each with the topic's name before its own."""
    times = np.array(topic.times, dtype=np.int64)
    order = np.argsort(times, kind="stable")
    names = dict.fromkeys(name for message in topic.messages for name in message)
    start = topic.name.strip("/").replace("/", ".")
    fields = {
        f"{start}.{name}": np.array([message.get(name, math.nan) for message in topic.messages])[order]
        for name in names
    }
    return times[order], fields


def first_time(columns: Mapping[str, Floats]) -> float:
    """Return the time [s] that a file's clock calls zero: zero, or the log's first time if that is below zero."""
    t = columns.get("t", np.zeros(1))
    return float(np.min(t, initial=0.0, where=np.isfinite(t)))


def nanoseconds(t: Floats, *, origin: float) -> list[int]:
    """Return times [s] as whole nanoseconds after `origin` [s], within what a file can hold; missing times as zero."""
    known = np.where(np.isfinite(t), t, origin)
    return [min(max(int(one), 0), _LATEST) for one in np.rint((known - origin) * _NANOSECONDS).tolist()]


def write_ros_bag(path: Path, columns: Mapping[str, Floats]) -> None:
    """Write columns (N,) to a bag in one file, whole or not at all."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = _store()
    first = next(iter(columns.values()))
    t = columns.get("t", np.arange(len(first), dtype=np.float64))
    stamps = nanoseconds(t, origin=first_time(columns))
    kept = {topic: one for topic, one in _TOPICS.items() if any(names <= {*columns} for names in one[1])}
    try:
        with tempfile.TemporaryDirectory() as folder:
            with Writer(Path(folder) / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
                added = {
                    topic: writer.add_connection(topic, kind, typestore=store)
                    for topic, (kind, *_) in kept.items()
                }
                rows = zip(*(values.tolist() for values in columns.values()), strict=True)
                for number, (cells, stamp) in enumerate(zip(rows, stamps, strict=True)):
                    row = dict(zip(columns, cells, strict=True))
                    for topic, (kind, _, fields_of) in kept.items():
                        if number == 0 or topic != _NAMES:
                            message = _message(store, kind, fields_of(row), stamp)
                            writer.write(added[topic], stamp, store.serialize_cdr(message, kind))
            content = next(Path(folder).glob("bag/*.db3")).read_bytes()
    except (OSError, sqlite3.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path} cannot be written: {reason}.") from None
    write_bytes(path, content)


def _message(store: Typestore, kind: str, values: Mapping[str, Any], stamp: int) -> object:
    """Return a message of nested fields; those that `values` lacks are zero or empty, stamps are `stamp` [ns]."""
    filled: dict[str, Any] = {}
    definition: Any = store.fielddefs[kind][1]  # rosbags' type does not say what each node has
    for name, (node, detail) in definition:
        if name == "stamp":
            seconds, rest = divmod(stamp, 1_000_000_000)
            filled[name] = store.types[detail](sec=seconds, nanosec=rest)
        elif node.name == "NAME":
            filled[name] = _message(store, detail, values.get(name, {}), stamp)
        elif node.name == "BASE":
            filled[name] = values.get(name, "" if detail[0] == "string" else 0)
        else:
            (inner, of), length = detail
            given = values.get(name, [0.0] * length)
            if inner.name == "NAME":
                filled[name] = [_message(store, of, one, stamp) for one in given]
            else:
                filled[name] = list(given) if of[0] == "string" else np.array(given, dtype=of[0])
    return store.types[kind](**filled)


#: columns that an IMU measures, by the field of its message
_SENSED = {
    "angular_velocity": ("gyro_x", "gyro_y", "gyro_z"),
    "linear_acceleration": ("acc_x", "acc_y", "acc_z"),
    "orientation": _ANGLES,
}
_Row = Mapping[str, float]


def _vector(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def _turn(theta: float, phi: float, psi: float) -> dict[str, float]:
    from ballbot.mechanics.geometry import quaternion_of

    return dict(zip("wxyz", quaternion_of(theta, phi, psi).tolist(), strict=True))


def _pose(row: _Row) -> tuple[float, ...]:
    return tuple(row[name] for name in ("x", "y", *_ANGLES))


def _imu(row: _Row) -> dict[str, Any]:
    """Return the gyro's and the accelerometer's vectors and the attitude; what is unknown has ROS's mark."""
    found: dict[str, Any] = {"header": {"frame_id": _BODY}}
    for part, names in _SENSED.items():
        if {*names} <= {*row}:
            values = [row[name] for name in names]
            found[part] = _turn(*values) if names is _ANGLES else _vector(*values)
        else:
            found[f"{part}_covariance"] = [_NOT_MEASURED, *[0.0] * 8]
    return found


def _joints(row: _Row) -> dict[str, Any]:
    """Return the wheels' angles [rad], speeds [rad/s] and torques [N m]; a quantity without columns is empty."""
    count = sum(f"wheel{i}" in row or f"u{i}" in row for i in range(1, len(row)))
    found: dict[str, Any] = {"name": [f"wheel{i}" for i in range(1, count + 1)]}
    for part, pattern in {"position": "wheel{}", "velocity": "wheel{}_dot", "effort": "u{}"}.items():
        names = [pattern.format(i) for i in range(1, count + 1)]
        found[part] = [row[name] for name in names if name in row]
    return found


def _odometry(row: _Row) -> dict[str, Any]:
    """Return pose in `odom` and velocity in `base_link`; rates that the log has not are zero."""
    from ballbot.mechanics.geometry import body_rates_matrix, rotation

    x, y, *angles = _pose(row)
    velocity = rotation(*angles).T @ (row.get("x_dot", 0.0), row.get("y_dot", 0.0), 0.0)
    rates = body_rates_matrix(*angles) @ [row.get(f"{name}_dot", 0.0) for name in _ANGLES]
    return {
        "header": {"frame_id": _WORLD},
        "child_frame_id": _BODY,
        "pose": {"pose": {"position": _vector(x, y), "orientation": _turn(*angles)}},
        "twist": {"twist": {"linear": _vector(*velocity.tolist()), "angular": _vector(*rates.tolist())}},
    }


def _transforms(row: _Row) -> dict[str, Any]:
    """Return the body's frame in `odom`; nothing if the pose is missing, which tf2 refuses."""
    x, y, *angles = _pose(row)
    one = {
        "header": {"frame_id": _WORLD},
        "child_frame_id": _BODY,
        "transform": {"translation": _vector(x, y), "rotation": _turn(*angles)},
    }
    return {"transforms": [one] if all(map(math.isfinite, (x, y, *angles))) else []}


def _reference(row: _Row) -> dict[str, Any]:
    pose = {
        "position": _vector(row["ref_x"], row["ref_y"]),
        "orientation": _turn(0.0, 0.0, row.get("ref_psi", 0.0)),
    }
    return {"header": {"frame_id": _WORLD}, "pose": pose}


_POSE = frozenset(("x", "y", *_ANGLES))
#: by topic, the type of its messages, the sets of columns of which it needs one, and what gives a row's fields
_TOPICS: dict[str, tuple[str, tuple[Set[str], ...], Callable[[_Row], dict[str, Any]]]] = {
    _NAMES: ("std_msgs/msg/String", (set(),), lambda row: {"data": json.dumps(list(row))}),
    _VALUES: ("std_msgs/msg/Float64MultiArray", (set(),), lambda row: {"data": list(row.values())}),
    "/imu": ("sensor_msgs/msg/Imu", tuple(map(frozenset, _SENSED.values())), _imu),
    "/joint_states": ("sensor_msgs/msg/JointState", ({"wheel1"}, {"wheel1_dot"}, {"u1"}), _joints),
    "/odom": ("nav_msgs/msg/Odometry", (_POSE,), _odometry),
    "/tf": ("tf2_msgs/msg/TFMessage", (_POSE,), _transforms),
    "/reference": ("geometry_msgs/msg/PoseStamped", ({"ref_x", "ref_y"},), _reference),
}
