"""Progress in notebooks: one line, updated in place, and nothing anywhere else."""

import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import pytest

from ballbot.fitting.run import Run
from ballbot.notebook import NotebookProgress, ProgressLine, in_notebook
from ballbot.progress import Progress


class FakeNotebook:
    """IPython's display, as far as it is used."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, kernel: bool = True) -> None:
        self.lines: list[list[str]] = []
        self.end_of_cell: Callable[[SimpleNamespace], None] = lambda _: None
        events = SimpleNamespace(register=self.register)
        shell = SimpleNamespace(events=events, **({"kernel": object()} if kernel else {}))
        ipython, display = ModuleType("IPython"), ModuleType("IPython.display")
        ipython.get_ipython = lambda: shell  # pyright: ignore[reportAttributeAccessIssue]
        display.display = self.display  # pyright: ignore[reportAttributeAccessIssue]
        monkeypatch.setitem(sys.modules, "IPython", ipython)
        monkeypatch.setitem(sys.modules, "IPython.display", display)

    def register(self, event: str, function: Callable[[SimpleNamespace], None]) -> None:
        assert event == "post_run_cell"
        self.end_of_cell = function

    def display(self, shown: ProgressLine, *, display_id: bool) -> SimpleNamespace:
        assert display_id
        line = [repr(shown)]
        self.lines.append(line)
        return SimpleNamespace(update=lambda new: line.append(repr(new)))


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def work(progress: NotebookProgress, clock: Clock, *, steps: int = 40, seconds: float = 8.0) -> None:
    for step in range(1, steps + 1):
        clock.now += seconds / steps
        progress(Progress(stage="gauss_newton", done=step, total=steps, note="error x 1.2"))


def test_long_work_is_one_line_that_ends_at_the_whole(monkeypatch):
    shown, clock = FakeNotebook(monkeypatch), Clock()
    work(NotebookProgress(clock), clock)
    (line,) = shown.lines
    assert line[0].startswith("Gauss-Newton, 15 %, error x 1.2, about 0:07 left")
    assert any("about 0:05 left" in text for text in line)
    assert line[-1] == "Gauss-Newton, 100 %, error x 1.2"


def test_each_cell_has_a_line_of_its_own_which_shows_the_present_stage(monkeypatch):
    shown, clock = FakeNotebook(monkeypatch), Clock()
    progress = NotebookProgress(clock)
    work(progress, clock)
    for done in (1, 2):
        clock.now += 2.0
        progress(Progress(stage="intervals", done=done, total=4))
    assert [line[-1] for line in shown.lines] == ["intervals, 50 %, about 0:04 left"]
    shown.end_of_cell(SimpleNamespace(success=False))
    work(progress, clock)
    assert [line[-1] for line in shown.lines][1:] == ["Gauss-Newton, 100 %, error x 1.2"]


@pytest.mark.parametrize(
    ("success", "last"), [(True, "Gauss-Newton, 100 %"), (False, "Gauss-Newton, 60 %, about")]
)
def test_bar_of_work_that_never_says_its_end_is_full_when_its_cell_has_run(monkeypatch, success, last):
    shown, clock = FakeNotebook(monkeypatch), Clock()
    progress = NotebookProgress(clock)
    for share in (0.3, 0.6):
        clock.now += 2.0
        progress(Progress(stage="gauss_newton", done=share, total=1.0))
    shown.end_of_cell(SimpleNamespace(success=success))
    assert shown.lines[0][-1].startswith(last)
    work(progress, clock)
    shown.end_of_cell(SimpleNamespace(success=True))
    assert [len(shown.lines), shown.lines[0][-1].startswith(last)] == [2, True]


@pytest.mark.parametrize("kernel", [True, False])
def test_nothing_is_shown_without_a_notebook(monkeypatch, kernel):
    shown, clock = FakeNotebook(monkeypatch, kernel=False), Clock()
    if kernel:
        monkeypatch.delitem(sys.modules, "IPython")
    work(NotebookProgress(clock), clock)
    assert shown.lines == []


def test_a_run_shows_its_progress_in_a_notebook_unless_it_is_given_another():
    assert Run().progress is in_notebook
    assert Run() == Run()
