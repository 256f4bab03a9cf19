"""Progress in notebooks: one line of a cell, updated in place, and nothing anywhere else."""

import sys
from types import ModuleType, SimpleNamespace

import pytest

from ballbot.fitting.run import Run
from ballbot.progress import NotebookProgress, Progress, in_notebook


class FakeNotebook:
    """IPython's display, as far as it is used; its lines are the texts of each line of a cell."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.lines: list[list[str]] = []
        self.shell = SimpleNamespace(kernel=object(), execution_count=1)
        ipython, display = ModuleType("IPython"), ModuleType("IPython.display")
        ipython.get_ipython = lambda: self.shell  # pyright: ignore[reportAttributeAccessIssue]
        display.display = self.display  # pyright: ignore[reportAttributeAccessIssue]
        monkeypatch.setitem(sys.modules, "IPython", ipython)
        monkeypatch.setitem(sys.modules, "IPython.display", display)

    def display(self, shown: dict[str, str], *, raw: bool, display_id: bool) -> SimpleNamespace:
        assert (raw, display_id) == (True, True)
        line = [shown["text/plain"]]
        self.lines.append(line)
        return SimpleNamespace(update=lambda new, **_: line.append(new["text/plain"]))


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> FakeNotebook:
    return FakeNotebook(monkeypatch)


def work(progress: NotebookProgress, clock: list[float], *, steps: int = 40, seconds: float = 8.0) -> None:
    for step in range(1, steps + 1):
        clock[0] += seconds / steps
        progress(Progress(stage="gauss_newton", done=step, total=steps, note="error x 1.2"))


def test_long_work_is_one_line_of_each_cell(shown):
    clock = [0.0]
    progress = NotebookProgress(lambda: clock[0])
    work(progress, clock)
    shown.shell.execution_count += 1
    work(progress, clock, steps=4)
    first, second = shown.lines
    assert any("about 0:05 left" in text for text in first)
    assert first[-1] == second[-1] == "Gauss-Newton, 100 %, error x 1.2"


def test_nothing_is_shown_of_short_work_and_without_a_notebook(shown, monkeypatch):
    clock = [0.0]
    work(NotebookProgress(lambda: clock[0]), clock, seconds=0.9)
    del shown.shell.kernel  # a terminal
    work(NotebookProgress(lambda: clock[0]), clock)
    monkeypatch.delitem(sys.modules, "IPython")
    work(NotebookProgress(lambda: clock[0]), clock)
    assert shown.lines == []


def test_a_run_shows_its_progress_in_a_notebook_unless_it_is_given_another():
    assert Run().progress is in_notebook
