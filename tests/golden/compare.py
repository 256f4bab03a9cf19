"""Where a result differs from its golden: bit for bit on the golden's machine, in structure on any other.

In structure means the same keys, kinds of values, words without digits, and shapes of lists of numbers, except below
`VARIABLE`: how long an iteration goes on, and which of two methods gives an interval, may depend on a last digit.
"""

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


def differences(name: str, golden: Json, result: Json, *, same_machine: bool) -> list[Difference]:
    """Return where the result of a case differs from its golden; numbers are compared on the `same_machine` alone."""
    old, new = dict(_flatten(golden, (name,))), dict(_flatten(result, (name,)))
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
