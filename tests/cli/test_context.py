"""What commands print while they work with output that is no terminal."""

import io
import time

import pytest
from rich.console import Console

from ballbot.cli import output
from ballbot.cli.output import progress_bar
from ballbot.cli.waiting import Waiting
from ballbot.progress import Progress


@pytest.fixture
def piped():
    return Console(file=io.StringIO())


def test_quick_work_prints_nothing(piped, capsys):
    with progress_bar(piped, "simulating") as report:
        report(Progress(stage="", done=0.5, total=1.0))
    assert capsys.readouterr() == ("", "")


def test_long_work_prints_its_stages_on_standard_error(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with progress_bar(piped, "reading") as report:
        time.sleep(0.1)
        for share, doing in ((0.1, ""), (0.2, "evolution"), (0.3, "evolution"), (0.4, "polish")):
            report(Progress(stage=doing, done=share, total=1.0, note="error 2"))
        report(Progress(stage="writing the report"))
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.splitlines() == [
        "ballbot: reading, 10 %, error 2",
        "ballbot: evolution, 20 %, error 2",
        "ballbot: polish, 40 %, error 2",
        "ballbot: writing the report",
    ]


def test_a_long_stage_gets_lines_in_the_middle_of_it(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.0)
    monkeypatch.setattr(output, "_BETWEEN_LINES", 0.1)
    with progress_bar(piped, "fitting") as report:
        for done in range(3):
            report(Progress(stage="descent", done=done, total=2))
            time.sleep(0.15 if done else 0.0)
    assert capsys.readouterr().err.splitlines() == ["ballbot: descent, 0 %", "ballbot: descent, 100 %"]


@pytest.mark.parametrize("watched", [True, False])
def test_terminal_shows_that_a_command_starts_until_it_prints(watched, capsys, monkeypatch):
    for stream in ("stdout", "stderr"):
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: watched)
    monkeypatch.setattr("ballbot.cli.waiting._BETWEEN", 0.01)
    waiting = Waiting("starting study")
    time.sleep(0.1)
    waiting.end()
    written = capsys.readouterr().err
    assert written.startswith("\rstarting study, 0 s") == watched
    assert written.endswith("\r\x1b[K") == watched
