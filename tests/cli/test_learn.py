"""`ballbot learn`: its files, and what it refuses before it trains."""

import _thread
import json
import re
import threading

import pytest

from ballbot.cli.main import main
from ballbot.control.file import read_controller
from ballbot.learning.contract import Contract
from ballbot.robot import Robot
from tests.support.processes import ctrl_c_is_heard

SHORT = ["--updates", "1", "--runs", "1", "--duration", "1"]


def test_controller_robot_and_contract_are_written(tmp_path, capsys):
    out = tmp_path / "learned"
    words = ["learn", "balance", "alten", "--randomize", "boxes", "--set", "body.mass=8.5", *SHORT]
    assert main([*words, "--out", str(out)]) == 0
    assert Robot.load(out / "robot.toml").body.mass == 8.5
    assert capsys.readouterr().out.splitlines()[-1].startswith("Next: ")
    assert read_controller(out / "controller.toml", out / "robot.toml").parts.policy
    assert Contract.read(out / "contract.json").period == 0.01
    results = json.loads((out / "results.json").read_text())
    assert results["curve"][0]["samples"] == 51_200
    assert results["confirmed"][0]["runs"] == 1
    page = (out / "report.html").read_text()
    assert len(re.findall(r'"name":"[\d.]+ s"', page)) == 2  # before the first update and after it


def test_ctrl_c_in_the_midst_of_an_update_keeps_the_best_policy(tmp_path, capsys, monkeypatch):
    begun = []

    def reported(values):
        if not begun:
            begun.append(threading.Timer(0.5, _thread.interrupt_main))
            begun[0].start()
        return f"after update {len(values)}"

    monkeypatch.setattr("ballbot.learning.learn.sparkline", reported)
    out = tmp_path / "learned"
    with ctrl_c_is_heard():
        assert main(["learn", "balance", "--updates", "5000", *SHORT[2:], "--out", str(out)]) == 0
    assert "stopped early" in capsys.readouterr().out
    results = json.loads((out / "results.json").read_text())
    assert results["stopped"]
    assert 1 <= len(results["curve"]) < 5000
    assert read_controller(out / "controller.toml", out / "robot.toml").parts.policy


@pytest.mark.parametrize(
    ("words", "named"), [(["fly"], "fly"), (["balance", "--randomize", "nowhere"], "nowhere"),
                         (["balance", "--onto", "sharp"], "sharp"), (["balance", "--duration", "-1"], "--duration"),
                         (["balance", "--confirm-on-twin", "-3"], "--confirm-on-twin")],
)  # fmt: skip
def test_bad_input_is_refused_in_one_sentence_before_the_training(tmp_path, capsys, words, named):
    assert main(["learn", *words, "--updates", "1", "--out", str(tmp_path / "learned")]) == 2
    error = capsys.readouterr().err
    assert named in error
    assert "learning" not in error
    assert "None" not in error
    assert not (tmp_path / "learned").exists()
