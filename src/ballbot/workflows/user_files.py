"""Which files a user's Python file is made of: itself, the modules that it imports, and what it reads beside them.

Modules are found in two ways, since neither sees all: in the text, which names those that are imported later on as
well, and in what was imported when the file was run, which names those that the text computes. Ballbot, Python and
installed packages are left out; their versions belong to a result as they are.
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
    """Return the SHA-256 of files by their paths, sorted; of one that cannot be read, no digits."""
    return MappingProxyType({str(path): _sha256(path) for path in sorted(set(paths))})


def changed_file(checksums: Checksums) -> str | None:
    """Return a file that is not any more as it was, or None."""
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


class _Listener:
    """Hears which files Python opens; a hook cannot be removed, so that there is one, which listens now and then."""

    def __init__(self) -> None:
        self.heard: set[str] | None = None
        self.installed = False

    def __call__(self, event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and self.heard is not None and _reads(*arguments[1:3]):
            name = arguments[0]
            if isinstance(name, str | bytes):  # not a descriptor
                self.heard.add(os.fsdecode(name))


_listener = _Listener()


@contextmanager
def files_opened(beside: Path) -> Iterator[Callable[[], set[Path]]]:
    """Give a function that returns the files in a folder, or in this one, that were opened in the block so far."""
    if not _listener.installed:
        sys.addaudithook(_listener)
        _listener.installed = True
    before, heard = _listener.heard, set[str]()
    _listener.heard = heard
    folders = (beside.resolve(), Path.cwd())
    try:
        yield lambda: {path for one in heard if _is_beside(path := Path(one).resolve(), folders)}
    finally:
        _listener.heard = before
        if before is not None:
            before |= heard


def _reads(mode: object, flags: object) -> bool:
    """Return whether a file is opened to read only, by what `open` or `os.open` was given."""
    if isinstance(mode, str):
        return not set(mode) & set("wax+")
    return isinstance(flags, int) and not flags & (os.O_WRONLY | os.O_RDWR)


def _users_modules() -> set[Path]:
    """Return the files of the modules that are imported now and are neither Python's, installed nor Ballbot's."""
    named = [getattr(module, "__file__", None) for module in list(sys.modules.values())]
    return {path for one in named if isinstance(one, str) and _is_users(path := Path(one).resolve())}


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
    """Return the files that importing a module runs: of the packages that it is in, and its own."""
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
    """Return whether a path is of a regular file in one of the folders, neither hidden nor Python's own."""
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


#: what was imported before any file of a user's was run
_AT_START = _users_modules()
