"""A user's controller from a Python file: all it is made of is known, and nothing in it ends the program."""

import copy
import shlex
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from ballbot import Controller, InputError, Log
from ballbot.cli.main import main
from ballbot.control.source import UserController, named_controller
from tests.support.control_examples import alten

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


def controller(folder: Path, head: str = "", *, made="pass", reset="pass", updated="pass") -> UserController:
    path = folder / "mine.py"
    path.write_text(head + PLAIN.format(made=made, reset=reset, updated=updated))
    return UserController(str(path), "Mine", alten())


@pytest.mark.parametrize("where", ["head", "made", "reset", "updated"])
def test_a_controller_cannot_end_the_program(tmp_path, where):
    with pytest.raises(InputError, match=r"mine\.py.*SystemExit: 3"):  # noqa: PT012
        one = controller(tmp_path, **{where: "import sys; sys.exit(3)"})
        one.reset()
        one.update(0.0, np.zeros(10), np.zeros(10))


def test_a_file_that_is_changed_while_it_runs_is_noticed(tmp_path):
    one = controller(tmp_path)
    copy.deepcopy(one)
    (tmp_path / "mine.py").write_text((tmp_path / "mine.py").read_text() + "# 4")
    with pytest.raises(InputError, match=r"mine\.py was changed while .*mine\.py:Mine ran"):
        copy.deepcopy(one)


#: a law as docs/python.md has it, and a design; no object with update
MADE = """
from ballbot.control.presets import nominal_controller
def law(robot):
    return nominal_controller(robot).update
def design(robot):
    return nominal_controller(robot, compensation="full")
"""


def test_a_function_is_a_controller_for_every_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(MADE)
    short = ["alten", "--duration", "1", "--reference", "hold", "--out"]
    assert main(["simulate", *short, "nominal"]) == 0
    assert main(["simulate", *short, "law", "--controller", "own.py:law"]) == 0
    logs = [Log.read(Path(name) / "log.csv") for name in ("nominal", "law")]
    np.testing.assert_array_equal(logs[0].torques, logs[1].torques)
    assert isinstance(named_controller("own.py:design", alten()), Controller)  # as good as a file
    with pytest.raises(InputError, match=r"own\.py:law is a controller of your own"):
        named_controller("own.py:law", alten())


def test_a_recording_by_an_own_controller_is_repeated_by_its_command(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    (tmp_path / "own.py").write_text(MADE)
    source = f"{tmp_path / 'own.py'}:law"
    options = ["--controller", source, "--estimator", "kalman", "--duration", "0.5", "--reference", "hold"]
    assert main(["record", "nominal", *options, "--out", str(tmp_path / "run")]) == 0
    monkeypatch.chdir(tmp_path / "run")
    again = tomllib.loads(Path("record.toml").read_text(encoding="utf-8"))["run"]["command"]
    assert main(shlex.split(again)[1:]) == 0
    assert Path("again/log.csv").read_bytes() == Path("log.csv").read_bytes()
