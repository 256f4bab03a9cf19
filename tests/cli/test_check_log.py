"""`ballbot check-log`: the table, the findings, results.json, and what exits with which error."""

import json

import numpy as np
import pytest

from ballbot.cli.check_log import check_log
from ballbot.cli.main import main
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.robot.file import robot_text
from tests.support.foreign_log_examples import small_robot, swaying_log
from tests.support.log_examples import smooth_log, with_wheels


def test_a_clean_log_shows_its_columns_and_writes_results(tmp_path, capsys):
    path = tmp_path / "log.csv"
    with_wheels(smooth_log(), Robot.load("alten")).write(path)
    check_log(path, robot="alten", out=tmp_path / "out")
    shown = capsys.readouterr().out
    assert "1998 rows" in shown
    assert "200 Hz" in shown
    assert "theta_dot" in shown
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["rows"] == 1998
    assert results["wheels"]["order"] == [1, 2, 3]
    by_name = {column["name"]: column for column in results["columns"]}
    assert by_name["theta"]["unit"] == "rad"
    assert by_name["theta"]["greatest"] == pytest.approx(0.02, rel=1e-3)  # the sine's amplitude


def test_an_error_ends_in_one_sentence_after_the_table(tmp_path, capsys):
    log = smooth_log()
    log.with_columns({"psi": np.degrees(log["psi"])}).write(tmp_path / "log.csv")
    with pytest.raises(InputError, match="psi is in degrees, not in radians"):
        check_log(tmp_path / "log.csv", out=tmp_path)
    assert "psi_dot" in capsys.readouterr().out
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["findings"][0]["code"] == "degrees"


@pytest.mark.parametrize(
    ("renamed", "sign", "shown"),
    [
        ({}, 1.0, "By angles and wheels: theta_dot, phi_dot"),
        ({"theta": "phi", "phi": "theta"}, 1.0, "theta and phi are swapped"),
        ({"wheel1": "wheel2", "wheel2": "wheel1"}, 1.0, "The lean does not fit the ball's acceleration"),
        ({}, -1.0, "have the opposite sign"),
    ],
)
def test_a_log_of_angles_alone_is_checked_with_their_rates(tmp_path, capsys, renamed, sign, shown):
    """Its names are Ballbot's, but what they mean is a claim until the robot's equations confirm it."""
    robot = tmp_path / "robot.toml"
    robot.write_text(robot_text(small_robot()))
    log = swaying_log()
    angles = ("theta", "phi", "psi", "wheel1", "wheel2", "wheel3")
    columns = {renamed.get(name, name): log[name] for name in ("t", *angles)}
    Log(columns | {name: sign * log[name] for name in ("u1", "u2", "u3")}).write(tmp_path / "log.csv")
    code = main(["check-log", str(tmp_path / "log.csv"), "--robot", str(robot)])
    assert shown in " ".join(capsys.readouterr().out.split())
    assert code == (0 if shown.startswith("By") else 2)
