"""What every result shares: a page rendered from a template, and the provenance.

Templates are in this package. Everything that they show is escaped, except figures. The provenance holds the command,
the files, the seed and the versions: enough to make a result again and to check that it is the same.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import STATE_NAMES
from ballbot.printable import printable


def render(template: str, values: Mapping[str, object]) -> str:
    """Return the page of a template of this package as HTML; a name that the template lacks is an error."""
    environment = Environment(
        loader=PackageLoader("ballbot.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_printable_text,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(f"{template}.html.j2").render(values)


def _printable_text(value: object) -> object:
    """Return what a template puts into the page: text of others' making with nothing hidden in it."""
    return printable(value) if type(value) is str else value


def figure_markup(svg: str) -> Markup:
    """Return a figure as what a template puts into the page unescaped."""
    return Markup(svg)


def by_state(values: NDArray[np.float64]) -> dict[str, float]:
    """Return ten values by the states' names."""
    return dict(zip(STATE_NAMES, values.tolist(), strict=True))


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
    """Return the provenance of a result made from `files` with the packages that are installed.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    return Provenance(
        command=command,
        files=tuple(SourceFile(name=str(path), sha256=_sha256(path)) for path in files),
        seed=seed,
        versions={"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
    )


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
