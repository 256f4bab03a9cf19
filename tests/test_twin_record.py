"""Recordings of the twin: the files agree with each other and can be made again."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import STATE_NAMES, Log
from ballbot.twin.motion_capture import MotionCapture


def test_cameras_can_be_brought_back_to_the_world() -> None:
    """Undoing frame and clock by what the setup says gives the motion back, to the cameras' noise."""
    t = 0.005 * np.arange(2001)
    columns = {name: np.zeros_like(t) for name in STATE_NAMES}
    columns |= {"t": t, "x": 0.3 * np.sin(t), "y": 0.2 * np.cos(2 * t), "psi": 0.9 * t}
    columns |= {"theta": 0.1 * np.sin(3 * t), "phi": 0.05 * np.cos(t)}
    cameras = MotionCapture.drawn(7)
    film = cameras.film(Log(columns), ball_radius=0.11)
    assert len(film) == 1201  # 10 s at 120 Hz
    t_back = (film.t - cameras.clock_offset) / (1 + cameras.clock_rate)
    np.testing.assert_allclose(t_back, np.arange(1201) / 120, atol=1e-9)
    w, x, y, z = cameras.rotation_wxyz
    to_world = Rotation.from_quat([x, y, z, w]).inv()
    centers = to_world.apply(np.column_stack([film[name] for name in "xyz"]) - cameras.origin)
    truth = np.column_stack((0.3 * np.sin(t_back), 0.2 * np.cos(2 * t_back), np.full(1201, 0.11)))
    assert np.std(centers - truth) == pytest.approx(2e-4, rel=0.1)  # 3600 draws: 1.2 % each
    found = to_world * Rotation.from_quat(np.column_stack([film[name] for name in ("qx", "qy", "qz", "qw")]))
    angles = np.column_stack((0.1 * np.sin(3 * t_back), 0.05 * np.cos(t_back), 0.9 * t_back))
    off = (Rotation.from_euler("XYZ", angles).inv() * found).as_rotvec()
    assert np.std(off) == pytest.approx(1e-3, rel=0.1)
    steps = np.diff(np.column_stack([film[name] for name in ("qw", "qx", "qy", "qz")]), axis=0)
    assert np.abs(steps).max() < 0.05  # no jump of sign
    assert (cameras.film(Log(columns), ball_radius=0.11)["x"] == film["x"]).all()
    assert MotionCapture.drawn(8) != cameras


def test_record_writes_a_run_that_can_be_made_again(tmp_path: Path) -> None:
    from ballbot.cli.main import main

    command = ["record", "nominal", "--reference", "square", "--duration", "1", "--seed", "3", "--out"]
    for folder in ("one", "two"):
        assert main([*command, str(tmp_path / folder)]) == 0
    one, two = tmp_path / "one", tmp_path / "two"
    names = {"log.csv", "truth.csv", "motion_capture.csv", "controller.toml", "results.json", "record.toml"}
    assert {path.name for path in one.iterdir()} == names
    for name in names:
        assert (one / name).read_bytes() == (two / name).read_bytes()
    log, truth, film = (Log.read(one / f"{name}.csv") for name in ("log", "truth", "motion_capture"))
    assert len(log) == len(truth)
    assert log.t[-1] >= 0.99
    assert not any(name.startswith("true_") for name in log.names)
    assert np.abs(log["theta"] - truth["theta"]).max() > 0  # sensors err
    assert np.abs(log["x"] - truth["x"]).max() < 0.02
    assert {"x", "y", "z", "qw", "qx", "qy", "qz"} <= set(film.names)
    found = json.loads((one / "results.json").read_text())
    assert found["ended"] is None
    error = np.sqrt((truth["x"] - truth["ref_x"]) ** 2 + (truth["y"] - truth["ref_y"]) ** 2)
    assert found["peak_position_error"] == pytest.approx(error.max())
    lean_error = log["theta"] - truth["theta"]
    assert found["sensor_rms_error"]["theta"] == pytest.approx(np.sqrt(np.mean(lean_error**2)))
    made = tomllib.loads((one / "record.toml").read_text())
    assert made["run"]["seed"] == 3
    assert made["scenario"]["friction"]["coulomb"] == [0.11, 0.09, 0.12]
    assert film.t[0] == pytest.approx(made["motion_capture"]["clock_offset"])


def test_record_reads_the_controller_that_it_wrote(tmp_path: Path) -> None:
    from ballbot.cli.main import main

    command = ["record", "nominal", "--duration", "0.5", "--out"]
    assert main([*command, str(tmp_path / "one")]) == 0
    again = [*command, str(tmp_path / "two"), "--controller", str(tmp_path / "one" / "controller.toml")]
    assert main(again) == 0
    assert (tmp_path / "one" / "log.csv").read_bytes() == (tmp_path / "two" / "log.csv").read_bytes()


@pytest.mark.parametrize(
    "arguments",
    [
        ["nominl", "--out", "DIR"],
        ["nominal", "--reference", "triangle", "--out", "DIR"],
        ["nominal", "--robot", "altn", "--out", "DIR"],
        ["nominal", "--duration", "-1", "--out", "DIR"],
        ["nominal", "--controller", "absent.toml", "--out", "DIR"],
        ["nominal"],
    ],
)
def test_record_refuses_in_one_sentence(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from ballbot.cli.main import main

    out = str(tmp_path / "out")
    assert main(["record", *(out if word == "DIR" else word for word in arguments)]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("ballbot: ")
    assert printed.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_film_needs_a_pose() -> None:
    with pytest.raises(InputError, match="theta"):
        MotionCapture.drawn(1).film(
            Log({"t": np.arange(3.0), "x": np.zeros(3), "y": np.zeros(3)}), ball_radius=0.1
        )
