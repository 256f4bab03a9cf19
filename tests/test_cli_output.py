"""What commands print while they work, with output that is no terminal."""

import io
import time

import pytest
from rich.console import Console

from ballbot.cli import output
from ballbot.cli.output import progress_bar


@pytest.fixture
def piped():
    return Console(file=io.StringIO())


def test_quick_work_prints_nothing(piped, capsys):
    with progress_bar(piped, "simulating") as bar:
        bar.show(0.5)
    assert capsys.readouterr() == ("", "")


def test_long_work_says_its_stages_on_standard_error(piped, capsys, monkeypatch):
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


def test_nothing_is_written_after_work_that_was_refused(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with pytest.raises(ValueError, match="refused"), progress_bar(piped, "reading"):
        raise ValueError("refused")
    time.sleep(0.2)
    assert capsys.readouterr().err == ""
