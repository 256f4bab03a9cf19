"""`ballbot check-log` on foreign files: what is undetermined exits with code 2, and --columns names the columns."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ballbot.cli.main import main
from ballbot.log import Log
from ballbot.robot.file import robot_text
from tests.support.foreign_log_examples import COURSE, foreign_columns, small_robot, write_foreign


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the robot, its log, and that log without names of units for its commands."""
    path = tmp_path_factory.mktemp("foreign")
    (path / "robot.toml").write_text(robot_text(small_robot()))
    columns = foreign_columns()
    write_foreign(path / "run.txt", columns)
    write_foreign(path / "bare.txt", columns, replace(COURSE, layout="no_header"))
    still = {name: values for name, values in columns.items() if not name.startswith("u")}
    random = np.random.default_rng(0)
    still |= {f"u{i}": random.standard_normal(len(columns["t_now"])) for i in (1, 2, 3)}
    write_foreign(path / "unrelated.txt", still)
    return path


def words_for(folder, name: str, *more: str) -> list[str]:
    return ["check-log", str(folder / name), "--robot", str(folder / "robot.toml"), *more]


def test_a_log_whose_mapping_is_certain_suggests_the_next_command(folder, capsys):
    out = folder / "checked"
    assert main(words_for(folder, "run.txt", "--command", "duty", "--out", str(out))) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("run.txt: balancing")
    assert "Next: `ballbot identify" in shown
    (results,) = json.loads((out / "results.json").read_text())["files"]
    assert results["questions"] == []
    assert results["confidence"] > 0.9
    mapping = out / "mapping.toml"
    log = Log.read(out / "log.csv")
    log.require("t", "u1", "u2", "u3", "x", "y", "theta", "phi", "psi", "wheel1_dot")
    # rows by the mapping alone are those of the log written
    again = Log.read(folder / "run.txt", mapping=mapping, robot=folder / "robot.toml")
    np.testing.assert_allclose(again["theta"], log["theta"])
    assert "complete" not in mapping.read_text()
    # a dead band that nobody states: commands say so, and no longer once it is stated
    assert [one.severity for one in again.changes if one.code == "dead-band"] == ["warning"]
    mapping.write_text(mapping.read_text().replace("# dead_band = ", "dead_band = "))
    stated = Log.read(folder / "run.txt", mapping=mapping, robot=folder / "robot.toml")
    assert "dead-band" not in [one.code for one in stated.changes]


def test_what_cannot_be_determined_exits_with_two_and_a_line_to_fill_in(folder, capsys):
    out = folder / "asked"
    assert main(words_for(folder, "unrelated.txt", "--command", "duty", "--out", str(out))) == 2
    printed = capsys.readouterr()
    assert "cannot determine: " in printed.err
    assert "Next:" not in printed.out
    text = (out / "mapping.toml").read_text()
    assert "# cannot determine: " in text
    assert "complete = false" in text
    assert not (out / "log.csv").exists()
    assert main(["check-log", str(folder / "unrelated.txt"), "--mapping", str(out / "mapping.toml")]) == 2
    assert "the mapping is not complete" in capsys.readouterr().err


def test_columns_names_those_of_a_file_without_a_header(folder, capsys):
    names = "t,roll_deg,pitch_deg,yaw_deg,psi_1,psi_2,psi_3,u1,u2,u3"
    assert main(words_for(folder, "bare.txt", "--command", "duty")) == 2
    assert "--columns" in capsys.readouterr().err
    assert main(words_for(folder, "bare.txt", "--command", "duty", "--columns", names)) == 0
    assert main(words_for(folder, "bare.txt", "--columns", "t,roll")) == 2


def test_the_mapping_of_one_log_reads_another_of_the_same_robot(folder, capsys):
    (folder / "again.txt").write_text((folder / "run.txt").read_text())
    words = words_for(folder, "run.txt", str(folder / "again.txt"), "--command", "duty")
    assert main(words) == 0
    assert "again.txt: balancing" in capsys.readouterr().out
    assert main([*words, "--out", str(folder / "several")]) == 2
    assert "--out takes one log" in capsys.readouterr().err
