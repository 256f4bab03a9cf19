"""A folder that belongs to one result: locked while it is worked on, its files replaced together or not at all.

What a command writes is collected out of sight, in STAGED; its MANIFEST comes last, with the command and each file's
checksum. Then the files of the result before are deleted and the new ones take their places. A process that is killed
on the way leaves the old result, or STAGED with its MANIFEST, from which the next command that opens the folder
finishes the move: never files of two results side by side. By the MANIFEST files of the user's are known from the
result's, and are neither replaced nor deleted.

One process at a time holds the folder's lock; the system releases it when that process ends or dies. On Windows, and
on network drives without locks, two commands at work in one folder are not noticed.
"""

from __future__ import annotations

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


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock while the block runs; file systems without locks, as some network drives, have none.

    InputError if another process holds it.
    """
    if sys.platform == "win32":  # which opens no folder
        yield
        return
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
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


MANIFEST = ".ballbot.json"
STAGED = ".ballbot-staged"

_FORMAT = "ballbot result 1"


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """What a folder's result is made of."""

    command: str  #: as "study"
    files: Mapping[str, str]  #: SHA-256 by path below the folder, with forward slashes

    def changed_file(self, folder: Path) -> str | None:
        """Return a file that is there and is not as it was written, or None."""
        for name, checksum in self.files.items():
            if (folder / name).exists() and not _has(folder / name, checksum):
                return name
        return None

    def missing_file(self, folder: Path) -> str | None:
        """Return a file that is not there, or None."""
        return next((name for name in self.files if not (folder / name).exists()), None)


@dataclass(frozen=True, kw_only=True)
class ResultFolder:
    """A folder that is held for one command; made by `result_folder`."""

    path: Path
    command: str
    names: frozenset[str]

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
            undeclared = set(checksums) - self.names
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
    # the files that the command may write there, as "report.html" or "figures/one.svg"
    names: Collection[str],
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
            _prepare(folder, command=command, names=names, inputs=inputs)
            yield ResultFolder(path=folder, command=command, names=frozenset(names))
    finally:
        if not was_there:
            with suppress(OSError):  # it is of use to somebody
                folder.rmdir()


def _prepare(folder: Path, *, command: str, names: Collection[str], inputs: Sequence[Path]) -> None:
    """Finish or clear what a killed process left, and raise InputError unless the folder may have a new result."""
    _finish_move(folder)
    _check_replaceable(folder, read_manifest(folder), command=command, names=names, inputs=inputs)


def read_manifest(folder: Path) -> Manifest | None:
    """Return what a folder's result is made of, or None if it has none; InputError if that is damaged."""
    path = folder / MANIFEST
    try:
        read = json.loads(path.read_bytes())
        command, files = read["command"], read["files"]
        paths = [PurePosixPath(name) for name in files]  # none may lead out of the folder
        if read["format"] != _FORMAT or any(one.is_absolute() or ".." in one.parts for one in paths):
            raise ValueError
        return Manifest(command=command, files=dict(files))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(
            f"{path}, the list of result files, is damaged. Choose another folder with --out, or delete the "
            "result."
        ) from None


def _check_replaceable(
    folder: Path, old: Manifest | None, *, command: str, names: Collection[str], inputs: Sequence[Path]
) -> None:
    """Raise InputError unless the result in the folder, if there is one, may give way to a new one."""
    files = {} if old is None else old.files
    if old and old.command != command:
        raise InputError(
            f"{folder} holds a result of ballbot {old.command}. Choose another folder with --out, so that "
            "results do not mix."
        )
    read = {os.path.realpath(path) for path in inputs}
    for name in sorted({*files, *names}):
        path = folder / name
        if os.path.realpath(path) in read:
            raise InputError(
                f"{path} is an input of this run, and the result would overwrite it. Choose another folder with "
                "--out."
            )
        if name not in files and (path.exists() or path.is_symlink()):
            raise InputError(
                f"{path} exists already and is not part of a result of ballbot {command}. Move it, or choose "
                "another folder with --out."
            )
    changed = old.changed_file(folder) if old else None
    if changed:
        raise InputError(
            f"{folder / changed} has changed since ballbot {command} wrote it. Move it, or choose another "
            "folder with --out."
        )


def _finish_move(folder: Path) -> None:
    """Put the files of STAGED, if it is whole, into the places of the old result's; begun again where it stopped."""
    staged = folder / STAGED
    new = read_manifest(staged) if staged.is_dir() else None
    if new is not None:
        old = read_manifest(folder)
        try:
            for name in old.files if old else ():
                (folder / name).unlink(missing_ok=True)
            (folder / MANIFEST).unlink(missing_ok=True)
            for name in new.files:
                if (staged / name).exists():  # not moved before
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    (staged / name).replace(folder / name)
            (staged / MANIFEST).replace(folder / MANIFEST)
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


def _has(path: Path, checksum: str) -> bool:
    try:
        return path.is_file() and sha256_of(path) == checksum
    except OSError:
        return False
