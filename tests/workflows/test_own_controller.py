"""A user's controller from a Python file: all it is made of is known, and nothing in it ends the program."""

import copy
import sys
from pathlib import Path

import numpy as np
import pytest

from ballbot import InputError
from ballbot.workflows.candidates import UserController
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
