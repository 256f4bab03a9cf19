"""Recordings of the twin: the files agree with each other and can be made again."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbot.cli.context import parse_seeds
from ballbot.cli.main import main
from ballbot.errors import InputError
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot
from ballbot.twin.recording import MotionCapture


def test_cameras_can_be_brought_back_to_the_world() -> None:
    """Undoing frame and clock of the setup gives the motion back, to the cameras' noise."""
    t = 0.005 * np.arange(2001)
    columns = {name: np.zeros_like(t) for name in STATE_NAMES}
    columns |= {"t": t, "x": 0.3 * np.sin(t), "y": 0.2 * np.cos(2 * t), "psi": 0.9 * t}
    columns |= {"theta": 0.1 * np.sin(3 * t), "phi": 0.05 * np.cos(t)}
    cameras = MotionCapture.drawn(7)
    film = cameras.record(Log(columns), ball_radius=0.11)
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
    assert (cameras.record(Log(columns), ball_radius=0.11)["x"] == film["x"]).all()
    assert MotionCapture.drawn(8) != cameras


def test_record_writes_a_run_that_can_be_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = tmp_path / "one"
    words = "record nominal --reference square --duration 1 --seed 3 --out"
    command = [*words.split(), str(one)]
    assert main([*command, "--estimator", "kalman", "--controller", "partial"]) == 0
    names = {"report.html", "log.csv", "truth.csv", "motion_capture.csv", "results.json"}
    names |= {"robot.toml", "scenario.toml", "controller.toml", "record.toml"}
    assert {path.name for path in one.glob("[!.]*")} == names
    # by the command in the folder
    again = tomllib.loads((one / "record.toml").read_text())["run"]["command"].split()
    monkeypatch.chdir(one)
    assert again[0] == "ballbot"
    assert main(again[1:]) == 0
    for name in names - {"report.html", "results.json"}:  # which name the command
        assert (one / name).read_bytes() == (one / "again" / name).read_bytes()
    log, truth, film = (Log.read(one / f"{name}.csv") for name in ("log", "truth", "motion_capture"))
    found = json.loads((one / "results.json").read_text())
    lean = np.mean((log["theta"] - truth["theta"]) ** 2 + (log["phi"] - truth["phi"]) ** 2)
    assert found["estimation_errors"]["lean"] == pytest.approx(np.sqrt(lean))
    made = tomllib.loads((one / "record.toml").read_text())
    assert made["run"]["seed"] == 3
    assert film.t[0] == pytest.approx(made["motion_capture"]["clock_offset"])


@pytest.mark.usefixtures("undrawn")
def test_sweep_has_the_thesis_s_columns_and_speeds(tmp_path: Path) -> None:
    words = ["record", "nominal", "--experiment", "driveline_sweep", "--duration", "16", "--out"]
    assert main([*words, str(tmp_path)]) == 0
    log = Log.read(tmp_path / "log.csv")
    wheels = [f"wheel{i}" for i in (1, 2, 3)]
    assert log.names == ("t", "u1", "u2", "u3", *wheels, *(f"{name}_dot" for name in wheels))
    np.testing.assert_allclose(log.torques, np.repeat(np.sin(log.t / 10)[:, None], 3, axis=1), atol=1e-4)
    # c + s is reached at 1.3 s by the first wheel and at 1.8 s by the last
    assert np.abs(log.wheel_speeds[log.t < 1.2]).max() < 0.03  # a count of 0.1 mrad
    assert (log.wheel_speeds[log.t > 2.0].min(axis=0) > 0.5).all()
    # at a quarter of the sine the supply is the limit: 27.7 rad/s less what friction costs
    assert log.wheel_speeds[-1].min() > 26.5
    assert log.wheel_speeds[-1].max() < 27.8


@pytest.mark.usefixtures("undrawn")
def test_upside_down_ball_stays_on_the_wheels_and_turns_them(tmp_path: Path) -> None:
    command = ["record", "nominal", "--experiment", "upside_down", "--duration", "5", "--out", str(tmp_path)]
    assert main(command) == 0
    log, truth = Log.read(tmp_path / "log.csv"), Log.read(tmp_path / "truth.csv")
    assert log.names[-3:] == ("ball_omega_x", "ball_omega_y", "ball_omega_z")
    omega = np.column_stack([truth[f"ball_omega_{axis}"] for axis in "xyz"])
    driven = omega @ transforms(Robot.load("alten")).T_owb.T
    assert np.std(driven) > 2.0
    # rows meet the ball 1.4 degrees off, 2.5 % of the lever; play lets a wheel run on for a moment
    assert np.sqrt(np.mean((driven - truth.wheel_speeds) ** 2)) < 0.1 * np.std(driven)
    seen = np.column_stack([log[f"ball_omega_{axis}"] for axis in "xyz"])
    assert np.std(seen - omega) == pytest.approx(0.03, rel=0.06)  # 3000 draws: 1.3 %


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_recordings_of_many_seeds_are_those_of_each_and_of_one_kind(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("ballbot.fitting.run.os.cpu_count", lambda: 1)  # no process has to begin
    command = ["record", "nominal", "--duration", "0.2", "--out"]
    runs = [*command, str(tmp_path / "runs"), "--seeds"]
    assert main([*runs, "1-2"]) == 0
    assert "2 runs of 0.2 s; 0 ended early." in " ".join(capsys.readouterr().out.split())
    assert main([*command, str(tmp_path / "one"), "--seed", "2"]) == 0
    assert (tmp_path / "one" / "log.csv").read_bytes() == (tmp_path / "runs/seed_0002/log.csv").read_bytes()
    capsys.readouterr()
    for seeds in ("1-2", "5"):
        assert main([*runs, seeds, "--reference", "hold"]) == 2
        assert "holds finished runs that differ from these in: reference;" in capsys.readouterr().err
    assert main([*command, str(tmp_path / "runs")]) == 2
    assert "record --seeds" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "a", "3-1", "1-", "-1", "1;2", "1-999999999"])
def test_invalid_seed_lists_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="1-200"):
        parse_seeds(text)
