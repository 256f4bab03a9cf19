"""ROS bags, read by the library rosbags: of ROS 1 (.bag), of ROS 2 as a folder or one file (.db3, .mcap).

Messages are read by the definitions in the bag, or by those of ROS 2 if it has none. A quaternion becomes roll, pitch
and yaw. nav_msgs/Odometry has its pose in the frame of the odometry and its twist in the frame of the body: the columns
`velocity` are its linear velocity in the frame of the pose. The table has the times of the topic with the most messages
and, at each of them, the latest value of every other topic, which a controller would have. Before a topic's first
message its values are missing. Nothing is interpolated, so that the rate of a slow sensor can be seen.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log.columns import Columns
from ballbot.log.formats.json import flattened

_ODOMETRY = "nav_msgs/msg/Odometry"
#: first element of the covariance that marks a quantity as not measured, in sensor_msgs/Imu
_NOT_MEASURED = -1.0
#: by topic, the times [ns] and the numbers of its messages, in their order in the file
Topics = dict[str, tuple[list[int], list[Mapping[str, float]]]]


def read_bag(path: Path) -> Columns:
    """Return the joined topics of a bag, in one file or a folder."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics: Topics = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        types = reader.typestore.types
        known = [connection for connection in reader.connections if connection.msgtype in types]
        for connection, time, data in reader.messages(known) if known else ():
            numbers = _fields_of(reader.deserialize(data, connection.msgtype))
            times, messages = topics.setdefault(connection.topic, ([], []))
            times.append(_stamp(numbers.pop("header", None)) or time)
            cells = flattened(numbers)
            messages.append(cells | _velocity(cells) if connection.msgtype == _ODOMETRY else cells)
    return joined(topics)


def _fields_of(message: object) -> dict[str, object]:
    """Return a message's numbers as nested dicts; arrays with names are split by them."""
    values: dict[str, object] = {}
    for field in fields(message) if is_dataclass(message) else ():
        covariance = getattr(message, f"{field.name}_covariance", ())
        unknown = len(covariance) > 0 and covariance[0] == _NOT_MEASURED
        if unknown or field.name == "__msgtype__" or field.name.endswith("covariance"):
            continue
        value = getattr(message, field.name)
        if is_dataclass(value):
            values[field.name] = _fields_of(value)
        elif isinstance(value, np.ndarray):
            values[field.name] = value.tolist()
        else:
            values[field.name] = value
    if set(values) == {"x", "y", "z", "w"}:
        from ballbot.mechanics.geometry import roll_pitch_yaw

        angles = roll_pitch_yaw(*(float(getattr(message, name)) for name in "wxyz"))
        return dict(zip(("roll", "pitch", "yaw"), angles.tolist(), strict=True))
    names = values.get("name")
    if isinstance(names, list) and names:  # those of arrays, as JointState's
        del values["name"]
        for key, value in values.items():
            if isinstance(value, list) and len(value) == len(names):
                values[key] = dict(zip(map(str, names), value, strict=True))
    return values


def _velocity(odometry: Mapping[str, float]) -> dict[str, float]:
    """Return the linear velocity of an odometry's message in the frame of its pose."""
    angles = [odometry[f"pose.pose.orientation.{name}"] for name in ("yaw", "pitch", "roll")]
    linear = [odometry[f"twist.twist.linear.{axis}"] for axis in "xyz"]
    turned = Rotation.from_euler("ZYX", angles).apply(linear)
    return {f"velocity.{axis}": float(value) for axis, value in zip("xyz", turned, strict=True)}


def _stamp(header: object) -> int:
    """Return the time of measurement [ns] that a header states; zero if it states none."""
    stamp = header.get("stamp") if isinstance(header, dict) else None
    return int(stamp["sec"]) * 1_000_000_000 + int(stamp["nanosec"]) if isinstance(stamp, dict) else 0


def joined(topics: Topics) -> Columns:
    """Return one table of all topics with numbers: `t` [s] from its first row on, and `topic.field`.

    InputError if two fields get the same name.
    """
    from pandas import DataFrame

    tables = [
        DataFrame(messages, index=times, dtype=np.float64)
        .sort_index(kind="stable")
        .add_prefix(f"{topic.strip('/').replace('/', '.')}.")
        for topic, (times, messages) in topics.items()
        if any(messages)
    ]
    times = max((table.index.to_numpy() for table in tables), key=len, default=np.zeros(0, dtype=np.int64))
    columns: Columns = {"t": (times - times[0]) / 1e9} if tables else {}
    for table in tables:
        latest = np.searchsorted(table.index.to_numpy(), times, side="right") - 1
        for name in table.columns:
            if name in columns:
                raise InputError(f"two topics have a field that would be called {name[:80]!r}")
            columns[name] = np.where(latest >= 0, table[name].to_numpy()[np.maximum(latest, 0)], np.nan)
    return columns
