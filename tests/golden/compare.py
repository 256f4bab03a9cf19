"""Where a result differs from its golden: bit for bit on the golden's machine, in structure on any other.

In structure means the same keys, kinds of values, words without digits, and shapes of lists of numbers, except below
`VARIABLE`: how long an iteration goes on, and which of two methods gives an interval, may depend on a last digit.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from .freeze import DIGEST, Json

#: keys below which the number of entries may differ on another machine
VARIABLE = frozenset({"evolution", "gauss_newton", "criterion_after_each_generation", "findings", "from"})

Parts: TypeAlias = tuple[str, ...]

_ABSENT = "(absent)"


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One value that is not as it was."""

    path: str  #: parts joined by /
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.path}: {self.old} -> {self.new}"


def differences(
    name: str, golden: Json, result: Json, *, renamed: Mapping[str, str], same_machine: bool
) -> list[Difference]:
    """Return where a result differs from its golden.

    Parameters
    ----------
    name : str
        The case, with which the paths in `renamed` begin.
    golden, result : Json
        From `freeze_folder`.
    renamed : mapping of str to str
        Old path to new one; see renamed_keys.toml.
    same_machine : bool
        Whether numbers are compared.
    """
    rules = [(tuple(old.split("/")), tuple(new.split("/")) if new else None) for old, new in renamed.items()]
    old = dict(_renamed(_flatten(golden, (name,)), rules))
    new = dict(_flatten(result, (name,)))
    found = []
    for path in dict.fromkeys([*old, *new]):
        if not same_machine and VARIABLE.intersection(path):
            continue
        before, after = _text(old, path), _text(new, path)
        if before != after and (same_machine or not _alike(old, new, path)):
            found.append(Difference(path="/".join(path), old=before, new=after))
    return found


def _flatten(value: Json, path: Parts) -> Iterator[tuple[Parts, Json]]:
    if isinstance(value, dict) and value:
        for key, one in value.items():
            yield from _flatten(one, (*path, key))
    elif isinstance(value, list) and value:
        for place, one in enumerate(value):
            yield from _flatten(one, (*path, str(place)))
    else:
        yield path, value


def _renamed(
    leaves: Iterator[tuple[Parts, Json]], rules: list[tuple[Parts, Parts | None]]
) -> Iterator[tuple[Parts, Json]]:
    """Yield leaves under their present paths: that of the longest rule that matches the beginning of the old one."""
    for path, value in leaves:
        matching = [(old, new) for old, new in rules if _matched(old, path) is not None]
        if not matching:
            yield path, value
            continue
        old, new = max(matching, key=lambda rule: len(rule[0]))
        if new is not None:
            free = iter(_matched(old, path) or ())
            yield (*(next(free) if "*" in part else part for part in new), *path[len(old) :]), value


def _matched(pattern: Parts, path: Parts) -> list[str] | None:
    """Return the parts of a path that stand for the parts of a pattern with a star, or None if it does not match."""
    if len(pattern) > len(path):
        return None
    found = []
    for wanted, part in zip(pattern, path, strict=False):
        if "*" in wanted:
            if not part.startswith(wanted.split("*")[0]):
                return None
            found.append(part)
        elif wanted != part:
            return None
    return found


def _text(leaves: Mapping[Parts, Json], path: Parts) -> str:
    return json.dumps(leaves[path]) if path in leaves else _ABSENT


def _alike(old: Mapping[Parts, Json], new: Mapping[Parts, Json], path: Parts) -> bool:
    if path not in old or path not in new:
        return False
    return _outline(old[path]) == _outline(new[path])


def _outline(value: Json) -> str:
    """Return what a value has in common on all machines."""
    if isinstance(value, str) and value.startswith(DIGEST):
        return value.partition("]")[0]  # and the shape
    if isinstance(value, str):
        return "word" if any(one.isdigit() for one in value) else value
    if isinstance(value, bool):
        return "truth value"
    if isinstance(value, dict | list):
        return "empty"
    return "number"  # null stands for a number that is not finite
