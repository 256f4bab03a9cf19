"""A user's controller from a Python file: all it is made of is known, and nothing in it ends the program."""

import copy
import os
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest
from ballbot.fitting.checkpoint import machine

from ballbot import InputError
from ballbot.cli.main import main
from ballbot.fitting import checkpoint
from ballbot.robot.file import write_robot
from ballbot.workflows import comparison
from ballbot.workflows.candidates import UserController
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


@pytest.mark.parametrize("call", ["import sys; sys.exit(3)", "raise SystemExit('so')", "exit()", "quit(0)"])
@pytest.mark.parametrize("where", ["head", "made", "reset", "updated"])
def test_a_controller_cannot_end_the_program(tmp_path, call, where):
    with pytest.raises(InputError, match=r"mine\.py.*called sys\.exit"):  # noqa: PT012
        one = controller(tmp_path, **{where: call})
        one.reset()
        one.update(0.0, np.zeros(10), np.zeros(10))


@pytest.mark.parametrize("where", ["head", "made", "reset", "updated"])
def test_a_controller_cannot_end_the_process_silently(tmp_path, where):
    with pytest.raises(InputError, match=r"mine\.py.*called os\._exit\(0\)"):  # noqa: PT012
        one = controller(tmp_path, **{where: "import os; os._exit(0)"})
        one.reset()
        one.update(0.0, np.zeros(10), np.zeros(10))
    assert os._exit is sys.modules["posix" if os.name == "posix" else "nt"]._exit


SILENT = """\
class E(Exception):
    def __str__(self):
        raise ValueError
raise E
"""


@pytest.mark.parametrize(
    "head",
    [
        "def broken(:",
        "raise BaseException('so')",
        "1 / 0",
        "import not_there_at_all",
        SILENT,
        "raise GeneratorExit",
    ],
)
def test_error_at_import_of_a_controller_is_one_sentence(tmp_path, head):
    with pytest.raises(InputError, match=r"mine\.py cannot be run: "):
        controller(tmp_path, head)


def test_the_modules_that_it_imports_belong_to_it(tmp_path):
    (tmp_path / "first.py").write_text("import second")
    (tmp_path / "second.py").write_text("from package import third")
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "third.py").write_text("")
    for name in ("later.py", "computed.py", "unused.py", "gains.txt"):
        (tmp_path / name).write_text("")
    head = (
        "import first, numpy, importlib\n"
        "importlib.import_module('com' + 'puted')\n"
        f"open({str(tmp_path / 'gains.txt')!r}).read()\n"
        f"open({str(tmp_path / 'written.txt')!r}, 'w').close()\n"
    )
    expected = {
        "mine.py",
        "first.py",
        "second.py",
        "package/third.py",
        "later.py",
        "computed.py",
        "gains.txt",
    }
    for _ in range(2):
        one = controller(tmp_path, head, updated="import later")
        # modules of earlier tests in this process may count, too
        own = (Path(path) for path in one.checksums if Path(path).is_relative_to(tmp_path))
        assert {path.relative_to(tmp_path).as_posix() for path in own} == expected


@pytest.mark.parametrize("name", ["mine.py", "helper.py", "gains.txt"])
def test_a_file_that_is_changed_while_it_runs_is_noticed(tmp_path, name):
    (tmp_path / "helper.py").write_text("")
    (tmp_path / "gains.txt").write_text("1 2 3")
    one = controller(tmp_path, "import helper", made=f"open({str(tmp_path / 'gains.txt')!r}).read()")
    copy.deepcopy(one)
    (tmp_path / name).write_text((tmp_path / name).read_text() + "# 4")
    with pytest.raises(InputError, match=rf"{name} was changed while .*mine\.py:Mine ran"):
        copy.deepcopy(one)


def test_two_controllers_do_not_share_a_name_for_two_modules(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "helper.py").write_text(f"name = {folder!r}")
    controller(tmp_path / "a", "import helper")
    with pytest.raises(
        InputError, match=r"b/mine\.py imports helper, but .*a/helper\.py is in use under that name"
    ):
        controller(tmp_path / "b", "import helper")


COURSE = '[league.stand]\nabout = "Stand."\nreference = "hold"\nduration = 1.0\nsettle = 0.2\n'


def change_an_imported_module(_: pytest.MonkeyPatch) -> None:
    Path("gain.py").write_text("value = 1.0")


def change_the_robot(_: pytest.MonkeyPatch) -> None:
    write_robot(alten(FRICTION), "robot.toml")


def change_a_course(_: pytest.MonkeyPatch) -> None:
    Path("courses.toml").write_text(COURSE.replace("0.2", "0.3"))


def update_ballbot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "machine", lambda: machine() | {"ballbot": "99.0"})


def update_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "_mujoco", lambda: "99.0")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (change_an_imported_module, "belongs to another run, which differs in: gain.py;"),
        (change_the_robot, "belongs to another run, which differs in: robot;"),
        (change_a_course, "belongs to another run, which differs in: courses;"),
        (update_mujoco, "belongs to another run, which differs in: mujoco;"),
        (
            update_ballbot,
            f"was begun by Ballbot {machine()['ballbot']}, and this is Ballbot 99.0; resume it with",
        ),
    ],
)
def test_comparison_is_not_resumed_after_a_change(tmp_path, monkeypatch, capsys, change, sentence):
    monkeypatch.chdir(tmp_path)
    Path("gain.py").write_text("value = 0.0")
    Path("courses.toml").write_text(COURSE)
    write_robot(alten(), "robot.toml")
    write(Path(), "import gain")
    words = ["compare", "robot.toml", "none", "mine.py:Mine", "--scenarios", "courses.toml", "--seeds", "1"]
    words += ["--processes", "1", "--out", "league"]
    made, whole = [], comparison._result

    def one_run(run):
        if made:
            raise KeyboardInterrupt
        made.append(run)
        return whole(run)

    monkeypatch.setattr(comparison, "_result", one_run)
    assert main(words) == 130
    capsys.readouterr()
    change(monkeypatch)
    assert main([*words, "--resume"]) == 2
    printed = capsys.readouterr().err
    assert sentence in printed
    assert printed.count("\n") == 1
    assert len(made) == 1


def test_finished_runs_survive_a_killed_worker(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("courses.toml").write_text(COURSE)

    class Killed(ThreadPoolExecutor):
        """A pool whose processes are killed after the first piece of work."""

        def submit(self, work, run):  # pyright: ignore[reportIncompatibleMethodOverride]
            if run.candidate == "none":
                return super().submit(work, run)
            broken = Future()
            broken.set_exception(BrokenProcessPool())
            return broken

    whole = comparison.worker_pool
    monkeypatch.setattr(comparison, "worker_pool", Killed)
    words = ["compare", "alten", "none", "full", "--scenarios", "courses.toml", "--seeds", "1"]
    words += ["--processes", "2", "--out", "league"]
    assert main(words) == 2
    assert "continue with --resume" in capsys.readouterr().err
    assert Path("league/checkpoint.jsonl").exists()
    monkeypatch.setattr(comparison, "worker_pool", whole)
    assert main([*words, "--resume"]) == 0
