"""`ballbot view`: which robot a log has, labels, parts of a log, what it refuses."""

import shutil
from pathlib import Path

import pytest

from ballbot.cli.main import main
from ballbot.robot import Robot
from ballbot.robot.file import write_robot
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
def test_saved_page_has_the_logs_by_their_labels(capsys):
    shutil.copy("log.csv", "other.csv")
    assert main(["view", "with=log.csv", "other.csv", "--robot", "alten", "--save", "out/replay.html"]) == 0
    page = Path("out/replay.html").read_text(encoding="utf-8")
    assert '"name":"with"' in page
    assert '"name":"other"' in page
    assert "out/replay.html" in capsys.readouterr().out
    assert opened == []


@pytest.mark.usefixtures("folder")
def test_a_log_of_the_usual_name_is_called_as_its_folder():
    Path("run7").mkdir()
    shutil.copy("log.csv", "run7/log.csv")
    assert main(["view", "run7/log.csv", "--robot", "alten", "--save", "replay.html"]) == 0
    assert "<title>run7</title>" in Path("replay.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("folder")
def test_page_is_opened_without_save(capsys, monkeypatch):
    monkeypatch.setattr("ballbot.cli.view.has_live_view", lambda: False)
    assert main(["view", "alten"]) == 0
    assert "pip install 'ballbot[view]'" in capsys.readouterr().out
    (address,) = opened
    assert address.startswith("file:///")
    assert Path(address.removeprefix("file://")).is_file()


def test_robot_beside_the_log_is_its_robot(folder, capsys):
    assert "--robot" in refused(capsys, "log.csv", "--save", "replay.html")
    write_robot(Robot.load("alten").replace(name="mine"), folder / "robot.toml")
    assert main(["view", "log.csv", "--save", "replay.html"]) == 0


@pytest.mark.usefixtures("folder")
def test_part_of_a_log_is_shown(capsys):
    words = ["view", "log.csv", "--robot", "alten", "--start", "0.5", "--end", "1.0", "--save", "replay.html"]
    assert main(words) == 0
    assert '"rows":26' in Path("replay.html").read_text(encoding="utf-8")  # 0.495 s at 50 Hz
    assert "no row from" in refused(capsys, "log.csv", "--robot", "alten", "--start", "9", "--save", "r.html")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "nothing to show"),
        (("alten", "log.csv"), "--robot alten"),
        (("a=log.csv", "a=other.csv", "--robot", "alten"), "label 'a'"),
        (("missing.csv", "--robot", "alten"), "missing.csv cannot be read"),
        (("log.csv", "--robot", "alten", "--save", "."), "a file is needed"),
        (("log.csv", "--robot", "alten", "--plant", "twin"), "a robot that is simulated"),
        (("alten", "--video", "replay.mp4"), "A video needs a log"),
        (("/dev/ttyACM0", "--robot", "alten"), "ballbot run monitor /dev/ttyACM0"),
        (("alten", "--port", "70000"), "from 0 (any free one) to 65535"),
        (("alten", "--controller", "presice"), "precise"),
        (("alten", "--plant", "twin", "--scenario", "nominl"), "nominal"),
    ],
)
def test_bad_words_are_refused_in_a_sentence(capsys, words, sentence):
    assert sentence in refused(capsys, *words)
    assert not Path("replay.html").exists()


@pytest.mark.usefixtures("folder")
def test_video_needs_ffmpeg(capsys, monkeypatch):
    monkeypatch.setenv("PATH", "")
    words = ("log.csv", "--robot", "alten", "--video", "replay.mp4")
    assert "A video needs ffmpeg" in refused(capsys, *words)
    assert not Path("replay.mp4").exists()


def test_a_simulated_log_is_shown_with_its_robot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "rezero", "--duration", "0.5", "--out", "run1"]) == 0
    assert Robot.load("run1/robot.toml") == Robot.load("rezero")
    assert main(["view", "run1/log.csv", "--save", "replay.html"]) == 0
    assert '"name":"run1"' in (tmp_path / "replay.html").read_text()
