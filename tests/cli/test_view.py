"""`ballbot view`: which robot a log has, labels, parts of a log, what it refuses."""

from pathlib import Path

import pytest

from ballbot.cli.main import main
from ballbot.robot import Robot
from tests.support.log_examples import smooth_log


@pytest.fixture
def folder(tmp_path, monkeypatch):
    smooth_log(rows=400).write(tmp_path / "log.csv")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    opened.clear()
    return tmp_path


opened: list[str] = []


def refused(capsys, *words):
    assert main(["view", *words]) == 2
    return capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_page_is_opened_without_save(capsys, monkeypatch):
    monkeypatch.setattr("ballbot.cli.view.find_spec", lambda _: None)
    assert main(["view", "alten"]) == 0
    assert "pip install 'ballbot[view]'" in capsys.readouterr().out
    (address,) = opened
    assert address.startswith("file:///")
    assert Path(address.removeprefix("file://")).is_file()


def test_robot_beside_the_log_is_its_robot(folder, capsys):
    assert "--robot" in refused(capsys, "log.csv", "--save", "replay.html")
    Robot.load("alten").replace(name="mine").write(folder / "robot.toml")
    assert main(["view", "log.csv", "--save", "replay.html"]) == 0


@pytest.mark.usefixtures("folder")
def test_part_of_a_log_is_shown(capsys):
    words = ["view", "log.csv", "--robot", "alten", "--start", "0.5", "--end", "1.0", "--save", "replay.html"]
    assert main(words) == 0
    assert '"rows":26' in Path("replay.html").read_text(encoding="utf-8")  # 0.495 s at 50 Hz
    assert "no row from" in refused(capsys, "log.csv", "--robot", "alten", "--start", "9", "--save", "r.html")
