"""Where a result differs from its golden: bit for bit on the golden's machine, in structure on any other.

In structure means the same keys, kinds of values, words without digits, and shapes of lists of numbers, except below
`VARIABLE`: how long an iteration goes on, and which of two methods gives an interval, may depend on a last digit.
"""

import json
from collections.abc import Iterator
from typing import TypeAlias

from .freeze import DIGEST, Json

#: keys below which the number of entries may differ on another machine
VARIABLE = frozenset({"gauss_newton", "findings", "from"})

Parts: TypeAlias = tuple[str, ...]


def differences(name: str, golden: Json, result: Json, *, same_machine: bool) -> list[str]:
    """Return where the result of a case differs from its golden; numbers are compared on the `same_machine` alone."""
    leaves = [dict(_flatten(one, (name,))) for one in (golden, result)]
    found = []
    for path in dict.fromkeys([*leaves[0], *leaves[1]]):
        if not same_machine and VARIABLE.intersection(path):
            continue
        before, after = (json.dumps(one[path]) if path in one else "(absent)" for one in leaves)
        alike = not same_machine and all(path in one for one in leaves)
        if before != after and not (alike and _outline(leaves[0][path]) == _outline(leaves[1][path])):
            found.append(f"{'/'.join(path)}: {before} -> {after}")
    return found


def _flatten(value: Json, path: Parts) -> Iterator[tuple[Parts, Json]]:
    if isinstance(value, dict | list) and value:
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _flatten(one, (*path, str(key)))
    else:
        yield path, value


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
