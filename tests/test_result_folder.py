"""A folder belongs to one result: held by one process, its files replaced together, the user's own left alone."""

import os
import tempfile
from contextlib import suppress
from pathlib import Path

import pytest

from ballbot import InputError
from ballbot.files import check_folder, write_text
from ballbot.result_folder import MANIFEST, STAGED, result_folder
from tests.support.processes import Child

NAMES = ("report.html", "results.json", "robot.toml", "figures/one.svg", "figures/two.svg")
OLD = {"report.html": "old", "results.json": "old", "figures/one.svg": "old"}
NEW = {"report.html": "new", "robot.toml": "new", "figures/two.svg": "new"}


def leave(
    folder: Path, texts: dict[str, str], *, command: str = "study", inputs: tuple[Path, ...] = ()
) -> None:
    """Write a result of these files."""
    with result_folder(folder, command=command, names=NAMES, inputs=inputs) as held, held.replaced() as new:
        for name, text in texts.items():
            write_text(new / name, text)


def shown(folder: Path) -> dict[str, str]:
    """Return the texts of what a person sees in a folder."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    names = {path: path.relative_to(folder).as_posix() for path in files}
    return {name: path.read_text() for path, name in names.items() if not name.startswith(".")}


def test_a_new_result_replaces_the_old_one_as_a_whole(tmp_path):
    leave(tmp_path, OLD)
    (tmp_path / "notes.txt").write_text("mine")
    leave(tmp_path, NEW)
    assert shown(tmp_path) == NEW | {"notes.txt": "mine"}
    assert {path.name for path in tmp_path.iterdir() if path.name.startswith(".")} == {MANIFEST}


class KilledError(BaseException):
    """Stands for the end of the process."""


@pytest.mark.parametrize("steps", range(12))
def test_a_move_that_is_killed_never_mixes_two_results_and_is_finished_later(tmp_path, monkeypatch, steps):
    leave(tmp_path, OLD)
    left = steps

    def counted(method):
        def call(*args, **options):
            nonlocal left
            left -= 1
            if left < 0:
                raise KilledError
            return method(*args, **options)

        return call

    with monkeypatch.context() as patch, result_folder(tmp_path, command="study", names=NAMES) as held:
        with suppress(KilledError), held.replaced() as new:
            for name, text in NEW.items():
                write_text(new / name, text)
            for method in ("replace", "unlink", "rmdir", "mkdir"):
                patch.setattr(Path, method, counted(getattr(Path, method)))
        patch.undo()
    seen = shown(tmp_path)
    assert set(seen.values()) in ({"old"}, {"new"}, set())
    assert left < 0 or steps == 11
    with result_folder(tmp_path, command="study", names=NAMES):
        pass
    assert shown(tmp_path) in (OLD, NEW)
    assert not (tmp_path / STAGED).exists()


def test_another_commands_result_is_refused(tmp_path):
    leave(tmp_path, OLD, command="identify")
    with pytest.raises(InputError, match=r"holds a result of ballbot identify\. Choose another folder"):
        leave(tmp_path, NEW)
    assert shown(tmp_path) == OLD


def test_an_input_is_not_replaced_by_what_is_made_from_it(tmp_path, monkeypatch):
    leave(tmp_path / "found", OLD | {"robot.toml": "old"})
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"robot\.toml is an input of this run"):
        leave(tmp_path / "found", NEW, inputs=(Path("found/../found/robot.toml"),))


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("robot.toml", r"robot\.toml exists already and is not part of a result"),
        ("results.json", r"results\.json has changed since ballbot study wrote it"),
    ],
)
def test_files_of_the_users_and_edited_results_are_not_replaced(tmp_path, name, sentence):
    leave(tmp_path, OLD)
    (tmp_path / name).write_text("mine")
    with pytest.raises(InputError, match=sentence):
        leave(tmp_path, NEW)


@pytest.mark.parametrize(
    "text", ["", "{}", '{"format": "ballbot result 1", "command": "study", "files": {"../../secret": ""}}']
)
def test_a_damaged_manifest_is_refused(tmp_path, text):
    leave(tmp_path, OLD)
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(InputError, match="is damaged"):
        leave(tmp_path, NEW)


HOLD = """
import sys, time
from ballbot.result_folder import result_folder
with result_folder(sys.argv[1], command="study", names=()):
    print("held", flush=True)
    time.sleep(600.0)
"""


def test_folder_is_locked_by_one_process(tmp_path):
    with Child("-c", HOLD, str(tmp_path)) as holder:
        assert holder.line() == "held"
        with pytest.raises(InputError, match="Another ballbot is writing into"):
            leave(tmp_path, NEW)
        holder.kill()
    leave(tmp_path, NEW)
    assert shown(tmp_path) == NEW


@pytest.mark.parametrize(
    "make",
    [Path.mkdir, os.mkfifo, lambda path: path.symlink_to(path), lambda path: path.symlink_to("/dev/null")],
)
def test_only_regular_files_are_written(tmp_path, make):
    path = tmp_path / "file"
    make(path)
    with pytest.raises(InputError):
        write_text(path, "text")
    assert not path.is_file()


def test_a_folder_that_cannot_be_written_into_is_refused_before_the_work(tmp_path, monkeypatch):
    def full(**_: object) -> None:
        raise OSError(28, "No space left on device")

    assert check_folder(tmp_path / "new") == tmp_path / "new"
    assert list((tmp_path / "new").iterdir()) == []
    # root may write anywhere, so that no mode forbids it
    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    with pytest.raises(InputError, match=r"Nothing can be written into .*: No space left on device"):
        check_folder(tmp_path)
