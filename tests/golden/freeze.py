"""What a golden keeps of the files that a command writes.

Kept: every number, truth value and word of results.json and of TOML files, each column of CSV files, the elements of
MJCF, the data of replay.html, the names of all other files, and the exit code.
Not kept:

- keys in `REMOVED_KEYS`, which differ from run to run or version to version, or whenever a file's comments change;
- files in `REMOVED_FILES`, for the same reason;
- prose: any string with a space in it becomes `PROSE`, so that sentences may be rewritten. Codes, severities,
  verdicts, units and names of one word stay.

A list of more than `LONGEST` numbers becomes a text: `DIGEST`, its shape, its first, middle and last number, and a
checksum of all of them. A word longer than `LONGEST_WORD`, as the packed column of a replay, becomes its checksum.
"""

import csv
import hashlib
import importlib.metadata
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"

REMOVED_KEYS = frozenset({"provenance", "checksum", "format", "ballbot"})
REMOVED_FILES = frozenset({".ballbot.json", "record.toml"})
PROSE = "<prose>"
#: how the text begins that stands for a long list
DIGEST = "<numbers>"
LONGEST = 9  #: numbers
LONGEST_WORD = 500  #: characters

_PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "mujoco", "opencv-python-headless", "ziglang")


def freeze_folder(folder: Path, *, code: int) -> Json:
    """Return what a golden keeps of a finished command.

    Parameters
    ----------
    folder : Path
        What the command wrote; it may be missing.
    code : int
        The exit code.
    """
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name not in REMOVED_FILES)
    return {"exit_code": code} | {path.relative_to(folder).as_posix(): _freeze_file(path) for path in files}


def freeze(value: Json) -> Json:
    """Return a value without what differs from run to run, without prose, and with digests of long lists."""
    if isinstance(value, dict):
        return {key: freeze(one) for key, one in value.items() if key not in REMOVED_KEYS}
    if isinstance(value, str):
        if " " not in value.strip() and len(value) > LONGEST_WORD:
            return f"{DIGEST} [{len(value)}] sha256 {hashlib.sha256(value.encode()).hexdigest()[:16]}"
        return PROSE if " " in value.strip() else value
    if isinstance(value, list):
        shape = _shape(value)
        numbers = _leaves(value) if shape is not None else []
        if shape is not None and len(numbers) > LONGEST:
            return _digest(numbers, shape)
        return [freeze(one) for one in value]
    return value


def machine() -> dict[str, str]:
    """Return the processor and the packages that last digits depend on."""
    from llvmlite.binding import get_host_cpu_name

    return {"processor": get_host_cpu_name()} | {name: importlib.metadata.version(name) for name in _PACKAGES}


def _freeze_file(path: Path) -> Json:
    if path.suffix == ".json":
        return freeze(json.loads(path.read_text(encoding="utf-8")))
    if path.suffix == ".toml":
        return freeze(tomllib.loads(path.read_text(encoding="utf-8")))
    if path.suffix == ".csv":
        return _freeze_columns(path)
    if path.suffix == ".xml":
        return _freeze_xml(path)
    if path.name == "replay.html":
        found = re.search(
            r'<script type="application/json"[^>]*>(.*?)</script>', path.read_text("utf-8"), re.DOTALL
        )
        return freeze(json.loads(found[1])) if found else None
    return None


def _freeze_columns(path: Path) -> Json:
    with path.open(encoding="utf-8", newline="") as stream:
        heading, *rows = csv.reader(stream)
    columns: list[list[Json]] = [[_number(row[k]) for row in rows] for k in range(len(heading))]
    return {name: freeze(column) for name, column in zip(heading, columns, strict=True)}


def _freeze_xml(path: Path) -> Json:
    elements = [f"{one.tag} {sorted(one.attrib.items())}" for one in ElementTree.parse(path).iter()]
    text = "\n".join(elements)
    return {"elements": len(elements), "sha256": hashlib.sha256(text.encode()).hexdigest()}


def _number(text: str) -> Json:
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        return text


def _shape(value: Sequence[Json]) -> list[int] | None:
    """Return the shape of a list of numbers, or of lists of them of one length; None if it is another list."""
    if all(one is None or isinstance(one, int | float) for one in value):
        return [len(value)]
    shapes = [_shape(one) if isinstance(one, list) else None for one in value]
    first = shapes[0]
    return [len(value), *first] if first is not None and all(one == first for one in shapes) else None


def _leaves(value: Json) -> list[Json]:
    return [leaf for one in value for leaf in _leaves(one)] if isinstance(value, list) else [value]


def _digest(numbers: Sequence[Json], shape: list[int]) -> str:
    text = json.dumps(numbers)  # a float as its repr, which no two floats share
    shown = ", ".join(json.dumps(numbers[place]) for place in (0, len(numbers) // 2, -1))
    return f"{DIGEST} {shape} {shown}, sha256 {hashlib.sha256(text.encode()).hexdigest()[:16]}"
