"""Logs as messages, in MCAP files and ROS 2 bags: what other libraries find in them, and files of others."""

import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from scipy.spatial.transform import Rotation

from ballbot.cli.main import main
from ballbot.errors import InputError
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import unit_of
from ballbot.log.formats import read_columns
from ballbot.log.formats.text import ForeignTable
from ballbot.log.mapping_search.names import read_name, roles_of
from tests.support.bags import Timed, column_messages, robot_messages, write_bag
from tests.support.log_examples import smooth_log


@pytest.fixture(scope="module")
def log() -> Log:
    """A few rows with every kind of column, one value of each kind missing."""
    base = smooth_log(rows=4)
    names = [f"{kind}_{axis}" for kind in ("gyro", "acc") for axis in "xyz"]
    names += ["wheel1", "wheel2", "wheel3", "ref_x", "ref_y", "ref_psi", "battery"]
    random = np.random.default_rng(0)
    columns = {name: random.normal(size=4) for name in names}
    columns["gyro_y"][2] = np.nan
    return base.with_columns(columns)


def test_an_mcap_file_has_the_units_of_its_columns(tmp_path, log):
    path = tmp_path / "log.mcap"
    log.write(path)
    seen: dict[str, int] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            fields, row = json.loads(message.data), seen.get(channel.topic, 0)
            properties = json.loads(schema.data)["properties"]
            assert message.log_time == round(1e9 * log.t[row])
            for name, value in fields.items():
                assert value == log[name][row]
                assert properties[name].get("unit") == unit_of(name)
            assert {name for name in properties if not np.isnan(log[name][row])} == set(fields)
            seen[channel.topic] = row + 1
    assert seen == {"/log": 4}


def test_an_mcap_file_of_others_joins_its_topics_at_the_times_of_the_quickest(tmp_path):
    path = tmp_path / "robot.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.LZ4)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        fast, slow = (writer.register_channel(one, "json", schema) for one in ("/imu", "/odom/pose"))
        packed = writer.register_channel("/image", "protobuf", schema)
        for k in range(5):
            text = json.dumps({"gyro": [k, 0.5], "name": "imu", "ok": True}).encode()
            writer.add_message(fast, 10**18 + k * 10**7, text, 0)
        for k in (1, 3):
            writer.add_message(slow, 10**18 + k * 10**7 + 1, b'{"x": %d}' % k, 0)
        writer.add_message(packed, 10**18, b"\xff", 0)
        writer.finish()
    columns = read_columns(path)
    assert list(columns) == ["t", "imu.gyro_1", "imu.gyro_2", "imu.ok", "odom.pose.x"]
    np.testing.assert_allclose(columns["t"], [0.0, 0.01, 0.02, 0.03, 0.04], atol=1e-15)
    np.testing.assert_array_equal(columns["odom.pose.x"], [np.nan, np.nan, 1.0, 1.0, 3.0])


def split_bag(folder: Path, plugin: StoragePlugin, *parts: Iterable[Timed], packed: bool = False) -> Path:
    """Write messages as a bag of two files, the names of which are not in their order."""
    bag, suffix = folder / "bag", ".mcap" if plugin is StoragePlugin.MCAP else ".db3"
    bag.mkdir()
    names = []
    for number, messages in enumerate(parts):
        part = folder / f"part_{number}"
        write_bag(part, messages, plugin=plugin)
        content = (part / f"part_{number}{suffix}").read_bytes()
        names.append(f"bag_{1 - number}{suffix}{'.zstd' if packed else ''}")
        (bag / names[-1]).write_bytes(zstandard.compress(content) if packed else content)
    text = (folder / "part_0" / "metadata.yaml").read_text()
    listed = "".join(f"\n  - bag/{name}" for name in names)  # as before version 4: with the folder's name
    text = re.sub(r"relative_file_paths:\n\s+- \S+", f"relative_file_paths:{listed}", text)
    if packed:  # as `ros2 bag record --compression-mode file`
        text = re.sub(r"compression_format: .*", "compression_format: zstd", text)
        text = re.sub(r"compression_mode: .*", "compression_mode: FILE", text)
    (bag / "metadata.yaml").write_text(text)
    return bag


def robot_bag(folder: Path, log: Log, plugin: StoragePlugin, *, packed: bool = False) -> Path:
    """Write the messages of a log's robot as such a bag."""
    halves = (robot_messages(log.select(rows)) for rows in (slice(2), slice(2, None)))
    return split_bag(folder, plugin, *halves, packed=packed)


@pytest.mark.parametrize(
    ("plugin", "packed"),
    [(StoragePlugin.SQLITE3, False), (StoragePlugin.MCAP, True)],
    ids=["db3", "mcap.zstd"],
)
def test_a_split_bag_is_read_as_one_table(tmp_path, log, plugin, packed):
    columns = read_columns(robot_bag(tmp_path, log, plugin, packed=packed))
    np.testing.assert_allclose(columns["t"], log.t - log.t[0], atol=1e-9)
    np.testing.assert_array_equal(columns["joint_states.effort.wheel2"], log["u2"])
    np.testing.assert_array_equal(columns["imu.angular_velocity.y"], log["gyro_y"])
    turns = Rotation.from_euler("XYZ", np.column_stack([log[name] for name in ("theta", "phi", "psi")]))
    angles = np.column_stack([columns[f"imu.orientation.{name}"] for name in ("yaw", "pitch", "roll")])
    np.testing.assert_allclose(angles, turns.as_euler("ZYX"), atol=1e-12)
    kinds = {read_name(name).kind for name in columns if name.startswith(("joint_states", "imu"))}
    assert kinds == {"wheel angle", "command", "attitude", "gyro"}  # as `check-log` reads them


def test_a_ros_1_bag_is_read_as_the_same_bag_of_ros_2(tmp_path, log):
    write_bag(tmp_path / "run.bag", robot_messages(log), ros=1)
    columns = read_columns(tmp_path / "run.bag")
    same = read_columns(robot_bag(tmp_path, log, StoragePlugin.SQLITE3))
    assert list(columns) == list(same)
    for name, values in columns.items():
        np.testing.assert_array_equal(values, same[name])
    for axis in "xy":
        np.testing.assert_array_equal(columns[f"odom.pose.pose.position.{axis}"], log[axis])
        np.testing.assert_allclose(columns[f"odom.velocity.{axis}"], log[f"{axis}_dot"], atol=1e-15)
    for angle in ("orientation.roll", "orientation.pitch", "orientation.yaw"):
        by_odometry, by_imu = columns[f"odom.pose.pose.{angle}"], columns[f"imu.{angle}"]
        np.testing.assert_allclose(by_odometry, by_imu, atol=1e-15)
    without_imu = {name: values for name, values in columns.items() if not name.startswith("imu")}
    for table, topic in ((columns, "imu"), (without_imu, "odom.pose.pose")):
        roles = roles_of("run.bag", ForeignTable(columns=table), 3)[1]
        assert roles.attitude == tuple(f"{topic}.orientation.{angle}" for angle in ("roll", "pitch", "yaw"))


def test_a_bag_that_lacks_something_is_refused_in_a_sentence(tmp_path, log):
    bag = robot_bag(tmp_path, log, StoragePlugin.SQLITE3)
    text = (bag / "metadata.yaml").read_text()
    (bag / "bag_0.db3").write_bytes((bag / "bag_0.db3").read_bytes()[:3000])
    for words, metadata in (
        ("it is not a complete ROS 2 bag", text),
        ("A metadata key is missing", "rosbag2_bagfile_information:\n  version: 9"),
        ("files are missing", text.replace("bag/bag_1.db3", "/etc/bag_7.db3")),
    ):
        (bag / "metadata.yaml").write_text(metadata)
        with pytest.raises(InputError, match=f"{bag} cannot be read: .*{words}"):
            read_columns(bag)


@pytest.mark.usefixtures("undrawn")
def test_commands_take_a_bag_for_a_log(tmp_path):
    log, mapping = smooth_log(rows=600), tmp_path / "mapping.toml"
    log = Log({name: log[name] for name in log if name[0] != "u"})
    messages = list(column_messages(log.columns))
    bag = str(split_bag(tmp_path, StoragePlugin.MCAP, messages[:4000], messages[4000:]))
    columns = (f'{name} = "{name if name == "t" else f"{name}.data"}"' for name in log)
    mapping.write_text("\n".join(['format = "ballbot mapping 1"', "[columns]", *columns]))
    by_mapping = ["--mapping", str(mapping)]
    assert main(["check-log", bag, *by_mapping, "--out", str(tmp_path / "checked")]) == 0
    results = json.loads((tmp_path / "checked" / "results.json").read_text())
    assert {Path(one["name"]).suffix for one in results["provenance"]["files"]} == {".mcap", ".toml", ".yaml"}
    assert main(["convert", bag, str(tmp_path / "back.csv"), *by_mapping]) == 0
    back = Log.read(tmp_path / "back.csv")
    np.testing.assert_allclose(back.t, log.t, atol=1e-12)  # in whole nanoseconds
    for name in STATE_NAMES:
        np.testing.assert_array_equal(back[name], log[name])


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_without_its_package_a_format_names_the_extra(tmp_path, monkeypatch, suffix):
    package = {".mcap": "mcap", ".db3": "rosbags"}[suffix]
    (tmp_path / f"log{suffix}").write_bytes(b"0")
    for name in [one for one in sys.modules if one.partition(".")[0] == package]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError, match=rf"files need {package}.*: pip install 'ballbot\[formats\]'"):
        Log.read(tmp_path / f"log{suffix}")
