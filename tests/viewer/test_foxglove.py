"""The scene of an MCAP file: messages as Foxglove documents them, and frames that roll on one another."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from ballbot.cli.main import main
from ballbot.log import Log
from ballbot.mechanics.geometry import contact_directions, rolling_directions
from ballbot.robot import Robot
from ballbot.viewer.foxglove import write_with_scene
from tests.support.log_examples import smooth_log, with_wheels

ALTEN = Robot.load("alten")
#: fields of the messages (docs.foxglove.dev/docs/visualization/message-schemas)
FIELDS = {
    "SceneUpdate": {"deletions", "entities"},
    "SceneEntity": {
        "timestamp", "frame_id", "id", "lifetime", "frame_locked", "metadata", "arrows", "cubes", "spheres",
        "cylinders", "lines", "triangles", "texts", "models",
    },
    "SpherePrimitive": {"pose", "size", "color"},
    "CylinderPrimitive": {"pose", "size", "bottom_scale", "top_scale", "color"},
    "LinePrimitive": {"type", "pose", "thickness", "scale_invariant", "points", "color", "colors", "indices"},
    "FrameTransforms": {"transforms"},
    "FrameTransform": {"timestamp", "parent_frame_id", "child_frame_id", "translation", "rotation"},
    "Pose": {"position", "orientation"},
    "Vector3": {"x", "y", "z"},
    "Point3": {"x", "y", "z"},
    "Quaternion": {"x", "y", "z", "w"},
    "Color": {"r", "g", "b", "a"},
}  # fmt: skip
KINDS = {"object": dict, "array": list, "string": str, "number": float, "integer": int, "boolean": bool}


def check(value, schema) -> None:
    """Check a message against its schema, and its fields against the documented ones."""
    assert isinstance(value, KINDS[schema["type"]]), (value, schema)
    if schema["type"] == "array":
        for one in value:
            check(one, schema["items"])
    elif schema["type"] == "object":
        if schema["title"].startswith("foxglove."):
            assert set(value) == FIELDS[schema["title"].removeprefix("foxglove.")]
        assert set(schema["properties"]) <= set(value)
        for name, one in schema["properties"].items():
            check(value[name], one)


def topics(path: Path) -> dict[str, list]:
    found: dict[str, list] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            content = json.loads(message.data)
            if schema.name.startswith("foxglove."):
                check(content, json.loads(schema.data))
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def of_frame(messages: list, name: str) -> tuple[np.ndarray, Rotation]:
    """Return places (K, 3) and orientations (K) of a frame in its parent."""
    ones = [next(t for t in content["transforms"] if t["child_frame_id"] == name) for _, content in messages]
    places = np.array([[one["translation"][axis] for axis in "xyz"] for one in ones])
    return places, Rotation.from_quat([[one["rotation"][axis] for axis in "xyzw"] for one in ones])


@pytest.fixture(scope="module")
def log() -> Log:
    log = with_wheels(smooth_log(rows=50, sample_time=0.02), ALTEN)
    return log.with_columns({"ref_x": log["x"] + 0.1, "ref_y": log["y"], "ref_psi": log["psi"]})


@pytest.fixture(scope="module")
def messages(log, tmp_path_factory) -> dict[str, list]:
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    assert write_with_scene(path, log, ALTEN) == ""
    again = Log.read(path)
    assert again.names == log.names
    for name in log:
        np.testing.assert_array_equal(again[name], log[name])
    return topics(path)


def test_the_scene_has_every_shape_once_in_its_frame(messages, log):
    assert len(messages["/scene"]) == 1
    entities = messages["/scene"][0][1]["entities"]
    frames = {one["id"]: one["frame_id"] for one in entities}
    assert frames == {
        "ball": "ball", "body": "body", "wheel 1": "wheel 1", "wheel 2": "wheel 2", "wheel 3": "wheel 3",
        "path": "world", "reference path": "world", "reference": "reference",
    }  # fmt: skip
    (sphere,) = next(one["spheres"] for one in entities if one["id"] == "ball")
    assert sphere["size"]["x"] == 2.0 * ALTEN.ball.radius
    assert len(messages["/tf"]) == len(log)
    assert [time for time, _ in messages["/tf"]] == [time for time, _ in messages["/log"]]


def test_frames_have_the_pose_of_the_log(messages, log):
    places, turns = of_frame(messages["/tf"], "body")
    np.testing.assert_allclose(places[:, 0], log["x"], atol=1e-6)  # rounded to as much
    np.testing.assert_array_equal(places[:, 2], ALTEN.ball.radius)
    wanted = Rotation.from_euler("XYZ", np.column_stack([log[name] for name in ("theta", "phi", "psi")]))
    assert (turns.inv() * wanted).magnitude().max() < 5e-6


def test_the_wheels_roll_on_the_ball_without_slip(messages):
    _, ball = of_frame(messages["/tf"], "ball")
    _, body = of_frame(messages["/tf"], "body")

    def turn(frames: Rotation) -> np.ndarray:
        return (frames[1:] * frames[:-1].inv()).as_rotvec()

    middle = body[:-1] * Rotation.from_rotvec(0.5 * (body[:-1].inv() * body[1:]).as_rotvec())
    r_b, r_w = ALTEN.ball.radius, ALTEN.wheels.radius
    for k, (n, t) in enumerate(
        zip(contact_directions(ALTEN.wheels), rolling_directions(ALTEN.wheels), strict=True)
    ):
        place, wheel = of_frame(messages["/tf"], f"wheel {k + 1}")
        np.testing.assert_allclose(place, np.tile((r_b + r_w) * n, (len(place), 1)), atol=1e-6)
        contact, along = middle.apply(n), middle.apply(t)
        on_ball = np.cross(turn(ball), r_b * contact)
        on_wheel = np.cross(turn(body), (r_b + r_w) * contact) - np.cross(turn(body * wheel), r_w * contact)
        slip = np.sum((on_ball - on_wheel) * along, axis=1)
        travel = np.abs(np.sum(on_ball * along, axis=1))
        # differences over 20 ms of a motion whose rates change by a few percent in that time
        assert np.abs(slip).max() < 0.01 * travel.max()


def test_a_log_converts_from_format_to_format_by_one_command(tmp_path, capsys, log):
    first = tmp_path / "run.csv"
    log.write(first)
    path = first
    for name, options in (("a.mat", []), ("b.db3", []), ("c.mcap", ["--robot", "alten"]), ("d.npz", []),
                          ("e.csv", ["--decimal-comma"]), ("f.parquet", [])):  # fmt: skip
        out = tmp_path / name
        assert main(["convert", str(path), str(out), *options]) == 0
        assert capsys.readouterr().out == f"{out}\n"
        path = out
    again = Log.read(path)
    for column in log:
        np.testing.assert_array_equal(again[column], log[column])
    assert "/scene" in topics(tmp_path / "c.mcap")


def test_convert_refuses_and_explains(tmp_path, capsys, log):
    path = tmp_path / "run.csv"
    Log({"t": log.t, "u1": log["u1"]}).write(path)

    def said(*words: str) -> str:
        assert main(["convert", str(path), *words]) == 2
        return capsys.readouterr().err

    assert "already exists" in said(str(path))
    assert "must end in .csv, .parquet" in said(str(tmp_path / "run.xls"))
    assert "--robot is for the scene of an MCAP file" in said(str(tmp_path / "a.mat"), "--robot", "alten")
    assert "only CSV has them" in said(str(tmp_path / "a.mat"), "--decimal-comma")
    for options, reason in (([], "the robot is not known"), (["--robot", "alten"], "The log has no theta")):
        assert main(["convert", str(path), str(tmp_path / "a.mcap"), "--force", *options]) == 0
        assert f"The file has no 3-D scene{',' if not options else '.'}" in (out := capsys.readouterr().out)
        assert reason in out


def test_recordings_of_a_balancing_robot_show_it(tmp_path):
    words = ["record", "nominal", "--format", "mcap", "--out"]
    assert main([*words, str(tmp_path / "one"), "--duration", "0.2"]) == 0
    assert main([*words, str(tmp_path / "two"), "--duration", "0.2", "--seeds", "1"]) == 0
    for folder in ("one", "two/seed_0001"):
        for name in ("log", "truth"):
            assert {"/scene", "/tf"} <= set(topics(tmp_path / folder / f"{name}.mcap"))
    bench = ["--experiment", "upside_down", "--duration", "0.2"]
    assert main([*words, str(tmp_path / "bench"), *bench]) == 0
    assert not {"/scene", "/tf"} & set(topics(tmp_path / "bench" / "log.mcap"))
