"""Tables in JSON: a list of objects with the columns' names, an object of lists, or an object a line.

    [{"t": 0.0, "roll": 0.01}, {"t": 0.005, "roll": 0.012}]
    {"t": [0.0, 0.005], "roll": [0.01, 0.012]}

An object may have other keys beside the table: {"robot": "r2", "data": [..]}. A list of numbers becomes numbered
columns: "psi": [1, 2, 3] is psi_1, psi_2, psi_3. The names of inner objects are joined with a point: "imu": {"roll":
0.1} is imu.roll, and "motor": [{"pos": 1}] is motor_1.pos. null, true and false are a missing value, 1 and 0; other
values are skipped.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_text
from ballbot.log.columns import Columns

#: objects and lists within one another, and numbers that one name may have in a row
_DEEPEST, _WIDEST = 32, 100


def read_json_table(path: str | Path) -> Columns:
    """Read the columns (N,) of a table in JSON, by name; InputError if the file holds no such table."""
    text = read_text(path, largest=LARGEST_TABLE)
    lines = [line.strip() for line in text.split("\n") if line.strip()]
    try:
        if len(lines) > 1 and lines[0].startswith("{") and lines[0].endswith("}"):
            tree: object = [json.loads(line) for line in lines]
        else:
            tree = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{path} is not JSON, line {error.lineno}: {error.msg}.") from None
    except (RecursionError, ValueError) as error:
        raise InputError(f"{path} is not JSON that can be read: {error}.") from None
    columns = _table(tree, depth=0)
    if not columns:
        raise InputError(
            f"{path} contains no table: give a list of objects with the columns' names, or an object of lists."
        )
    return {name: np.array(values, dtype=np.float64) for name, values in columns.items()}


def _table(tree: object, *, depth: int) -> dict[str, list[float]]:
    """Return the columns of the largest table in a tree; empty if it has no table."""
    if isinstance(tree, list):
        rows = [flattened(row) for row in tree if isinstance(row, Mapping)]
        names = dict.fromkeys(name for row in rows for name in row)
        return {name: [row.get(name, math.nan) for row in rows] for name in names}
    if not isinstance(tree, Mapping) or depth > _DEEPEST:
        return {}
    columns = {
        str(name): [_number(cell) for cell in values]
        for name, values in tree.items()
        if isinstance(values, list) and len(values) > 1 and all(map(_is_cell, values))
    }
    inner = [_table(value, depth=depth + 1) for value in tree.values()]
    return max([columns, *inner], key=lambda table: sum(map(len, table.values())))


def flattened(row: Mapping[str, object], *, before: str = "", depth: int = 0) -> dict[str, float]:
    """Return the numbers of an object by their keys, joined as described above; other values are skipped."""
    cells: dict[str, float] = {}
    for key, value in row.items():
        name = f"{before}{key}"
        if _is_cell(value):
            cells[name] = _number(value)
        elif isinstance(value, Mapping) and depth < _DEEPEST:
            cells |= flattened(value, before=f"{name}.", depth=depth + 1)
        elif isinstance(value, list) and len(value) <= _WIDEST and depth < _DEEPEST:
            items = {f"{name}_{index}": item for index, item in enumerate(value, start=1)}
            cells |= flattened(items, depth=depth + 1)
    return cells


def _is_cell(value: object) -> bool:
    return value is None or isinstance(value, int | float)


def _number(value: object) -> float:
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:
        return math.inf
