"""A user's controller from a Python file: all it is made of is known, and nothing in it ends the program."""

import copy
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest

from ballbot import InputError
from ballbot.cli.main import main
from ballbot.fitting import sweep
from ballbot.fitting.sweep import machine
from ballbot.result_folder import RUNS
from ballbot.robot.file import write_robot
from ballbot.workflows.candidates import UserController
from ballbot.workflows.comparison import ComparedRun, RunResult
from tests.support.control_examples import FRICTION, alten

PLAIN = """
class Mine:
    sample_time = 0.005
    def __init__(self, robot): {made}
    def reset(self): {reset}
    def update(self, t, state, reference):
        {updated}
        return [0.0, 0.0, 0.0]
"""


@pytest.fixture(autouse=True)
def own_modules():
    """Forget the modules and the folders that a test's controllers brought."""
    modules, folders = set(sys.modules), list(sys.path)
    yield
    for name in set(sys.modules) - modules:
        if "/pytest-" in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]
    sys.path[:] = folders


def write(folder: Path, head: str = "", *, made="pass", reset="pass", updated="pass") -> str:
    folder.mkdir(exist_ok=True)
    path = folder / "mine.py"
    path.write_text(head + PLAIN.format(made=made, reset=reset, updated=updated))
    return str(path)


def controller(folder: Path, head: str = "", *, made="pass", reset="pass", updated="pass") -> UserController:
    return UserController(write(folder, head, made=made, reset=reset, updated=updated), "Mine", alten())


@pytest.mark.parametrize("where", ["head", "made", "reset", "updated"])
def test_a_controller_cannot_end_the_program(tmp_path, where):
    with pytest.raises(InputError, match=r"mine\.py.*SystemExit: 3"):  # noqa: PT012
        one = controller(tmp_path, **{where: "import sys; sys.exit(3)"})
        one.reset()
        one.update(0.0, np.zeros(10), np.zeros(10))


@pytest.mark.parametrize(
    "head",
    [
        "def broken(:",
        "1 / 0",
        "import not_there_at_all",
    ],
)
def test_error_at_import_of_a_controller_is_one_sentence(tmp_path, head):
    with pytest.raises(InputError, match=r"mine\.py cannot be run: "):
        controller(tmp_path, head)


def test_a_file_that_is_changed_while_it_runs_is_noticed(tmp_path):
    one = controller(tmp_path)
    copy.deepcopy(one)
    (tmp_path / "mine.py").write_text((tmp_path / "mine.py").read_text() + "# 4")
    with pytest.raises(InputError, match=r"mine\.py was changed while .*mine\.py:Mine ran"):
        copy.deepcopy(one)


COURSE = '[league.stand]\nabout = "Stand."\nreference = "hold"\nduration = 0.5\nsettle = 0.2\n'


@pytest.fixture
def words(tmp_path, monkeypatch) -> list[str]:
    """Return a comparison of two controllers on a short course, in a folder with what it needs."""
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    Path("gain.py").write_text("value = 0.0")
    Path("courses.toml").write_text(COURSE)
    write_robot(alten(), "robot.toml")
    write(Path(), "import gain")
    words = ["compare", "robot.toml", "none", "mine.py:Mine", "--scenarios", "courses.toml", "--seeds", "1"]
    return [*words, "--plant", "twin", "--processes", "1", "--out", "league"]


def test_comparison_does_not_go_on_after_a_change(words, monkeypatch, capsys):
    made, whole = [], ComparedRun.result

    def one_run(run: ComparedRun) -> RunResult:
        if made:
            raise KeyboardInterrupt
        made.append(run)
        return whole(run)

    def refused(differing: str) -> None:
        capsys.readouterr()
        assert main(words) == 2
        printed = capsys.readouterr().err
        assert f"holds finished runs that differ from these in: {differing};" in printed
        assert printed.count("\n") == 1

    monkeypatch.setattr(ComparedRun, "result", one_run)
    assert main(words) == 130
    before = {path: path.read_bytes() for path in Path().glob("*.*")}
    for differing, change in {
        "controllers": lambda: write(Path(), "import gain, math"),
        "robot": lambda: write_robot(alten(FRICTION), "robot.toml"),
        "courses": lambda: Path("courses.toml").write_text(COURSE.replace("0.2", "0.3")),
    }.items():
        change()
        refused(differing)
        for path, content in before.items():
            path.write_bytes(content)
    monkeypatch.setattr(sweep, "machine", lambda: machine() | {"ballbot": "99.0"})
    refused("ballbot")
    assert len(made) == 1


def test_a_refused_controller_leaves_no_runs_in_the_way_of_the_mended_one(words, capsys):
    Path("gain.py").write_text("value = 1.0 / 0.0")
    write(Path(), updated="import gain")
    assert main(words) == 2
    assert "mine.py:Mine failed" in capsys.readouterr().err
    assert not Path("league").exists()
    Path("gain.py").write_text("value = 0.0")
    assert main(words) == 0


def test_finished_runs_survive_a_killed_worker(words, monkeypatch, capsys):
    class Killed(ThreadPoolExecutor):
        """A pool whose processes are killed after the first piece of work."""

        def submit(self, work, run):  # pyright: ignore[reportIncompatibleMethodOverride]
            if run.candidate == "none":
                found = super().submit(work, run)
                found.result()
                return found
            broken = Future()
            broken.set_exception(BrokenProcessPool())
            return broken

    words[words.index("--processes") + 1] = "2"
    with monkeypatch.context() as patch:
        patch.setattr(sweep, "worker_pool", Killed)
        patch.setattr(sweep, "as_completed", list)  # in their order
        assert main(words) == 2
    assert "Finished runs are kept; the same command goes on with them." in capsys.readouterr().err
    assert [path.name for path in Path("league", RUNS).glob("[!.]*")] == ["000000"]
    assert main(words) == 0
