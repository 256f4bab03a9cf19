"""The files of a user's controller: its Python file and the modules beside it that it imports, however deep."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

#: a file's SHA-256 by its path
Checksums = Mapping[str, str]


def checksums_of(file: Path) -> Checksums:
    """Return the SHA-256 of each of a controller's files by its path, sorted."""
    return MappingProxyType({str(path): _sha256(path) for path in sorted(set(files_named(file)))})


def changed_file(checksums: Checksums) -> str | None:
    """Return a file that has changed since, or None."""
    return next((path for path, before in checksums.items() if _sha256(Path(path)) != before), None)


def files_named(file: Path) -> Iterator[Path]:
    """Yield the file and the modules in its folder or below that its text imports, and theirs."""
    seen: set[Path] = set()
    waiting = [file.resolve()]
    while waiting:
        one = waiting.pop()
        if one not in seen:
            seen.add(one)
            yield one
            waiting += _imported(one, file.resolve().parent)


def _imported(file: Path, folder: Path) -> list[Path]:
    """Return the files in a folder that the text of one imports."""
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return []
    found: list[Path] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                found += _files(alias.name, folder)
        elif isinstance(node, ast.ImportFrom):
            within = file.parents[node.level - 1] if 0 < node.level <= len(file.parents) else folder
            base = node.module or ""
            found += _files(base, within)
            for alias in node.names:  # may be modules
                found += _files(f"{base}.{alias.name}".lstrip("."), within)
    return found


def _files(name: str, folder: Path) -> list[Path]:
    """Return the files in a folder that importing a module runs: its own and those of its packages."""
    found: list[Path] = []
    for part in filter(None, name.split(".")):
        folder /= part
        found += [one for one in (folder / "__init__.py", folder.with_name(f"{part}.py")) if one.is_file()]
    return found


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
