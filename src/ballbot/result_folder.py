"""A folder that belongs to one result: locked while it is worked on, its files replaced together or not at all.

What a command writes is collected out of sight, in STAGED; its MANIFEST comes last, with the command and each file's
checksum. Then the files of the result before are deleted and the new ones take their places. A process that is killed
on the way leaves the old result, or STAGED with its MANIFEST, from which the next command that opens the folder
finishes the move: never files of two results side by side. By the MANIFEST files of the user's are known from the
result's, and are neither replaced nor deleted.

One process at a time holds the folder's lock; the system releases it when that process ends or dies. On Windows, and
on network drives without locks, two commands at work in one folder are not noticed.
"""

import json
import os
import shutil
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ballbot.errors import InputError
from ballbot.files import check_folder, sha256_of, write_text
from ballbot.processes import uninterrupted

MANIFEST = ".ballbot.json"
STAGED = ".ballbot-staged"

_FORMAT = "ballbot result 1"


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock while the block runs; InputError if another process holds it."""
    if sys.platform == "win32":  # which opens no folder
        yield
        return
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network drives have no locks
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(
                    f"Another ballbot is writing into {folder}; wait until it has finished, or choose another folder "
                    "with --out."
                ) from None
        yield
    finally:
        os.close(descriptor)


@dataclass(frozen=True, kw_only=True)
class ResultFolder:
    """A folder that is held for one command; made by `result_folder`."""

    path: Path
    command: str
    names: Collection[str]

    @contextmanager
    def replaced(self) -> Iterator[Path]:
        """Give a folder to write the new result into, which replaces the old one as a whole when the block ends well.

        InputError if the new result cannot be written; the old one is then as it was. A move that fails half way is
        finished by the next command that opens the folder.
        """
        staged = self.path / STAGED
        _delete(staged)
        try:
            staged.mkdir()
        except OSError as error:
            raise InputError(f"Nothing can be written into {self.path}: {error.strerror or error}.") from None
        try:
            yield staged
            files = [path for path in sorted(staged.rglob("*")) if path.is_file()]
            checksums = {path.relative_to(staged).as_posix(): sha256_of(path) for path in files}
            undeclared = set(checksums).difference(self.names)
            assert not undeclared, f"written but not declared: {undeclared}"
            manifest = {"format": _FORMAT, "command": self.command, "files": checksums}
            write_text(staged / MANIFEST, json.dumps(manifest, indent=2) + "\n")
        except BaseException as error:
            _delete(staged)
            if isinstance(error, InputError):  # the user knows of no folder but the result's
                error.args = (str(error).replace(str(staged), str(self.path)),)
            raise
        with uninterrupted():
            _finish_move(self.path)


@contextmanager
def result_folder(
    out: str | Path,  # made if it is not there
    *,
    command: str,  # whose result it is to be, as "study"
    names: Collection[str],  # the files that the command may write there, as "figures/one.svg"
    inputs: Sequence[Path] = (),  # the files that the result is made from
) -> Iterator[ResultFolder]:
    """Hold a folder for the result of one command while the block runs.

    InputError if another process holds the folder; if it has another command's result, or files by
    these names that are no result's or were changed since; or if an input would be replaced.
    """
    was_there = os.path.exists(out)
    folder = check_folder(out)
    try:
        with _locked(folder):
            _finish_move(folder)
            _check_replaceable(folder, command=command, names=names, inputs=inputs)
            yield ResultFolder(path=folder, command=command, names=names)
    finally:
        if not was_there:
            with suppress(OSError):  # it is of use to somebody
                folder.rmdir()


def _read_manifest(folder: Path) -> tuple[str, Mapping[str, str]]:
    """Return a result's command and the checksums of its files; InputError if they are damaged."""
    path = folder / MANIFEST
    try:
        read = json.loads(path.read_bytes())
        command, files = read["command"], dict(read["files"])
        paths = map(PurePosixPath, files)  # none may lead out of the folder
        if read["format"] != _FORMAT or any(one.is_absolute() or ".." in one.parts for one in paths):
            raise ValueError
        return command, files
    except FileNotFoundError:
        return "", {}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            f"{path}, the list of result files, is damaged. Choose another folder with --out, or delete the "
            "result."
        ) from None


def _check_replaceable(folder: Path, *, command: str, names: Collection[str], inputs: Sequence[Path]) -> None:
    """Raise InputError unless the result in the folder, if there is one, may give way to a new one."""
    old, files = _read_manifest(folder)
    if old not in ("", command):
        raise InputError(
            f"{folder} holds a result of ballbot {old}. Choose another folder with --out, so that results do not mix."
        )
    read = {os.path.realpath(path) for path in inputs}
    for name in sorted({*files, *names}):
        path = folder / name
        if os.path.realpath(path) in read:
            wrong = "is an input of this run, and the result would overwrite it. Choose"
        elif name not in files and (path.exists() or path.is_symlink()):
            wrong = f"exists already and is not part of a result of ballbot {command}. Move it, or choose"
        elif name in files and path.exists() and not (path.is_file() and sha256_of(path) == files[name]):
            wrong = f"has changed since ballbot {command} wrote it. Move it, or choose"
        else:
            continue
        raise InputError(f"{path} {wrong} another folder with --out.")


def _finish_move(folder: Path) -> None:
    """Put the files of STAGED, if it is whole, into the places of the old result's; begun again where it stopped."""
    staged = folder / STAGED
    if (staged / MANIFEST).is_file():
        _, new = _read_manifest(staged)
        _, old = _read_manifest(folder)
        try:
            for name in (*old, MANIFEST):
                (folder / name).unlink(missing_ok=True)
            for name in (*new, MANIFEST):
                if (staged / name).exists():  # not moved before
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    (staged / name).replace(folder / name)
        except OSError as error:
            raise InputError(
                f"The result cannot be moved from {staged}: {error.strerror or error}."
            ) from None
    _delete(staged)


def _delete(path: Path) -> None:
    """Delete a folder of ours with all in it; a link or a file in its place is deleted itself."""
    if path.is_symlink() or path.is_file():
        path.unlink()
    elif path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
