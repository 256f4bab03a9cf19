"""Where a result comes from: the command, the files, the seed and the versions.

Enough to make a result again and to check that it is the same.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from ballbot.errors import InputError
from ballbot.files import check_regular, sha256_of

_PACKAGES = ("ballbot", "numpy", "scipy", "numba", "cmaes")


@dataclass(frozen=True, kw_only=True)
class SourceFile:
    """A file that a result was made from."""

    name: str  #: as it was given
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """What a result was made from and with."""

    command: str  #: that makes it again
    files: tuple[SourceFile, ...]
    seed: int | str  #: or several, as 1-20
    versions: dict[str, str]  #: Python's and the packages' that the numbers depend on


def provenance(*, command: str, files: Sequence[Path], seed: int | str) -> Provenance:
    """Return the provenance of a result made from `files`; InputError if one cannot be read."""
    sources = []
    for path in _single_files(files):
        check_regular(path)  # reading a pipe would never end
        try:
            sources.append(SourceFile(name=str(path), sha256=sha256_of(path)))
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    return Provenance(
        command=command,
        files=tuple(sources),
        seed=seed,
        versions={"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
    )


def _single_files(paths: Sequence[Path]) -> Iterator[Path]:
    """Yield the files, and in place of a ROS 2 bag's folder those that it consists of."""
    for path in paths:
        yield from sorted(path.iterdir()) if path.is_dir() else (path,)
