"""The files that a user's Python file depends on: itself, the modules that it imports, and the files that it reads.

Modules are found in two ways, since neither is complete: in the text, which also names those that are imported later,
and among the modules imported when the file was run, which include those whose names the text computes. Ballbot, Python
and installed packages are excluded; a result states their versions.
"""

from __future__ import annotations

import ast
import hashlib
import os
import site
import sys
import sysconfig
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import MappingProxyType

import ballbot

#: a file's SHA-256 by its path
Checksums = Mapping[str, str]

_INSTALLED = tuple(
    dict.fromkeys(
        Path(path).resolve()
        for path in (
            *(sysconfig.get_paths()[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")),
            *site.getsitepackages(),
            site.getusersitepackages(),
            Path(ballbot.__file__).parent,
        )
    )
)


def checksums_of(paths: Iterable[Path]) -> Checksums:
    """Return the SHA-256 of files by their paths, sorted; empty for a file that cannot be read."""
    return MappingProxyType({str(path): _sha256(path) for path in sorted(set(paths))})


def changed_file(checksums: Checksums) -> str | None:
    """Return a file that has changed since, or None."""
    return next((path for path, before in checksums.items() if _sha256(Path(path)) != before), None)


def files_named(file: Path) -> Iterator[Path]:
    """Yield the file and the users' modules that its text imports, and theirs, found from its folder and sys.path."""
    seen: set[Path] = set()
    waiting = [file.resolve()]
    while waiting:
        one = waiting.pop()
        if one in seen:
            continue
        seen.add(one)
        yield one
        waiting += _imported(one, (file.resolve().parent, *map(Path, sys.path)))


def modules_imported() -> set[Path]:
    """Return the files of the users' modules that were imported since this module was."""
    return _users_modules() - _AT_START


class _OpenRecorder:
    """Records which files Python opens. A hook cannot be removed, so that there is one, which can be switched on."""

    def __init__(self) -> None:
        self.opened: set[str] | None = None
        self.installed = False

    def __call__(self, event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and self.opened is not None and _reads(*arguments[1:3]):
            name = arguments[0]
            if isinstance(name, str | bytes):  # not a descriptor
                self.opened.add(os.fsdecode(name))


_recorder = _OpenRecorder()


@contextmanager
def files_opened(beside: Path) -> Iterator[Callable[[], set[Path]]]:
    """Yield a function that returns the files opened in the block so far, in a folder or the current one."""
    if not _recorder.installed:
        sys.addaudithook(_recorder)
        _recorder.installed = True
    before, opened = _recorder.opened, set[str]()
    _recorder.opened = opened
    folders = (beside.resolve(), Path.cwd())
    try:
        yield lambda: {path for one in opened if _is_beside(path := Path(one).resolve(), folders)}
    finally:
        _recorder.opened = before
        if before is not None:
            before |= opened


def _reads(mode: object, flags: object) -> bool:
    """Return whether a file is opened to read only, by the arguments of `open` or `os.open`."""
    if isinstance(mode, str):
        return not set(mode) & set("wax+")
    return isinstance(flags, int) and not flags & (os.O_WRONLY | os.O_RDWR)


def _users_modules() -> set[Path]:
    """Return the files of the modules that are imported now and are neither Python's, installed nor Ballbot's."""
    named = {getattr(module, "__file__", None) for module in list(sys.modules.values())}
    found = {_users_file(one) for one in named if isinstance(one, str)}
    return {path for path in found if path is not None and path.is_file()}


@cache
def _users_file(name: str) -> Path | None:
    """Return a module's file if it is a user's, or None."""
    path = Path(name).resolve()
    return path if _is_users(path) else None


def _imported(file: Path, folders: tuple[Path, ...]) -> list[Path]:
    """Return the users' files that the text of one imports."""
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return []
    found: list[Path] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                found += _files(alias.name, folders)
        elif isinstance(node, ast.ImportFrom):
            within = (file.parents[node.level - 1],) if 0 < node.level <= len(file.parents) else folders
            base = node.module or ""
            found += _files(base, within)
            for alias in node.names:  # may be modules
                found += _files(f"{base}.{alias.name}".lstrip("."), within)
    return [path for path in found if _is_users(path)]


def _files(name: str, folders: Iterable[Path]) -> list[Path]:
    """Return the files that importing a module runs: its own and those of its packages."""
    parts = [part for part in name.split(".") if part]
    for folder in folders:
        found: list[Path] = []
        place = folder
        for part in parts:
            place /= part
            candidates = (place / "__init__.py", place.with_name(f"{part}.py"))
            found += [path.resolve() for path in candidates if path.is_file()]
        if found:
            return found
    return []


def _is_users(path: Path) -> bool:
    return path.suffix == ".py" and not any(path.is_relative_to(place) for place in _INSTALLED)


def _is_beside(path: Path, folders: tuple[Path, ...]) -> bool:
    """Return whether a path is a regular file in one of the folders, neither hidden nor Python's own."""
    for folder in folders:
        if path.is_relative_to(folder):
            parts = path.relative_to(folder).parts
            ours = not any(part.startswith(".") or part == "__pycache__" for part in parts)
            return ours and path.is_file() and not any(path.is_relative_to(place) for place in _INSTALLED)
    return False


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


#: modules imported before any file of a user is run
_AT_START = _users_modules()
