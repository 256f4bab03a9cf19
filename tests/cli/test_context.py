"""What a long run leaves in its folder, and what commands print while they work with output that is no terminal."""

import io
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from ballbot import InputError
from ballbot.cli import output
from ballbot.cli.context import CHECKPOINT, RunOptions, long_run
from ballbot.cli.output import progress_bar
from ballbot.files import write_text
from ballbot.fitting.run import ExecutorError, Run
from ballbot.progress import Progress

ANSWER = np.ones(2)


def begin(folder: Path, *, resume: bool, after: Callable[[Run], object]) -> None:
    """Run something that answers one question, and then does what is given."""
    belongs_to = {"seed": "0"}
    with long_run(folder, belongs_to=belongs_to, options=RunOptions(resume=resume)) as run:
        run.memoize("search", np.zeros(1), lambda: [ANSWER])
        after(run)


def refuse(_: Run) -> None:
    raise InputError("The log is too short.")


def lose_workers(_: Run) -> None:
    raise ExecutorError("The cluster was lost.")


def ask_something_else(run: Run) -> None:
    run.memoize("polish", np.ones(1), lambda: [ANSWER])


@pytest.fixture
def interrupted(tmp_path) -> Path:
    def interrupt(run: Run) -> None:
        run.memoize("search", np.ones(1), lambda: [ANSWER])
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="ballbot --resume"):
        begin(tmp_path, resume=False, after=interrupt)
    assert [path.name for path in tmp_path.iterdir()] == [CHECKPOINT]
    return tmp_path


@pytest.mark.parametrize("resume", [False, True])
def test_a_refusal_leaves_nothing_behind(tmp_path, resume):
    with pytest.raises(InputError, match="too short"):
        begin(tmp_path, resume=resume, after=refuse)
    assert not list(tmp_path.iterdir())


def test_a_refusal_of_a_resumed_run_leaves_nothing_behind(interrupted):
    with pytest.raises(InputError, match="too short"):
        begin(interrupted, resume=True, after=refuse)
    assert not list(interrupted.iterdir())


def test_what_was_computed_outlives_its_workers(tmp_path):
    with pytest.raises(ExecutorError):
        begin(tmp_path, resume=False, after=lose_workers)
    assert (tmp_path / CHECKPOINT).exists()


def test_what_was_computed_outlives_results_that_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=re.escape("file/results.json cannot be written")):
        begin(tmp_path, resume=False, after=lambda _: write_text(tmp_path / "file" / "results.json", ""))
    assert (tmp_path / CHECKPOINT).exists()


def test_checkpoint_that_does_not_match_is_not_deleted(interrupted):
    kept = (interrupted / CHECKPOINT).read_bytes()
    with pytest.raises(InputError, match="the run differs"):
        begin(interrupted, resume=True, after=ask_something_else)
    assert (interrupted / CHECKPOINT).read_bytes() == kept


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
        bar.report(Progress(stage="descent", done=0, total=1, planned=30.0))
        time.sleep(1.8)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 3
    # the last one is at least 0.5 s after the first; nothing that happens later is known
    assert re.fullmatch(r"ballbot: descent, 0 %, about 0:2[89] left", lines[-1])


def test_writing_the_report_is_the_last_stage_of_planned_work(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with progress_bar(piped, "fitting", writing=10.0) as bar:
        time.sleep(0.2)
        bar.report(Progress(stage="descent", done=1, total=2, planned=30.0))
        bar.begin_writing()
    assert capsys.readouterr().err.splitlines() == [
        "ballbot: fitting",
        "ballbot: descent, 38 %, about 0:25 left",
        "ballbot: writing the report, 75 %, about 0:10 left",
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


def test_writing_the_report_after_work_without_a_plan_begins_at_the_last_share(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with progress_bar(piped, "fitting") as bar:
        time.sleep(0.2)
        bar.show(0.6, doing="descent")
        bar.begin_writing()
    assert capsys.readouterr().err.splitlines() == [
        "ballbot: fitting",
        "ballbot: descent, 60 %",
        "ballbot: writing the report, 60 %",
    ]


def test_nothing_is_written_after_work_that_was_refused(piped, capsys, monkeypatch):
    monkeypatch.setattr(output, "_BEFORE_LINES", 0.05)
    with pytest.raises(ValueError, match="refused"), progress_bar(piped, "reading"):
        raise ValueError("refused")
    time.sleep(0.2)
    assert capsys.readouterr().err == ""
