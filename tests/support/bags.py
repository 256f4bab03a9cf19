"""ROS bags for tests: a topic for each column of a log, and the messages of an IMU, of joints and of an odometry."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from ballbot.log import Log

STORE, STORE_1 = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
#: topic, time [ns] and message
Timed = tuple[str, int, Any]


def write_bag(
    path: Path, messages: Iterable[Timed], *, ros: int = 2, plugin: StoragePlugin = StoragePlugin.SQLITE3
) -> None:
    """Write messages of ROS 2 as a bag of ROS 1, a file, or of ROS 2, a folder."""
    store, connections = STORE_1 if ros == 1 else STORE, {}
    bag = rosbag2.Writer(path, version=9, storage_plugin=plugin) if ros == 2 else rosbag1.Writer(path)
    with bag as writer:
        for topic, time, one in messages:
            kind = one.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            data = STORE.serialize_cdr(one, kind)
            writer.write(connections[topic], time, STORE.cdr_to_ros1(data, kind) if ros == 1 else data)


def column_messages(columns: Mapping[str, np.ndarray]) -> Iterator[Timed]:
    """Yield a message for each value of a log, on a topic of its column's name; rows are from time zero on."""
    for row, t in enumerate(columns["t"]):
        for name in [name for name in columns if name != "t"]:
            cell = message("std_msgs/Float64", data=float(columns[name][row]))
            yield f"/{name}", round(1e9 * (t - columns["t"][0])), cell


def robot_messages(log: Log) -> Iterator[Timed]:
    """Yield the messages of an IMU, of three joints and of an odometry for each row of a log, all with their stamps.

    The odometry is as REP 105 has it: the pose in the frame odom, the twist in that of the body.
    """
    for row in range(len(log)):
        at, still = {name: float(log[name][row]) for name in log}, vector("Vector3", 0.0, 0.0, 0.0)
        time = round(1e9 * at["t"])
        stamp = message("builtin_interfaces/Time", sec=time // 10**9, nanosec=time % 10**9)
        header = message("std_msgs/Header", stamp=stamp, frame_id="base_link")
        body = Rotation.from_euler("XYZ", [at["theta"], at["phi"], at["psi"]])
        turn, place = vector("Quaternion", *body.as_quat()), vector("Point", at["x"], at["y"], 0.0)
        velocity = body.inv().apply([at["x_dot"], at["y_dot"], 0.0])
        pose = message("geometry_msgs/Pose", position=place, orientation=turn)
        twist = message("geometry_msgs/Twist", linear=vector("Vector3", *velocity), angular=still)
        yield "/imu", time, message(
            "sensor_msgs/Imu",
            header=header,
            orientation=turn,
            orientation_covariance=np.zeros(9),
            angular_velocity=vector("Vector3", *(at[f"gyro_{axis}"] for axis in "xyz")),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=still,
            linear_acceleration_covariance=np.array([-1.0, *[0.0] * 8]),  # not measured
        )  # fmt: skip
        yield "/joint_states", time, message(
            "sensor_msgs/JointState",
            header=header,
            name=["wheel1", "wheel2", "wheel3"],
            position=log.wheel_angles[row],
            velocity=np.zeros(0),
            effort=log.torques[row],
        )  # fmt: skip
        yield "/odom", time, message(
            "nav_msgs/Odometry",
            header=header,
            child_frame_id="base_link",
            pose=message("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=message("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )  # fmt: skip


def message(kind: str, **values: object) -> Any:
    """Return a message, such as of std_msgs/String."""
    return STORE.types[kind.replace("/", "/msg/")](**values)


def vector(kind: str, *values: float) -> Any:
    """Return a message of numbers x, y, z and, of a quaternion, w."""
    return STORE.types[f"geometry_msgs/msg/{kind}"](*values)
