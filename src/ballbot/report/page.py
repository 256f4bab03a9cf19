"""What every result shares: its page rendered from a template, its values as JSON text, and its provenance.

Templates are in this package, and everything that they show is escaped but the figures. JSON knows no arrays and no
NaN. The provenance holds the command, the files, the seed and the versions: enough to make a result again and to see
whether it is the same.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import STATE_NAMES
from ballbot.printable import json_escaped, printable


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


def as_json(results: Mapping[str, object]) -> str:
    """Return results as JSON text: arrays as lists, what is not finite as null."""
    return json_escaped(json.dumps(_plain(results), indent=2, ensure_ascii=False, allow_nan=False)) + "\n"


def by_state(values: NDArray[np.float64]) -> dict[str, float]:
    """Return ten values by the states' names."""
    return dict(zip(STATE_NAMES, values.tolist(), strict=True))


def _plain(value: object) -> object:
    """Return what JSON can hold: plain containers, NaN and infinities as None."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(one) for one in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


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

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return asdict(self)


def provenance(*, command: str, files: Sequence[Path], seed: int | str) -> Provenance:
    """Return the provenance of a result made from `files` with the packages that are installed.

    Raises
    ------
    InputError
        Where a file cannot be read.
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
