"""The versions of the formats of Ballbot's own files.

Robot, controller, scenario, mapping and course files have a key `format`, such as "ballbot robot 1", and in its comment
the version of Ballbot that wrote them; results.json has both as keys. A file without the key was written before formats
had numbers, or by hand, and is read as before. Each reader turns the names of earlier keys into the present ones,
whatever the number; what else differs between two numbers is in `MIGRATIONS`.

A number rises when an earlier Ballbot would misread the new file: a key is renamed, removed, or means something else. A
new key that may be left out changes nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from ballbot.errors import InputError
from ballbot.files import read_json
from ballbot.results import as_json, with_infinities
from ballbot.schema import toml_line

Kind = Literal["robot", "controller", "scenario", "mapping", "courses", "results"]

#: the number of the format that is written now
NEWEST: Mapping[Kind, int] = {
    "robot": 1,
    "controller": 1,
    "scenario": 1,
    "mapping": 1,
    "courses": 1,
    "results": 4,
}

Migration = Callable[[dict[str, object]], dict[str, object]]


def _with_one_list_of_findings(tree: Mapping[str, object]) -> dict[str, object]:
    """Return results of format 1 with `warnings` and `remarks` among the `findings` beside them, at every depth."""
    migrated: dict[str, object] = {}
    findings: list[object] = []
    for key, value in tree.items():
        if key in ("findings", "warnings", "remarks") and isinstance(value, list):
            findings += value
            migrated["findings"] = findings
        elif isinstance(value, dict):
            migrated[key] = _with_one_list_of_findings(value)
        else:
            migrated[key] = value
    return migrated


#: until format 2, of a recorded run: what is over the whole run there, and once settled everywhere else
_OVER_THE_WHOLE_RUN = ("peak_position_error", "rms_position_error")


def _with_errors_of_the_whole_run(tree: Mapping[str, object]) -> dict[str, object]:
    """Return results of format 2 with the names of errors that say over which part of a recorded run they are."""
    recorded = "estimation_errors" in tree
    return {
        f"{name}_whole_run" if recorded and name in _OVER_THE_WHOLE_RUN else name: value
        for name, value in tree.items()
    }


#: by kind: what turns the tables of format 1 into those of format 2, those of 2 into those of 3, and so on; `dict`, a
#: plain copy, for a number that only renames keys; a null of results up to 3 may be an infinite number: it is unknown
MIGRATIONS: Mapping[Kind, Sequence[Migration]] = {
    "results": (_with_one_list_of_findings, _with_errors_of_the_whole_run, dict)
}

_NAME = re.compile(r"ballbot (\w+) (\d{1,9})")
_LINE = re.compile(r'^format = "ballbot \w+ \d+".*\n', re.MULTILINE)


def format_name(kind: Kind) -> str:
    """Return what the key `format` of a file holds that is written now."""
    return f"ballbot {kind} {NEWEST[kind]}"


def format_line(kind: Kind) -> str:
    """Return the line of a TOML file that states its format and who wrote it, without a line end."""
    return toml_line(
        "format", format_name(kind), f"of this file, written by Ballbot {version('ballbot')}; may be left out"
    )


def without_format(text: str) -> str:
    """Return the text of a TOML file without the line of its format, which names who wrote it."""
    return _LINE.sub("", text, count=1)


def take_format(tree: Mapping[str, object], kind: Kind) -> dict[str, object]:
    """Return a file's tables in the newest format, without the key `format`, once it is found to be readable.

    Raises
    ------
    InputError
        If the file is of another kind or a newer format.
    """
    rest = dict(tree)
    name = rest.pop("format", None)
    if name is None:
        return rest
    found = _NAME.fullmatch(name) if isinstance(name, str) else None
    if found is None or found[1] not in NEWEST:
        raise InputError(f"format is {name!r}; it must be {format_name(kind)!r}, or be left out.")
    if found[1] != kind:
        raise InputError(f"format is {name!r}, but this must be a {kind} file.")
    if int(found[2]) > NEWEST[kind]:
        raise InputError(
            f"format is {name!r}, which a newer Ballbot wrote; this one ({version('ballbot')}) reads up to "
            f"{format_name(kind)!r}. Update it: pip install --upgrade ballbot"
        )
    for migrate in MIGRATIONS.get(kind, ())[max(int(found[2]) - 1, 0) :]:
        rest = migrate(rest)
    return rest


def results_text(results: Mapping[str, object]) -> str:
    """Return the text of a results.json: its format, the version of Ballbot, and the results."""
    return as_json({"format": format_name("results"), "ballbot": version("ballbot"), **results})


def read_results(path: str | Path) -> object:
    """Return what a results.json holds: None for a number that is missing, inf and -inf for one that is infinite.

    Raises
    ------
    InputError
        If it cannot be read, is no JSON, is of another kind or of a newer format.
    """
    tree = with_infinities(read_json(path))
    try:
        return take_format(tree, "results") if isinstance(tree, dict) else tree
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
