"""What commands print while they work with output that is no terminal."""

import io
import re
import time

import pytest
from rich.console import Console

from ballbot.cli import output
from ballbot.cli.output import progress_bar
from ballbot.progress import Progress


@pytest.fixture
def piped():
    return Console(file=io.StringIO())


def test_quick_work_prints_nothing(piped, capsys):
    with progress_bar(piped, "simulating") as bar:
        bar.show(0.5)
    assert capsys.readouterr() == ("", "")


def test_long_work_prints_its_stages_on_standard_error(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with progress_bar(piped, "reading") as bar:
        time.sleep(0.2)  # the first line comes without any step
        for share, doing in ((0.1, "reading"), (0.2, "evolution"), (0.3, "evolution"), (0.4, "polish")):
            bar.show(share, doing=doing, note="error 2")
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.splitlines() == [
        "ballbot: reading",
        "ballbot: evolution, 20 %, error 2",
        "ballbot: polish, 40 %, error 2",
    ]


def test_a_long_step_gets_lines_with_the_time_left_in_the_middle_of_it(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.0)
    monkeypatch.setattr(output, "_BETWEEN_LINES", 0.5)
    with progress_bar(piped, "fitting") as bar:
        bar.report(Progress(stage="descent", done=0, total=10))
        time.sleep(0.1)
        bar.report(Progress(stage="descent", done=5, total=10))
        time.sleep(1.8)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 3
    # the first half took as long as the stage so far, at least 1 s: no time is given from less
    assert re.fullmatch(r"ballbot: descent, 50 %, about 0:0[12] left", lines[-1])


def test_writing_the_report_is_a_stage_without_steps(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with progress_bar(piped, "fitting") as bar:
        time.sleep(0.2)
        bar.report(Progress(stage="descent", done=1, total=2))
        bar.begin_writing()
    assert capsys.readouterr().err.splitlines() == [
        "ballbot: fitting",
        "ballbot: descent, 50 %",
        "ballbot: writing the report",
    ]


def test_a_line_has_the_time_so_far_if_the_time_left_is_not_known(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    monkeypatch.setattr(output, "_LONG", 0.0)
    with progress_bar(piped, "checking the robot") as bar:
        time.sleep(0.2)
        bar.show(0.5, doing="reading")
    assert capsys.readouterr().err.splitlines() == [
        "ballbot: checking the robot, 0:00 so far",
        "ballbot: reading, 50 %, 0:00 so far",
    ]


def test_nothing_is_written_after_work_that_was_refused(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with pytest.raises(ValueError, match="refused"), progress_bar(piped, "reading"):
        raise ValueError("refused")
    time.sleep(0.2)
    assert capsys.readouterr().err == ""
