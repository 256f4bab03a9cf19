"""What commands print while they work with output that is no terminal."""

import io
import time

import pytest
from rich.console import Console

from ballbot.cli import Waiting, output
from ballbot.cli.context import changed_robot
from ballbot.cli.output import progress_bar
from ballbot.progress import Progress


@pytest.fixture
def piped():
    return Console(file=io.StringIO())


def test_long_work_prints_its_stages_on_standard_error(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with progress_bar(piped, "reading") as report:
        time.sleep(0.3)  # compiling reports nothing
        for share, doing in ((0.1, ""), (0.2, "evolution"), (0.3, "evolution"), (0.4, "polish")):
            report(Progress(stage=doing, done=share, total=1.0, note="error 2"))
        report(Progress(stage="writing the report"))
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.splitlines() == [
        "ballbot: reading",
        "ballbot: evolution, 20 %, error 2",
        "ballbot: polish, 40 %, error 2",
        "ballbot: writing the report",
    ]


def test_values_of_the_robot_are_set_on_the_command_line():
    robot = changed_robot(
        "alten", ["body.mass=9.0", "friction.coulomb = [0.1, 0.2, 0.3]", "friction.rolling=0.01"]
    )
    assert robot.body.mass == 9.0
    assert robot.friction.coulomb == (0.1, 0.2, 0.3)
    assert robot.friction.rolling == 0.01


@pytest.mark.parametrize("watched", [True, False])
def test_terminal_shows_that_a_command_starts_until_it_prints(watched, capsys, monkeypatch):
    for stream in ("stdout", "stderr"):
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: watched)
    monkeypatch.setattr("ballbot.cli._BETWEEN", 0.01)
    waiting = Waiting("starting study")
    time.sleep(0.1)
    waiting.end()
    written = capsys.readouterr().err
    assert written.startswith("\rstarting study, 0 s") == watched
    assert written.endswith("\r\x1b[K") == watched
