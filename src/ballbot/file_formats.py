"""The versions of the formats of Ballbot's own files.

Robot, controller, scenario, mapping and course files have a key `format`, such as "ballbot robot 1", and in its comment
the version of Ballbot that wrote them; results.json has both as keys. A file without the key was written by hand, and
is read as one of the present format.

A number rises when an earlier Ballbot would misread the new file: a key is renamed, removed, or means something else. A
new key that may be left out changes nothing. Files of another number are refused, and files with a key that is gone are
refused with what to write in its place.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from ballbot.errors import InputError, about
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

_RESISTANCE = (
    'write it into the robot file, under [drive], as resistance = { value = .., unit = "ohm", source = "measured" }, '
    "and remove the line"
)
#: tables and keys that files of earlier versions have, * for any name, and what is to be done with them
_FORMER: Mapping[Kind, Mapping[str, str]] = {
    "robot": {"correlation.standard_errors": "remove the line; standard deviations are those of the values"},
    "controller": {
        "lean_bound": "call it lean_limit",
        "shaping.feed_forward": "remove the line and, if it was true, end the file with a line [feed_forward]",
        "standstill": "remove it; the assist at rest gained nothing",
        "driveline_adaptation": "remove it; it followed too little of a change of friction",
        "floor_adaptation": "remove it; it gained nothing",
        "load_scaling": "remove it; it gained nothing",
    },
    "scenario": {
        "driveline_laws": "remove it; the drivelines have the friction of [friction]",
        "load_dependence.share": "call it fraction",
        "supply.winding_resistance": _RESISTANCE,
    },
    "mapping": {
        "file.repeated_rows": "remove the line; repeated rows are left out",
        "input.resistance": _RESISTANCE,
        "columns.t.nanoseconds": "write seconds and nanoseconds as one column of the log, and remove the key",
    },
    "courses": {
        "*.*.unlike": "call it mismatch",
        "*.*.rising_pushes": "write largest_push, one push a run, its size by bisection",
    },
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
    """Return a file's tables without the key `format`, once it is found to be readable.

    InputError if the file is of another kind or format, or has keys of an earlier one.
    """
    rest = dict(tree)
    name = rest.pop("format", None)
    if name is not None:
        _check_format(name, kind)
    former = [
        f"{key}: {remedy}"
        for place, remedy in _FORMER.get(kind, {}).items()
        for key in _matches(rest, place.split("."))
    ]
    if former:
        raise InputError(f"an earlier Ballbot wrote keys that are gone. {'. '.join(former)}.")
    return rest


def _matches(tree: object, place: Sequence[str]) -> Iterator[str]:
    """Yield the names of a file's tables and keys that are at a place of `_FORMER`."""
    if not isinstance(tree, Mapping):
        return
    for key in tree if place[0] == "*" else {place[0]} & tree.keys():
        if len(place) == 1:
            yield key
        else:
            yield from (f"{key}.{inner}" for inner in _matches(tree[key], place[1:]))


def _check_format(name: object, kind: Kind) -> None:
    found = _NAME.fullmatch(name) if isinstance(name, str) else None
    if found is None or found[1] not in NEWEST:
        raise InputError(f"format is {name!r}; it must be {format_name(kind)!r}, or be left out.")
    if found[1] != kind:
        raise InputError(f"format is {name!r}, but this must be a {kind} file.")
    if int(found[2]) != NEWEST[kind]:
        newer = int(found[2]) > NEWEST[kind]
        raise InputError(
            f"format is {name!r}, which {'a newer' if newer else 'an earlier'} Ballbot wrote; this one "
            f"({version('ballbot')}) reads {format_name(kind)!r}. "
            f"{'Update it: pip install --upgrade ballbot' if newer else 'Make the file anew.'}"
        )


def results_text(results: Mapping[str, object]) -> str:
    """Return the text of a results.json: its format, the version of Ballbot, and the results."""
    return as_json({"format": format_name("results"), "ballbot": version("ballbot"), **results})


def read_results(path: str | Path) -> object:
    """Return what a results.json holds: None for a number that is missing, inf and -inf for one that is infinite.

    InputError if it cannot be read, is no JSON, or is of another kind or format.
    """
    tree = with_infinities(read_json(path))
    with about(path):
        return take_format(tree, "results") if isinstance(tree, dict) else tree
